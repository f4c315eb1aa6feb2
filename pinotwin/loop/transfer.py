"""Polynomials and state spaces of an identified loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.linalg import expm

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.loop.layout import Layout
from pinotwin.loop.modal import Hold, ModalStep
from pinotwin.loop.structure import Section, Structure

if TYPE_CHECKING:
    import control


class Sum(Protocol):
    """A sum of first- and second-order sections with residues: what a loop's transfer functions follow from."""

    @property
    def axis(self) -> str:
        """Name of the axis."""

    @property
    def structure(self) -> Structure:
        """Numbers of poles and form of the numerators."""

    @property
    def sections(self) -> tuple[Section, ...]:
        """Parts of the characteristic polynomial."""

    @property
    def residues(self) -> Floats:
        """On the section states of every input, for each output."""

    @property
    def disturbances(self) -> tuple[str, ...]:
        """Names of the disturbances."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""

    @property
    def layout(self) -> Layout:
        """Which state belongs to which section and input."""

    def modal(self, step: float | None = None, hold: Hold = "foh") -> ModalStep:
        """Return the discrete modal form."""


def factor(section: Section) -> Floats:
    """Return the section's factor of the characteristic polynomial, highest power first."""
    if section.order == 1:
        return np.array([1.0, section.values[0]])
    wn, zeta = section.values
    return np.array([1.0, 2.0 * zeta * wn, wn * wn])


def _state_numerators(section: Section) -> tuple[Floats, ...]:
    """Return the numerator of every state over the section's factor."""
    if section.order == 1:
        return (np.array([section.values[0]]),)
    wn = section.values[0]
    return np.array([wn * wn]), np.array([wn, 0.0])


def _product(sections: Sequence[Section]) -> Floats:
    """Return the product of the sections' factors."""
    den = np.array([1.0])
    for section in sections:
        den = np.polymul(den, factor(section))
    return den


def fraction(model: Sum, output: int, index: int) -> tuple[Floats, Floats]:
    """Return numerator and denominator of one transfer function; see ``LoopModel.numerator``."""
    layout = model.layout
    slots = [slot for slot in layout.slots if slot.input == index]
    sections = [model.sections[slot.section] for slot in slots]
    den = _product(sections)
    num = np.zeros(1)
    for i, slot in enumerate(slots):
        rest = _product([other for j, other in enumerate(sections) if j != i])
        for state, own in enumerate(_state_numerators(sections[i])):
            part = model.residues[output, slot.at + state] * np.polymul(own, rest)
            num = np.asarray(np.polyadd(num, part), dtype=np.float64)
    command = index == layout.disturbances
    if command:
        direct = np.array([model.residues[output, -1], model.residues[output, -2]])
        num = np.asarray(np.polyadd(num, np.polymul(direct, den)), dtype=np.float64)
    return _as_demanded(model, output, index, num, den), den


def _as_demanded(model: Sum, output: int, index: int, num: Floats, den: Floats) -> Floats:
    """Return the numerator with the coefficients that the structure fixes set exactly."""
    command = index == len(model.disturbances)
    structure = model.structure
    form = structure.command(output) if command else structure.disturbance(output, index)
    improper = 0
    if command:
        improper = 2 if structure.passes(output)[1] else int(structure.passes(output)[0])
    length = len(den) - form.degree if not improper else len(den) + improper - 1
    exact = np.zeros(length)
    tail = num[-length:]
    exact[length - len(tail) :] = tail
    if form.gain is not None:
        exact[-1] = form.gain * den[-1]
    return np.append(exact, 0.0) if command else exact


def _parallel(model: Sum) -> tuple[Floats, Floats, Floats, Floats]:
    """Return continuous A, B, C, D with inputs (disturbances, vr, ar), idle states removed."""
    modal = model.modal()
    orders = [slot.order for slot in model.layout.slots]
    keep = np.array([i for b, order in enumerate(orders) for i in range(2 * b, 2 * b + order)])
    k, m = len(orders), modal.inputs
    A, B = np.zeros((2 * k, 2 * k)), np.zeros((2 * k, m + 1))
    for b in range(k):
        rows = slice(2 * b, 2 * b + 2)
        A[rows, rows], B[rows, modal.input[b]] = modal.rate[b], modal.drive[b]
    C = modal.C.reshape(len(modal.C), -1)
    D = np.column_stack([modal.D, modal.Da])
    return A[np.ix_(keep, keep)], B[keep], C[:, keep], D


def _matrices(model: Sum, command: str) -> tuple[Floats, Floats, Floats, Floats, list[str]]:
    A, B, C, D = _parallel(model)
    if command == "vr":
        return A, B, C, D, [*model.disturbances, "vr", "ar"]
    if command != "qr":
        raise DataError(f"command: {command!r}, expected 'qr' or 'vr'")
    if np.any(D):
        raise DataError(
            f"{model.axis}: feed-forward without poles takes velocity and acceleration of the "
            "command; ask for command='vr', or identify with feedforward_poles"
        )
    # x' = A x + b s qr becomes z' = A z + A b qr with x = z + b qr.
    b = B[:, -2]
    B = np.column_stack([B[:, :-2], A @ b])
    D = np.column_stack([D[:, :-2], C @ b])
    return A, B, C, D, list(model.inputs)


def state_space(model: Sum, command: str) -> control.StateSpace:
    """Return the continuous system; see ``LoopModel.state_space``."""
    import control

    A, B, C, D, inputs = _matrices(model, command)
    return control.StateSpace(A, B, C, D, inputs=inputs, outputs=list(model.outputs))


def discrete(model: Sum, step: float, hold: Hold, command: str) -> control.StateSpace:
    """Return the discrete system; see ``LoopModel.discrete``."""
    import control

    A, B, C, D, inputs = _matrices(model, command)
    n, m = B.shape
    M = np.zeros((n + 2 * m, n + 2 * m))
    M[:n, :n], M[:n, n : n + m] = A * step, B * step
    M[n : n + m, n + m :] = np.eye(m)
    E = expm(M)
    Ad, whole, slope = E[:n, :n], E[:n, n : n + m], E[:n, n + m :]
    if hold == "zoh":
        Bd, Dd = whole, D
    else:  # the state is moved to z = x - slope w, which makes the input of the next sample vanish
        Bd, Dd = whole - slope + Ad @ slope, D + C @ slope
    return control.StateSpace(Ad, Bd, C, Dd, step, inputs=inputs, outputs=list(model.outputs))
