"""A controller around a rigid plant, M v' + B v = u - d: the closed loop, as a :class:`LoopModel`, and its margins."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.loop.model import LoopModel
from pinotwin.loop.servo import Servo
from pinotwin.loop.structure import Section, Structure


def close(servo: Servo, inertia: float, viscous: float = 0.0, *, axis: str = "axis") -> LoopModel:
    """Return the loop of a controller around M [kg or kg·m²] and B [N·s/m or N·m·s/rad]; DataError if unstable."""
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
    residues = np.column_stack([residues, D])
    return LoopModel(axis, ("d",), ("e", "u"), servo.step, structure, sections, residues)


def closed(
    law: tuple[Floats, Floats, Floats, Floats], inertia: float, viscous: float, dead: float = 0.0
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return A, B, C, D of the loop: inputs d, vr; outputs e, u; direct terms of vr, ar; dead time by Padé."""
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
        columns += [(outputs[:, i] * inputs[i, w]).real / -values[i].real for i in real]
        for i in pairs:
            residue, wn = outputs[:, i] * inputs[i, w], math.hypot(values[i].real, values[i].imag)
            columns.append(-2.0 * (residue * np.conj(values[i])).real / wn**2)
            columns.append(2.0 * residue.real / wn)
    return tuple(sections), np.stack(columns, axis=1)


@dataclass(frozen=True)
class Margins:
    """Stability margins of one axis."""

    gain: float  # factor by which all feedback gains may grow; infinite if none makes it unstable
    phase: float  # at the crossover [deg]
    delay: float  # further dead time that the loop bears [s]
    crossover: float  # highest frequency at which the loop has gain 1 [Hz]
    peak: float  # largest sensitivity |1 / (1 + L)|; 2 is a usual limit


def _asked(servo: Servo, s: NDArray[np.complexfloating]) -> NDArray[np.complexfloating]:
    """Return what acts on the axis for each of e, v, vr and ar, dead time included, at 2 pi i f, shape (4, n)."""
    A, B, C, D = servo.matrices()
    states = np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(s), *B.shape)))
    return np.asarray((C @ states + D)[:, 0].T * np.exp(-s * servo.dead))


def open_loop(servo: Servo, inertia: float, viscous: float, f: Floats) -> Floats:
    """Return L(2 pi i f): controller, dead time and the rigid axis M s² + B s, complex, shape like f."""
    s = 2j * np.pi * f
    e, v, *_ = _asked(servo, s)
    return np.asarray((e - s * v) / (inertia * s**2 + viscous * s))


def command_peak(servo: Servo, inertia: float, viscous: float, f: Floats) -> float:
    """Return the largest tracking error for a command of size 1 at some frequencies [Hz], friction left out."""
    s = 2j * np.pi * f
    e, v, vr, ar = _asked(servo, s)
    moves = (e + s * vr + s**2 * ar) / (inertia * s**2 + viscous * s + e - s * v)
    return float(np.max(np.abs(1.0 - moves)))


def stable(servo: Servo, inertia: float, viscous: float = 0.0) -> bool:
    """Whether the loop of a controller and a rigid axis is stable: whether all its poles decay."""
    A = closed(servo.matrices(), inertia, viscous, servo.dead)[0]
    return bool(np.isfinite(A).all() and np.max(np.linalg.eigvals(A).real) < 0.0)


def margins(
    servo: Servo, inertia: float, viscous: float = 0.0, band: tuple[float, float, int] = (0.05, 2000.0, 4000)
) -> Margins:
    """Return the stability margins of a controller around a rigid axis.

    Args:
        servo: the controller, as identified or with other gains (``servo.scaled(all=1.3)``).
        inertia: M of the axis, ``twin.diagonal["inertia"]`` [kg or kg·m²].
        viscous: B of the axis [N·s/m or N·m·s/rad].
        band: lowest and highest frequency [Hz] at which the loop is looked at, and at how many.
    """
    f = np.geomspace(*band)
    L = open_loop(servo, inertia, viscous, f)
    size = np.abs(L)
    above = np.flatnonzero(size >= 1.0)
    if len(above) == 0 or above[-1] + 1 == len(f):
        return Margins(np.inf, np.nan, np.nan, np.nan, float(np.max(1.0 / np.abs(1.0 + L))))
    k = int(above[-1])
    phase = float(np.degrees(np.angle(-L[k])))
    ahead = np.angle(-L[k:])
    crossings = np.flatnonzero((ahead[:-1] > 0.0) & (ahead[1:] <= 0.0) & (ahead[:-1] - ahead[1:] < 1.0))
    gain = float(1.0 / size[k + crossings[0]]) if len(crossings) else np.inf
    delay = np.radians(phase) / (2.0 * np.pi * f[k])
    return Margins(gain, phase, float(delay), float(f[k]), float(np.max(1.0 / np.abs(1.0 + L))))
