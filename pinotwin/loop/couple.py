"""The closed loop that a named controller makes with a rigid plant: what if a gain were another?

    M v' + B v = u - d,     e' = vr - v

The result is the same :class:`LoopModel` as the black box, so that the two can be compared on
held-out data and simulated by the same code.
"""

from __future__ import annotations

import math

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.loop.model import LoopModel
from pinotwin.loop.servo import Servo
from pinotwin.loop.structure import Section, Structure


def close(servo: Servo, inertia: float, viscous: float = 0.0, *, axis: str = "axis") -> LoopModel:
    """Return the closed loop of an identified controller and a rigid plant: poles, residues, u - d = M a + B v.

    Args:
        servo: the controller.
        inertia: M [kg or kg·m²].
        viscous: B [N·s/m or N·m·s/rad].
        axis: name of the axis.

    Raises:
        DataError: the loop is unstable.
    """
    A, B, C, D = closed(servo.matrices(), inertia, viscous, servo.dead)
    values, right = np.linalg.eig(A)
    if np.max(values.real) >= 0.0:
        worst = values[np.argmax(values.real)]
        raise DataError(
            f"{axis}: with these gains the loop is unstable (a pole at {worst:.3g} rad/s); lower them"
        )
    left = np.linalg.solve(right, B)
    sections, residues = _sections(values, C @ right, left)
    pairs = sum(s.order == 2 for s in sections)
    structure = Structure(len(sections) - pairs, pairs, feedforward_poles=())
    return LoopModel(
        axis,
        ("d",),
        ("e", "u"),
        servo.step,
        structure,
        sections,
        np.column_stack([residues, D]),
    )


def closed(
    law: tuple[Floats, Floats, Floats, Floats], inertia: float, viscous: float, dead: float = 0.0
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return A, B, C, D of the loop: inputs d, vr; outputs e, u; direct terms of vr, ar.

    The dead time between u and the effort that acts is a Padé approximation of second order.
    """
    Ac, Bc, Cc, Dc = law
    nc = len(Ac)
    n = nc + 2 + (2 if dead > 0.0 else 0)
    A, B = np.zeros((n, n)), np.zeros((n, 3))  # states e, v, the controller's, Padé's; inputs d, vr, ar
    u, through = np.zeros(n), np.zeros(3)
    u[:2], u[2 : 2 + nc] = Dc[0, :2], Cc[0]
    through[1:] = Dc[0, 2:]
    A[0, 1], B[0, 1] = -1.0, 1.0
    A[2 : 2 + nc, :2], A[2 : 2 + nc, 2 : 2 + nc], B[2 : 2 + nc, 1:] = Bc[:, :2], Ac, Bc[:, 2:]
    acts, acts_through = u.copy(), through.copy()
    if dead > 0.0:
        A[-2, -1], A[-1, -2], A[-1, -1] = 1.0, -12.0 / dead**2, -6.0 / dead
        A[-1], B[-1] = A[-1] + u, B[-1] + through
        acts[-1] -= 12.0 / dead
    A[1], B[1] = acts / inertia, acts_through / inertia
    A[1, 1] -= viscous / inertia
    B[1, 0] -= 1.0 / inertia
    C = np.stack([np.eye(n)[0], u])
    # x' = A x + b vr + c vr' becomes z' = A z + (b + A c) vr with x = z + c vr.
    jump = B[:, 2]
    D = np.array([[C[0] @ jump, 0.0], [through[1] + C[1] @ jump, through[2]]])
    return A, np.column_stack([B[:, 0], B[:, 1] + A @ jump]), C, D


def _sections(values: Floats, outputs: Floats, inputs: Floats) -> tuple[tuple[Section, ...], Floats]:
    """Return sections and residues (2, nc) of the modes; reals first, pairs by frequency."""
    scale = np.abs(values)
    real = [i for i in np.argsort(scale) if abs(values[i].imag) <= 1e-9 * scale[i]]
    pairs = [i for i in np.argsort(scale) if values[i].imag > 1e-9 * scale[i]]
    sections = [Section(f"p{j + 1}", 1, (-values[i].real,)) for j, i in enumerate(real)]
    for j, i in enumerate(pairs):
        wn = float(abs(values[i]))
        sections.append(Section(f"wn{j + 1}", 2, (wn, float(-values[i].real / wn))))
    columns = []
    for w in range(inputs.shape[1]):
        for i in real:
            columns.append((outputs[:, i] * inputs[i, w]).real / -values[i].real)
        for i in pairs:
            residue, wn = outputs[:, i] * inputs[i, w], math.hypot(values[i].real, values[i].imag)
            columns.append(-2.0 * (residue * np.conj(values[i])).real / wn**2)
            columns.append(2.0 * residue.real / wn)
    return tuple(sections), np.stack(columns, axis=1)
