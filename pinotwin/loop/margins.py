"""How far a controller is from instability around its axis: margins of the loop broken at the effort."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pinotwin.arrays import Floats
from pinotwin.loop.couple import closed
from pinotwin.loop.servo import Servo

BAND = (0.05, 2000.0, 4000)
"""Lowest and highest frequency [Hz] at which the loop is looked at, and at how many."""


@dataclass(frozen=True)
class Margins:
    """Stability margins of one axis.

    Attributes:
        gain: factor by which all feedback gains may grow; infinite if none makes it unstable.
        phase: at the crossover [deg].
        delay: further dead time that the loop bears [s].
        crossover: highest frequency at which the loop has gain 1 [Hz].
        peak: largest sensitivity |1 / (1 + L)|; 2 is a usual limit.
    """

    gain: float
    phase: float
    delay: float
    crossover: float
    peak: float


def open_loop(servo: Servo, inertia: float, viscous: float, f: Floats) -> Floats:
    """Return L(2 pi i f): controller, dead time and the rigid axis M s² + B s, complex, shape like f."""
    s = 2j * np.pi * f
    k_e, k_i, k_v = servo.gains[:3]
    law = k_e + k_i / s + k_v * s / (1.0 + s * servo.velocity_lag)
    return np.asarray(law * _acts(servo, s) / (inertia * s**2 + viscous * s))


def _acts(servo: Servo, s: NDArray[np.complexfloating]) -> NDArray[np.complexfloating]:
    """Return what acts on the axis of what the law asks for: notch, current loop and dead time."""
    out = np.exp(-s * servo.dead) / (1.0 + s * servo.output_lag)
    if servo.notch[0] > 0.0:
        w, zeros, poles = 2.0 * np.pi * servo.notch[0], servo.notch[1], servo.notch[2]
        out = out * (s**2 + 2.0 * zeros * w * s + w**2) / (s**2 + 2.0 * poles * w * s + w**2)
    return out


def command_peak(servo: Servo, inertia: float, viscous: float, f: Floats) -> float:
    """Return the largest tracking error for a command of size 1 at some frequencies [Hz], friction left out."""
    s = 2j * np.pi * f
    k_e, k_i, _, k_vr, k_w, k_ar = servo.gains
    asks = k_e + k_i / s + k_w + k_vr * s + k_ar * s**2
    plant = inertia * s**2 + viscous * s
    moves = asks * _acts(servo, s) / plant / (1.0 + open_loop(servo, inertia, viscous, f))
    return float(np.max(np.abs(1.0 - moves)))


def stable(servo: Servo, inertia: float, viscous: float = 0.0) -> bool:
    """Whether the loop of a controller and a rigid axis is stable: whether all its poles decay."""
    A = closed(servo.matrices(), inertia, viscous, servo.dead)[0]
    return bool(np.isfinite(A).all() and np.max(np.linalg.eigvals(A).real) < 0.0)


def margins(servo: Servo, inertia: float, viscous: float = 0.0) -> Margins:
    """Return the stability margins of a controller around a rigid axis.

    Args:
        servo: the controller, as identified or with other gains (``servo.scaled(all=1.3)``).
        inertia: M of the axis, ``twin.diagonal["inertia"]`` [kg or kg·m²].
        viscous: B of the axis [N·s/m or N·m·s/rad].
    """
    f = np.geomspace(*BAND[:2], BAND[2])
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
