"""A virtual IMU: what a gyroscope and an accelerometer on a moving link would report.

Measured by a triad with mounting R (sensor axes in the link frame) at p in the link frame:

    gyro   y = low_pass[ (I + diag(s)) N R' w + a |.| + c (.)^3 + G f ] + b(t) + noise       [rad/s]
    accel  y = low_pass[ (I + diag(s)) N R' f ] + b + noise                                  [m/s²]
    f      = R_world_link' (a_origin - g) + w' x p + w x (w x p)           (specific force at p)

``N``: I plus non-orthogonality, ``b(t)``: a constant plus a random walk; sizes of thesis Tables 6-3, 6-4 and B-1
(Xsens MTi-630). A sample of time ``t`` is stamped ``tau``, ``t = (1 + skew) tau + offset``, plus jitter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, cont2discrete, lfilter, lfilter_zi

from pinotwin.arrays import Floats
from pinotwin.errors import DataError

GRAVITY = np.array([0.0, 0.0, -9.81])
_DEG = np.pi / 180.0
_zeros = partial(np.zeros, 3)


@dataclass(frozen=True)
class Triad:
    """Errors of three sensing axes; SI (rad/s for a gyro, m/s² for an accelerometer)."""

    noise: Floats = field(default_factory=_zeros)  # RMS at the output, after the low-pass, per axis
    bias: Floats = field(default_factory=_zeros)  # constant bias, per axis
    bias_walk: float = 0.0  # random walk of the bias [unit/sqrt(s)]
    scale: Floats = field(default_factory=_zeros)  # scale-factor deviations, per axis [-]
    # N less I, (3, 3) [rad]; symmetric, or it turns the mounting
    nonorthogonality: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    asymmetry: Floats = field(default_factory=_zeros)  # coefficient of abs(input), per axis [-]
    cubic: Floats = field(default_factory=_zeros)  # coefficient of input cubed, per axis [1/unit²]
    # response to specific force, (3, 3) [unit/(m/s²)]; gyros only
    g_sensitivity: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    cutoff: float = np.inf  # corner of the second-order Butterworth low-pass [Hz], inf for none

    @property
    def delay(self) -> float:
        """Group delay of the low-pass at low frequency [s]: sqrt(2) / (2 pi cutoff)."""
        return float(np.sqrt(2.0) / (2.0 * np.pi * self.cutoff))

    def distort(self, x: Floats, force: Floats) -> Floats:
        """Return the deterministic response to inputs in sensor axes, shapes (n, 3)."""
        y = x @ ((np.eye(3) + np.diag(self.scale)) @ (np.eye(3) + self.nonorthogonality)).T
        return y + self.asymmetry * np.abs(x) + self.cubic * x**3 + force @ self.g_sensitivity.T


@dataclass(frozen=True)
class SensorClock:
    """The clock of a sensor and what it loses."""

    rate: float = 400.0  # nominal sampling rate [Hz]
    offset: float = 0.0  # true time at stamp zero [s]
    skew: float = 0.0  # relative error of its second, (true - stamped) / stamped [-]
    jitter: float = 0.0  # RMS of the sampling instants about their stamps [s]
    drop: float = 0.0  # share of samples lost at random
    holes: Sequence[tuple[float, float]] = ()  # stretches (start, stop) of stamps lost altogether [s]
    restart: float | None = None  # stamp at which the clock starts again at zero [s], or None


@dataclass(frozen=True)
class ImuReading:
    """What was recorded: stamps (n,) [s], gyro (n, 3) [rad/s], accelerometer (n, 3) [m/s²]."""

    t: Floats
    gyr: Floats
    acc: Floats


@dataclass(frozen=True)
class LinkMotion:
    """The true motion of a link on a fine clock."""

    t: Floats  # time, uniform [s], shape (n,)
    R: Floats  # rotation of the link in the world, (n, 3, 3); columns are the link's axes
    w: Floats  # angular velocity in the link frame [rad/s], (n, 3)
    a: Floats  # acceleration of the link's origin in the link frame, without gravity [m/s²], (n, 3)


@dataclass(frozen=True)
class ImuSensor:
    """An IMU with its errors, its mounting and its clock; see the module for the equations."""

    gyro: Triad = field(default_factory=Triad)  # errors of the gyroscope
    accel: Triad = field(default_factory=Triad)  # errors of the accelerometer
    clock: SensorClock = field(default_factory=SensorClock)  # the sensor's own clock
    mounting: Floats = field(default_factory=lambda: np.eye(3))  # sensor axes in the link frame, columns
    position: Floats = field(default_factory=_zeros)  # place of the sensor in the link frame [m], (3,)
    gravity: Floats = field(default_factory=lambda: GRAVITY)  # in the world [m/s²], (3,)

    def inputs(self, motion: LinkMotion) -> tuple[Floats, Floats]:
        """Return the true rate and specific force in sensor axes, shapes (n, 3)."""
        step = motion.t[1] - motion.t[0]
        w_dot = np.gradient(motion.w, step, axis=0, edge_order=2)
        p, w = self.position, motion.w
        force = motion.a - np.einsum("nji,j->ni", motion.R, self.gravity)
        force = force + np.cross(w_dot, p) + np.cross(w, np.cross(w, p))
        return w @ self.mounting, force @ self.mounting

    def measure(self, motion: LinkMotion, rng: np.random.Generator) -> ImuReading:
        """Return the readings for a true motion; DataError unless its clock is finer than the sensor's."""
        step = float(motion.t[1] - motion.t[0])
        if step > 0.6 / self.clock.rate:
            raise DataError(
                f"the true motion is sampled at {1 / step:.0f} Hz; a virtual IMU at "
                f"{self.clock.rate:.0f} Hz needs at least twice its rate"
            )
        w, force = self.inputs(motion)
        gyr = low_pass(self.gyro.distort(w, force), self.gyro.cutoff, step)
        acc = low_pass(self.accel.distort(force, force), self.accel.cutoff, step)
        tau, instants = self._stamps(motion.t, rng)
        gyr = CubicSpline(motion.t, gyr)(instants) + _errors(self.gyro, self.clock.rate, tau, rng)
        acc = CubicSpline(motion.t, acc)(instants) + _errors(self.accel, self.clock.rate, tau, rng)
        keep = rng.random(len(tau)) >= self.clock.drop
        for start, stop in self.clock.holes:
            keep &= (tau < start) | (tau >= stop)
        if self.clock.restart is not None:
            tau = np.where(tau >= self.clock.restart, tau - self.clock.restart, tau)
        return ImuReading(tau[keep], gyr[keep], acc[keep])

    def _stamps(self, t: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
        c = self.clock
        margin = 5.0 * c.jitter
        low, high = ((x - c.offset) / (1.0 + c.skew) for x in (t[0] + margin, t[-1] - margin))
        tau = np.arange(np.ceil(low * c.rate), np.floor(high * c.rate) + 1.0) / c.rate
        return tau, (1.0 + c.skew) * tau + c.offset + rng.normal(0.0, c.jitter, len(tau))


def low_pass(x: Floats, cutoff: float, step: float) -> Floats:
    """Return signals (n, k) after a settled second-order Butterworth low-pass, exact for straight inputs."""
    if not np.isfinite(cutoff):
        return x
    analog = butter(2, 2.0 * np.pi * cutoff, analog=True)
    b, a, _ = cont2discrete(analog, step, method="foh")
    b = b.ravel()
    return np.asarray(lfilter(b, a, x, axis=0, zi=np.outer(lfilter_zi(b, a), x[0]))[0])


def _errors(triad: Triad, rate: float, tau: Floats, rng: np.random.Generator) -> Floats:
    """Return bias and noise at the stamps, shape (n, 3)."""
    n = len(tau)
    white = rng.normal(size=(4 * n + 400, 3))
    cutoff = min(triad.cutoff, 1.6 * rate) if np.isfinite(triad.cutoff) else np.inf
    shaped = low_pass(white, cutoff, 0.25 / rate)[400::4]
    noise = triad.noise * shaped / np.std(shaped, axis=0)
    steps = rng.normal(0.0, triad.bias_walk / np.sqrt(rate), (n, 3))
    return triad.bias + np.cumsum(steps, axis=0) + noise


def mti630(rng: np.random.Generator, number: int = 1) -> ImuSensor:
    """Return an Xsens MTi-630 as in thesis Tables 6-3 (number 1) or B-1 (2), its errors drawn."""
    bias, noise, acc = {
        1: ([0.1329, 0.04537, 0.09289], [0.08493, 0.07997, 0.08274], [8.165, 7.291, 5.651]),
        2: ([-0.06855, 0.03738, 0.06225], [0.1663, 0.09148, 0.08925], [8.647, 7.331, 6.408]),
    }[number]

    def skewed() -> Floats:  # symmetric: what is antisymmetric in it is mounting
        a, b, c = rng.normal(0.0, 0.03 * _DEG, 3)
        return np.array([[0.0, a, b], [a, 0.0, c], [b, c, 0.0]])

    gyro = Triad(
        noise=np.array(noise) * _DEG,
        bias=np.array(bias) * _DEG,
        bias_walk=5e-4 * _DEG,
        scale=rng.normal(0.0, 3e-3, 3),
        nonorthogonality=skewed(),
        asymmetry=rng.normal(0, 1e-4, 3),
        cubic=rng.normal(0, 3e-5, 3),
        g_sensitivity=rng.normal(0, 1e-3 * _DEG / 9.81, (3, 3)),
        cutoff=140.0,
    )
    accel = Triad(
        noise=np.array(acc) * 1e-3,
        bias=rng.normal(0.0, 0.02, 3),
        scale=rng.normal(0, 1e-3, 3),
        nonorthogonality=skewed(),
        cutoff=140.0,
    )
    return ImuSensor(gyro=gyro, accel=accel)
