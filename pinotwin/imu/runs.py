"""What the batch estimate takes: the machine's view of a run, the IMU's, and the priors."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from pinotwin.arrays import Floats
from pinotwin.errors import DataError

GRAVITY = np.array([0.0, 0.0, -9.81])  # acceleration of gravity in the machine frame [m/s²]


@dataclass(frozen=True)
class ServoRun:
    """One run as encoders and rigid kinematics see it, the flexible joint taken as undeflected."""

    t: Floats  # servo clock, uniform [s], (n,)
    R: Floats  # link axes in the machine frame (columns), (n, 3, 3)
    w: Floats  # angular velocity of the link in the link frame [rad/s], (n, 3)
    a: Floats  # acceleration of the link's origin in the link frame, without gravity [m/s²], (n, 3)
    axis: Floats  # direction of the flexible joint's axis in the link frame, (n, 3)
    arm: Floats  # from the joint's axis to the link's origin, in the link frame [m], (n, 3)
    # what drives the deflection, one column or several, e.g. minus the rigid-body torque at the joint
    # [N·m], (n,) or (n, k)
    load: Floats

    def __post_init__(self) -> None:
        n = len(self.t)
        shapes = {"R": (n, 3, 3), "w": (n, 3), "a": (n, 3), "axis": (n, 3), "arm": (n, 3)}
        for name, shape in shapes.items():
            x = getattr(self, name)
            if np.shape(x) != shape:
                raise DataError(f"servo array {name!r} has shape {np.shape(x)}, expected {shape}")
            if not np.isfinite(x).all():
                raise DataError(f"servo array {name!r} holds NaN or infinity")
        if len(self.load) != n or np.ndim(self.load) > 2:
            raise DataError(f"load has shape {np.shape(self.load)}, expected ({n},) or ({n}, k)")
        step = np.diff(self.t)
        if n < 20 or np.ptp(step) > 1e-3 * abs(np.mean(step)) or step[0] <= 0:
            raise DataError("the servo clock must be uniform and increasing; resample it first")


@dataclass(frozen=True)
class ImuRun:
    """One run by the IMU: stamps (m,) [s], rates (m, 3) [rad/s], specific force (m, 3) [m/s²]."""

    t: Floats
    gyr: Floats
    acc: Floats

    def __post_init__(self) -> None:
        m = len(self.t)
        if np.shape(self.gyr) != (m, 3) or np.shape(self.acc) != (m, 3):
            raise DataError(f"IMU arrays {np.shape(self.gyr)}, {np.shape(self.acc)} must be ({m}, 3) both")
        if not (np.isfinite(self.gyr).all() and np.isfinite(self.acc).all()):
            raise DataError("the IMU's readings hold NaN or infinity; drop those samples first")


@dataclass(frozen=True)
class Priors:
    """Knowledge before the fit: starting values and standard deviations, SI."""

    frequency: float = 20.0  # natural frequency of the joint with the motors held [Hz], a guess
    damping: float = 0.05  # damping ratio, a guess
    log_frequency: float = 0.3  # standard deviation of ln(frequency)
    log_damping: float = 0.7  # of ln(damping)
    position: Floats = field(default_factory=lambda: np.zeros(3))  # the sensor in the link frame [m], (3,)
    position_sd: float = 0.3  # its standard deviation
    gravity: Floats = field(default_factory=lambda: GRAVITY)  # in the machine frame [m/s²], (3,)
    gravity_sd: float = 0.6  # per component
    gyro_cutoff: float = np.inf  # corner of the gyro's second-order low-pass [Hz], inf for none
    accel_cutoff: float = np.inf  # of the accelerometer's
    gyro_delay_sd: float = 0.0  # uncertainty of the gyro's group delay [s]; it goes into the clock's error
    accel_delay: float = 1e-4  # standard deviation of a delay of the accelerometer beyond its low-pass [s]
    scale: float = 4e-3  # gyro scale deviation, per run and axis
    cross: float = 1.5e-3  # non-orthogonality of the gyro [rad]
    asymmetry: float = 2e-4  # of the gyro [-]
    cubic: float = 2e-4  # share of the rate at the largest rate [-]
    g_sensitivity: float = 1e-5  # [rad/s/(m/s²)]
    bias: float = 0.01  # [rad/s]
    bias_walk: float = 1e-5  # random walk of the bias between knots [rad/s/sqrt(s)]
    knots: float = 7.0  # spacing of the bias knots [s]
    accel_matrix: float = 3e-3  # scale and misalignment of the accelerometer [-]
    accel_bias: float = 0.05  # [m/s²]
    skew: float = 2e-4  # relative clock error [-]
    sag: float = 5e-5  # quasi-static deflection beyond the load's, for 1 g across the link [rad]


class FineRun:
    """A servo run on a fine uniform clock, with what the sensors' low-pass makes of it."""

    def __init__(self, run: ServoRun, rate: float = 1500.0) -> None:
        """Interpolate; ``rate`` is the least of the fine clock [Hz]."""
        h = float(np.mean(np.diff(run.t)))
        factor = max(1, int(np.ceil(rate * h)))
        self.factor = factor
        self.step = h / factor
        self.t = run.t[0] + self.step * np.arange((len(run.t) - 1) * factor + 1)

        def up(x: Floats) -> Floats:
            return CubicSpline(run.t, x)(self.t)

        self.load = up(np.reshape(run.load, (len(run.t), -1)))
        self.w, self.a, self.axis, self.arm = up(run.w), up(run.a), up(run.axis), up(run.arm)
        self.R = up(run.R.reshape(-1, 9)).reshape(-1, 3, 3)
        self.w_dot = np.gradient(self.w, self.step, axis=0)


def interpolate(x: Floats, at: Floats) -> tuple[Floats, Floats]:
    """Return values and slopes (per sample) of smooth samples (n, ...) at fractional indices (m,), by local cubics."""
    i = np.clip(np.floor(at).astype(np.intp), 1, len(x) - 3)
    u = (at - i).reshape(-1, *([1] * (x.ndim - 1)))
    p, q, r, s = x[i - 1], x[i], x[i + 1], x[i + 2]
    c1 = r - p / 3.0 - q / 2.0 - s / 6.0
    c2 = (p + r) / 2.0 - q
    c3 = (s - p) / 6.0 + (q - r) / 2.0
    return q + u * (c1 + u * (c2 + u * c3)), c1 + u * (2.0 * c2 + 3.0 * u * c3)
