"""Where everything stands: searched parameters, states per input, ties between residues.

An output is ``c @ states``, with one set of section states per input. The numerator's form (``structure``) ties the
residues: of x' = A x + B w, a relative degree r means c A^k B = 0 for k < r - 1, and the gain at frequency zero is
the sum of the residues on the first state of every section.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import InputError, require
from pinotwin.loop.sections import continuous, derivatives
from pinotwin.loop.structure import Channel, Section, Structure

Bounds = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class Parameter:
    """One searched number."""

    name: str  # ``"p1"``, ``"wn1"``, ``"zeta1"``, ``"pff"``
    section: int  # index of its section
    value: int  # index among the values of the section
    lower: float  # lower bound, [Hz] or [-]
    upper: float  # upper bound
    guess: tuple[float, float, float]  # lowest, middle and highest that a search starts from

    @property
    def scale(self) -> float:
        """Factor from the unit of the bounds to rad/s or 1."""
        return 1.0 if self.name.startswith("zeta") else 2.0 * math.pi


@dataclass(frozen=True)
class Slot:
    """The states of one section driven by one input."""

    input: int  # index of the input; disturbances first, then the command's velocity
    section: int  # index of the section
    at: int  # index of its first residue
    order: int  # number of states


@dataclass(frozen=True)
class Ties:
    """Linear ties N.T @ c = g on the residues of one output."""

    allowed: Mask  # residues that may differ from zero, shape (nc,)
    N: Floats  # shape (nc, m); rows that are not allowed are zero
    g: Floats  # shape (m,)
    dN: Floats  # derivative of N by each searched parameter's logarithm, shape (np, nc, m)

    def particular(self) -> tuple[Floats, Floats]:
        """Return residues that obey the ties (nc,), and the directions they leave free (nc, nz)."""
        c = np.zeros(len(self.allowed))
        basis, triangle, m = self._factor()
        Z = np.zeros((len(self.allowed), basis.shape[1] - m))
        Z[self.allowed] = basis[:, m:]
        c[self.allowed] = basis[:, :m] @ np.linalg.solve(triangle.T, self.g)
        return c, Z

    def moves(self, c: Floats) -> Floats:
        """Return how the residues must move with each parameter to keep to the ties, (nc, np)."""
        basis, triangle, m = self._factor()
        out = np.zeros((len(c), len(self.dN)))
        broken = np.einsum("icm,c->mi", self.dN, c)
        out[self.allowed] = -basis[:, :m] @ np.linalg.solve(triangle.T, broken)
        return out

    def _factor(self) -> tuple[Floats, Floats, int]:
        N = self.N[self.allowed]
        m = N.shape[1]
        if not m:
            return np.eye(len(N)), np.zeros((0, 0)), 0
        basis, triangle = np.linalg.qr(N, mode="complete")
        return basis, triangle[:m], m


@dataclass(frozen=True)
class Layout:
    """Parameters and residues of one structure."""

    structure: Structure  # the structure
    sections: tuple[Section, ...]  # the sections; the values of free ones are starting points
    parameters: tuple[Parameter, ...]  # what is searched
    slots: tuple[Slot, ...]  # the states per input
    disturbances: int  # number of disturbances
    outputs: int  # number of outputs

    @property
    def states(self) -> int:
        """Number of residues on states."""
        return sum(slot.order for slot in self.slots)

    @property
    def residues(self) -> int:
        """Number of residues of one output: states, then the command's velocity, acceleration."""
        return self.states + 2

    def shaped(self, theta: Floats) -> tuple[Section, ...]:
        """Return the sections at ``theta``, the logarithms of the parameters in rad/s or 1."""
        values = [list(section.values) for section in self.sections]
        for parameter, x in zip(self.parameters, theta, strict=True):
            values[parameter.section][parameter.value] = math.exp(x)
        return tuple(
            replace(section, values=tuple(v)) for section, v in zip(self.sections, values, strict=True)
        )

    @property
    def box(self) -> tuple[Floats, Floats]:
        """Bounds of theta, shapes (np,)."""
        low = [math.log(p.lower * p.scale) for p in self.parameters]
        high = [math.log(p.upper * p.scale) for p in self.parameters]
        return np.array(low), np.array(high)

    def ties(self, sections: Sequence[Section], output: int, scale: Floats) -> Ties:
        """Return the ties on the residues of one output; ``scale`` is the gain 1 in their units, shape (ni,)."""
        allowed = np.ones(self.residues, dtype=bool)
        allowed[self.states :] = self.structure.passes(output)
        ties = [
            self._channel(sections, j, self.form(output, j), scale[j]) for j in range(self.disturbances + 1)
        ]
        N = np.concatenate([t[0] for t in ties], axis=1)
        dN = np.concatenate([t[2] for t in ties], axis=2)
        N[~allowed], dN[:, ~allowed] = 0.0, 0.0
        return Ties(allowed, N, np.concatenate([t[1] for t in ties]), dN)

    def form(self, output: int, index: int) -> Channel:
        """Return the form of the transfer function from an input to an output."""
        if index < self.disturbances:
            return self.structure.disturbance(output, index)
        return self.structure.command(output)

    def _channel(
        self, sections: Sequence[Section], index: int, form: Channel, unit: float
    ) -> tuple[Floats, Floats, Floats]:
        """Return N, g and dN of one transfer function."""
        count = form.degree - 1
        m = count + (form.gain is not None)
        N, dN = np.zeros((self.residues, m)), np.zeros((len(self.parameters), self.residues, m))
        for slot in self.slots:
            if slot.input != index:
                continue
            rows = slice(slot.at, slot.at + slot.order)
            leading, slopes = _leading(sections[slot.section], count)
            N[rows, :count] = leading[: slot.order]
            for i, parameter in enumerate(self.parameters):
                if parameter.section == slot.section:
                    dN[i, rows, :count] = slopes[parameter.value, : slot.order]
            if form.gain is not None:
                N[slot.at, -1] = 1.0
        if form.gain is not None and index == self.disturbances:
            N[self.states, -1] = 1.0
        g = np.zeros(m)
        if form.gain is not None:
            g[-1] = form.gain * unit
        return N, g, dN


@lru_cache(maxsize=64)
def _leading(section: Section, count: int) -> tuple[Floats, Floats]:
    """Return A^k B (2, count) and its derivatives (2, 2, count), in units of 100 rad/s; every channel asks anew."""
    A, B = continuous(section)
    dA, dB = derivatives(section)
    out, slopes = np.zeros((2, count)), np.zeros((2, 2, count))
    for k in range(count):
        out[:, k], slopes[:, :, k] = B / 100.0, dB / 100.0
        dB = (dA @ B + dB @ A.T) / 100.0
        B = A @ B / 100.0
    return out, slopes


def lay_out(
    structure: Structure, step: float, shape: tuple[int, int], bounds: Bounds | None = None
) -> Layout:
    """Return the layout of a structure at a step [s], for numbers of disturbances and of outputs."""
    sections = structure.sections(step)
    parameters = _parameters(sections, step, bounds or {})
    slots: list[Slot] = []
    at = 0
    for j in range(shape[0] + 1):
        for s, section in enumerate(sections):
            own = structure.numerators == "source" or j == shape[0] or not section.feedforward
            if own:
                slots.append(Slot(j, s, at, section.order))
                at += section.order
    return Layout(structure, sections, parameters, tuple(slots), *shape)


def _usual(name: str, step: float, pairs: int) -> tuple[tuple[float, float], tuple[float, float, float]]:
    """Return the usual bounds of a parameter [Hz] or [-] and low, middle and high guess.

    The bounds are thesis Tables 4-4 and 7-3, widened, below Nyquist; several light pairs each have their own guess.
    """
    slow, fast = min(0.5, 0.01 / step), min(0.4 / step, 400.0)
    if name == "pff":
        return (0.1 / step, 0.5 / step), (100.0, 400.0, 4000.0)
    if name.startswith("p"):
        return (slow, fast), (5.0, 30.0, 90.0)
    if name == "wn1":
        return (slow, fast), (3.0, 10.0, 60.0)
    if name == "zeta1":
        return (0.1, 1.5), (0.3, 0.7, 1.2)
    if name.startswith("zeta"):
        return (0.005, 0.7), (0.02, 0.08, 0.4)
    place = (int(name[2:]) - 1.5) / max(pairs - 1, 1)
    return (min(3.0, 0.03 / step), fast), (8.0, 8.0 * (80.0 / 8.0) ** place, 90.0)


def _parameters(sections: Sequence[Section], step: float, bounds: Bounds) -> tuple[Parameter, ...]:
    found = [(n, s, k) for s, part in enumerate(sections) if part.free for k, n in enumerate(part.names)]
    names = [name for name, _, _ in found]
    for name, (low, high) in bounds.items():
        require(name, names, "bounds: no searched parameter", InputError)
        if not 0 < low < high:
            raise InputError(f"bounds of {name}: ({low}, {high}); expected 0 < lower < upper")
        if not name.startswith("zeta") and low >= 0.5 / step:
            raise InputError(
                f"bounds of {name}: ({low}, {high}); the log shows nothing above {0.5 / step:g} Hz"
            )
    out, pairs = [], sum(part.order == 2 and not part.feedforward for part in sections)
    for name, place, value in found:
        usual, guess = _usual(name, step, pairs)
        low, high = bounds.get(name, usual)
        high = high if "zeta" in name else min(high, 0.5 / step)
        out.append(Parameter(name, place, value, low, high, guess))
    return tuple(out)
