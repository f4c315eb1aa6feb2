"""The closed loop of one axis as found: poles, residues, and all that follows from them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property, reduce
from typing import TYPE_CHECKING, Any, Self

import msgspec
import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.errors import DataError, TwinError, nearest, require
from pinotwin.loop.data import rates
from pinotwin.loop.layout import Layout, lay_out
from pinotwin.loop.sections import ModalStep, continuous, discretise
from pinotwin.loop.structure import Section, Structure

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class ParameterFit:
    """One searched parameter."""

    name: str  # ``"p1"``, ``"wn1"``, ``"zeta1"``, ``"pff"``
    value: float  # [Hz] or [-]
    unit: str  # ``"Hz"`` or ``"-"``
    bounds: tuple[float, float]  # of the search
    error: float | None  # standard error of the logarithm; None at a bound
    interval: tuple[float, float] | None  # 95 % interval; None at a bound
    at_bound: str | None  # ``"lower"``, ``"upper"`` or None


@dataclass(frozen=True)
class LoopFit:
    """Result of a fit."""

    parameters: tuple[ParameterFit, ...]  # the searched poles
    nrmse: Mapping[str, float]  # rms error over rms of the signal, by output, on the data of the fit
    rms: Mapping[str, float]  # rms error [unit of the output]
    samples: int  # number of samples
    blocks: int  # number of blocks of rows that the intervals rest on
    evaluations: int  # of the cost
    ends: tuple[float, ...] = ()  # costs at which the short searches ended, over the lowest
    notes: tuple[str, ...] = ()  # what deserves attention, one sentence each


COMMAND = "qr"


@dataclass(frozen=True)
class LoopModel:
    """Closed-loop LTI model of one axis (thesis Eq. 4.13, 5.6, 5.8); stable by construction."""

    axis: str  # name of the axis
    disturbances: tuple[str, ...]  # names of the disturbances
    outputs: tuple[str, ...]  # names of the outputs
    step: float  # sampling interval of the data [s]
    structure: Structure  # numbers of poles and form of the numerators
    sections: tuple[Section, ...]  # first- and second-order parts of the characteristic polynomial [rad/s]
    # on the unit-gain section states per input (disturbances, then velocity of the command), then on velocity and
    # acceleration of the command, shape (ny, nc), SI
    residues: Floats
    fit: LoopFit | None = None  # how it was found; None for a model that was not fitted

    def __post_init__(self) -> None:
        residues = np.array(self.residues, dtype=float)
        residues.flags.writeable = False
        object.__setattr__(self, "residues", residues)
        shape = (len(self.outputs), self.layout.residues)
        if residues.shape != shape:
            raise TwinError(f"{self.axis}: residues have shape {residues.shape}, expected {shape}")

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs: disturbances, then the command ``qr``."""
        return (*self.disturbances, COMMAND)

    @property
    def layout(self) -> Layout:
        """Places of the residues."""
        return lay_out(self.structure, self.step, (len(self.disturbances), len(self.outputs)))

    @property
    def pole_pairs(self) -> tuple[tuple[float, float], ...]:
        """Pairs (wn [rad/s], zeta [-]) of plant and feedback."""
        pairs = (s.values for s in self.sections if s.order == 2 and not s.feedforward)
        return tuple((wn, zeta) for wn, zeta in pairs)

    @property
    def theta(self) -> Floats:
        """Logarithms of the searched poles, in the order of the search, shape (np,)."""
        return np.log([self.sections[p.section].values[p.value] for p in self.layout.parameters])

    @property
    def poles(self) -> Floats:
        """All poles, feed-forward included [rad/s], complex, shape (order,)."""
        return np.concatenate([np.roots(_polynomials(s)[0]) for s in self.sections])

    def numerator(self, output: str, input: str) -> tuple[Floats, Floats]:
        """Return numerator and denominator, highest power of s first, with the zeros that the structure demands."""
        require(output, self.outputs, f"{self.axis}: no output", DataError)
        require(input, self.inputs, f"{self.axis}: no input", DataError)
        row, index, layout = self.outputs.index(output), self.inputs.index(input), self.layout
        slots = [slot for slot in layout.slots if slot.input == index]
        parts = [_polynomials(self.sections[slot.section]) for slot in slots]
        den = _product(factor for factor, _ in parts)
        num = np.zeros(1)
        for i, slot in enumerate(slots):
            rest = _product(factor for j, (factor, _) in enumerate(parts) if j != i)
            for state, own in enumerate(parts[i][1]):
                part = self.residues[row, slot.at + state] * np.polymul(own, rest)
                num = np.asarray(np.polyadd(num, part), dtype=np.float64)
        if index == layout.disturbances:
            direct = np.array([self.residues[row, -1], self.residues[row, -2]])
            num = np.asarray(np.polyadd(num, np.polymul(direct, den)), dtype=np.float64)
        return _as_demanded(layout, row, index, num, den), den

    def transfer(self, output: str, input: str) -> control.TransferFunction:
        """Return the transfer function from ``input`` to ``output`` as a python-control system."""
        import control

        num, den = self.numerator(output, input)
        return control.TransferFunction(num, den, inputs=[input], outputs=[output])

    def to_control(self, input: str | None = COMMAND, output: str | None = "e") -> control.StateSpace:
        """Return the loop as a python-control system with named signals.

        Args:
            input: a disturbance [N or N·m], the command ``qr`` [m or rad], its velocity ``vr`` or acceleration ``ar``;
                None: all disturbances, ``vr`` and ``ar``.
            output: e, u, or the position ``q`` = qr - e, which answers ``qr`` and disturbances; None: all but ``q``.

        Raises:
            DataError: a name that the loop does not have, or an effort that differentiates its input.
        """
        import control

        inputs, outputs = (*self.inputs, "vr", "ar"), (*self.outputs, "q")
        for name, known in ((input, inputs), (output, outputs)):
            if name is not None and name not in known:
                lists = f"inputs {', '.join(inputs)}; outputs {', '.join(outputs)}"
                raise DataError(f"{self.axis}: no signal {name!r} there; {nearest(name, known)}; {lists}")
        if output == "q" and input in (None, "vr", "ar"):
            raise DataError(f"{self.axis}: q needs input qr or {', '.join(self.disturbances)}, not {input}")
        A, B, C, D = _parallel(self)
        if output is not None:
            row = self.outputs.index("e" if output == "q" else output)
            C, D = C[[row]], D[[row]]
        every = [*self.disturbances, "vr", "ar"]
        if input == COMMAND:
            if np.any(D[:, -2:]):
                raise DataError(
                    f"{self.axis}: feed-forward differentiates {input}, so that {output or 'u'} has no state space "
                    "from it; use input 'vr' or 'ar'"
                )
            # x' = A x + b s qr becomes z' = A z + A b qr with x = z + b qr.
            b = B[:, [-2]]
            B, D = A @ b, C @ b
        elif input is not None:
            at = every.index(input)
            B, D = B[:, [at]], D[:, [at]]
        if output == "q":
            C, D = -C, float(input == COMMAND) - D
        names = {"inputs": every if input is None else [input]}
        names["outputs"] = list(self.outputs) if output is None else [output]
        return control.StateSpace(A, B, C, D, **names)

    def modal(self, step: float | None = None) -> ModalStep:
        """Return the stepping form at a sampling interval [s]; not to be changed."""
        return self._own_modal if step in (None, self.step) else self._modal(step or self.step)

    @cached_property
    def _own_modal(self) -> ModalStep:
        """That at the log's interval: friction is refined by a hundred responses of one loop."""
        return self._modal(self.step)

    def _modal(self, h: float) -> ModalStep:
        layout = self.layout
        parts = discretise(self.sections, h)
        index = [slot.section for slot in layout.slots]
        k, ny = len(index), len(self.outputs)
        C, rate, drive = np.zeros((ny, k, 2)), np.zeros((k, 2, 2)), np.zeros((k, 2))
        for b, slot in enumerate(layout.slots):
            C[:, b, : slot.order] = self.residues[:, slot.at : slot.at + slot.order]
            rate[b], drive[b] = continuous(self.sections[slot.section])
        D = np.zeros((ny, len(self.disturbances) + 1))
        D[:, -1] = self.residues[:, -2]
        driven = np.array([slot.input for slot in layout.slots], dtype=np.intp)
        A, B0, B1 = parts.A[index, 0], parts.B[index, 0, 0], parts.B[index, 1, 0]
        return ModalStep(driven, A, B0, B1, C, D, self.residues[:, -1].copy(), rate, drive)

    def simulate(
        self,
        qr: Floats,
        d: Floats,
        x0: Floats | None = None,
        *,
        vr: Floats | None = None,
        ar: Floats | None = None,
        step: float | None = None,
    ) -> Floats:
        """Return the outputs to a command ``qr`` (n,) and disturbances ``d``, (n,) or (n, nd), shape (n, ny).

        From modal states ``x0`` (k, 2), at rest under the first inputs where absent; velocity and acceleration of the
        command by spline where absent; ``step`` [s] is that of the identified data where absent.
        """
        h = step or self.step
        given = (None if x is None else np.asarray(x, dtype=float) for x in (vr, ar))
        velocity, acceleration = rates(np.asarray(qr, dtype=float), h, *given)
        w = np.column_stack([np.asarray(d, dtype=float), velocity])
        if w.shape[1] != len(self.disturbances) + 1:
            raise DataError(
                f"{self.axis}: {w.shape[1] - 1} disturbances given, the loop has "
                f"{len(self.disturbances)} ({', '.join(self.disturbances)})"
            )
        modal = self.modal(h)
        out = np.outer(velocity, modal.D[:, -1]) + np.outer(acceleration, modal.Da)
        x = modal.equilibrium(w[0]) if x0 is None else np.asarray(x0, dtype=float)
        modal.respond(w, x, modal.C, out)
        return out

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; :meth:`from_dict` restores them exactly."""
        return {**asdict(self), "residues": self.residues.tolist()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Return the model that :meth:`to_dict` wrote; TwinError where a key is missing."""
        try:
            return cls(
                axis=values["axis"],
                disturbances=tuple(values["disturbances"]),
                outputs=tuple(values["outputs"]),
                step=float(values["step"]),
                structure=Structure.from_dict(values["structure"]),
                sections=msgspec.convert(values["sections"], tuple[Section, ...]),
                residues=np.array(values["residues"], dtype=float),
                fit=msgspec.convert(values.get("fit"), LoopFit | None),
            )
        except KeyError as missing:
            raise TwinError(f"loop: key {missing} is missing; identify the twin again") from None

    def pole_table(self) -> tuple[dict[str, Any], ...]:
        """Return rows as thesis Tables 4-4 and 7-3: name, value, unit, bounds, 95 % interval."""
        rows = []
        found = {} if self.fit is None else {p.name: p for p in self.fit.parameters}
        for section in self.sections:
            for name, value in zip(section.names, section.values, strict=False):
                hertz = not name.startswith("zeta")
                row: dict[str, Any] = {
                    "name": name,
                    "value": value / (2 * math.pi) if hertz else value,
                    "unit": "Hz" if hertz else "-",
                    "preassigned": not section.free,
                }
                if (p := found.get(name)) is not None:
                    row |= {"lower": p.bounds[0], "upper": p.bounds[1]}
                    row |= {"interval": p.interval, "at_bound": p.at_bound}
                rows.append(row)
        return tuple(rows)


def _polynomials(section: Section) -> tuple[Floats, tuple[Floats, ...]]:
    """Return a section's factor of the characteristic polynomial, highest power first, and its states' numerators."""
    if section.order == 1:
        p = section.values[0]
        return np.array([1.0, p]), (np.array([p]),)
    wn, zeta = section.values
    return np.array([1.0, 2.0 * zeta * wn, wn * wn]), (np.array([wn * wn]), np.array([wn, 0.0]))


def _product(factors: Iterable[Floats]) -> Floats:
    return reduce(np.convolve, factors, np.ones(1))


def _as_demanded(layout: Layout, output: int, index: int, num: Floats, den: Floats) -> Floats:
    """Return the numerator with the coefficients that the structure fixes set exactly."""
    command, form = index == layout.disturbances, layout.form(output, index)
    improper = sum(layout.structure.passes(output)) if command else 0
    length = len(den) - form.degree if not improper else len(den) + improper - 1
    exact = np.zeros(length)
    tail = num[-length:]
    exact[length - len(tail) :] = tail
    if form.gain is not None:
        exact[-1] = form.gain * den[-1]
    return np.append(exact, 0.0) if command else exact


def _parallel(model: LoopModel) -> tuple[Floats, Floats, Floats, Floats]:
    """Return continuous A, B, C, D with inputs (disturbances, vr, ar), idle states removed."""
    modal = model.modal()
    orders = [slot.order for slot in model.layout.slots]
    keep = np.array([i for b, order in enumerate(orders) for i in range(2 * b, 2 * b + order)])
    k, m = len(orders), modal.inputs
    A, B = scipy.linalg.block_diag(*modal.rate), np.zeros((k, 2, m + 1))
    B[np.arange(k), :, modal.input] = modal.drive
    C = modal.C.reshape(len(modal.C), -1)
    D = np.column_stack([modal.D, modal.Da])
    return A[np.ix_(keep, keep)], B.reshape(2 * k, -1)[keep], C[:, keep], D
