"""What the batch estimate returns: deflection on the servo clock, and how well it is known.

What the mode does not explain (hysteresis, hardening, forces from outside), the remainder e of the deflection, is the
response of the mode to an unknown force f, a Gauss-Markov process whose size follows by maximum likelihood; the spring
keeps e from being an integral of the gyro's errors:

    e'' + 2 zeta wn e' + wn² e = f,   f' = -f / tau + noise        z_g = e' + b,   z_a = c e''
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from scipy.signal import butter, lfilter, sosfiltfilt

from pinotwin.arrays import Floats
from pinotwin.errors import DataError, require
from pinotwin.imu import rotation as rot
from pinotwin.imu.clock import ClockFit
from pinotwin.imu.filters import high_passed
from pinotwin.imu.kalman import LinearModel
from pinotwin.imu.predict import Layout, RunModel
from pinotwin.imu.runs import interpolate
from pinotwin.imu.whiten import Whitener


@dataclass(frozen=True)
class Remainder:
    """The remainder at the sensor's times."""

    t: Floats  # reference time [s], (m,)
    x: Floats  # e, e', e'' [rad, rad/s, rad/s²], (m, 3)
    sd: Floats  # their standard deviations, (m, 3)
    seen_t: Floats  # reference times of the samples themselves [s], (k,)
    seen_rate: Floats  # what the fitted model leaves of the gyro, in the link frame [rad/s], (k, 3)


def remainder(m: RunModel, theta: Floats, lay: Layout, R_ST: Floats, whitener: Whitener) -> Remainder:
    """Return the smoothed remainder of one run for fitted parameters."""
    seen_t, seen_rate, z, r = _observations(m, theta, lay, R_ST, whitener)
    t, z, r = _filled(m.interval, seen_t, z, r)
    wn, zeta = np.exp(theta[lay["mode"]])
    sizes = wn**2 * np.geomspace(1e-8, 3e-4, 11)
    models = [_model(len(t), m.interval, wn, zeta, size) for size in sizes]
    scores = [model.log_likelihood(z, r) for model in models]
    best = models[int(np.argmax(np.nan_to_num(scores, nan=-np.inf)))]
    x, P = best.smooth(z, r)
    out = np.stack([*np.eye(4)[:2], best.H[0, 1]])
    var = np.einsum("ai,nij,aj->na", out, P, out)
    return Remainder(t, x @ out.T, np.sqrt(np.maximum(var, 0.0)), seen_t, seen_rate)


def _observations(
    m: RunModel, theta: Floats, lay: Layout, R_ST: Floats, whitener: Whitener
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return times, gyro residuals in the link frame, and e' + b and e'' as seen, with their variances."""
    e = m.read - m.predict(theta, lay, R_ST)[0]
    # innovations through the autoregression
    gains = [np.sum(lfilter([1.0], taps, np.eye(1, 400)[0]) ** 2) for taps in whitener.taps]
    variance = whitener.sigma**2 * np.array(gains)
    R = rot.to_matrix(rot.exp(theta[lay["turn"]])) @ R_ST
    clock = theta[lay["clock"]]
    t = m.base + clock[0] + clock[1] * m.centred - m.delay
    at = (t - m.fine.t[0]) / m.fine.step
    axis, _ = interpolate(m.fine.axis, at)
    arm, _ = interpolate(m.fine.arm, at)
    lever = np.cross(axis, arm + theta[lay["position"]]) @ R.T
    axis = axis @ R.T
    z, r = np.empty((len(t), 2)), np.empty((len(t), 2))
    for k, (rows, v) in enumerate(((axis, variance[:3]), (lever, variance[3:]))):
        information = np.maximum(np.sum(rows**2 / v, axis=1), 1e-12)
        z[:, k] = np.sum(rows * e[:, 3 * k : 3 * k + 3] / v, axis=1) / information
        r[:, k] = 1.0 / information
    return t, e[:, :3] @ R, z - np.median(z, axis=0), r


def _filled(interval: float, t: Floats, z: Floats, r: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the same on an unbroken clock: the variance of missing samples is infinite, the smoother bridges them."""
    at = np.concatenate([[0], np.cumsum(np.maximum(1, np.round(np.diff(t) / interval)))]).astype(int)
    n = at[-1] + 1
    times = np.interp(np.arange(n), at, t)
    full, variance = np.zeros((n, z.shape[1])), np.full((n, z.shape[1]), np.inf)
    full[at], variance[at] = z, r
    return times, full, variance


def _model(n: int, interval: float, wn: float, zeta: float, size: float) -> LinearModel:
    """Return the state-space model of (e, e', f, b) over n samples, measured e' + b and e''."""
    A = np.zeros((4, 4))
    A[0, 1], A[1, :3], A[2, 2] = 1.0, [-(wn**2), -2.0 * zeta * wn, 1.0], -wn
    noise = np.diag([0.0, 0.0, 2.0 * wn * size**2, (1e-5) ** 2])
    van_loan = expm(np.block([[-A, noise], [np.zeros((4, 4)), A.T]]) * interval)
    Phi = van_loan[4:, 4:].T
    P0 = np.diag([(size / wn**2) ** 2, (size / wn) ** 2, size**2, (2e-4) ** 2])
    Q = Phi @ van_loan[:4, 4:]
    C = np.stack([[0.0, 1.0, 0.0, 1.0], A[1]])
    return LinearModel(Phi[None], np.zeros((n - 1, 4)), Q[None], C[None], np.zeros(4), P0)


@dataclass(frozen=True)
class RunResult:
    """One run; arrays on the servo clock, (n,), SI."""

    t: Floats  # servo clock [s]
    angle: Floats  # deflection [rad], its quasi-static part under the load included
    velocity: Floats  # [rad/s]
    acceleration: Floats  # [rad/s²]
    sd_angle: Floats  # standard deviation of the angle in the dynamic band (above 0.5 Hz) [rad]
    sd_velocity: Floats  # [rad/s]
    sd_acceleration: Floats  # [rad/s²]
    quasi_static_sd: float  # standard deviation of the angle's slow part, its mean removed [rad]
    quasi_static: float  # RMS of that slow part [rad]
    clock: ClockFit  # the clock fit after the batch
    scale: Floats  # gyro scale deviations of the run, (3,)
    scale_se: Floats  # their standard errors
    bias: Floats  # gyro bias at the knots [rad/s], (knots, 3)
    remainder: float  # RMS of the deflection that the mode does not explain [rad]
    # rates about the two axes across the joint's [rad/s], (n, 2), up to 50 Hz; the near side of the joint
    # is taken not to rotate. Where it is stiff, they are gyro noise
    parasitic: Floats

    @property
    def dynamic(self) -> Floats:
        """The angle above 0.5 Hz [rad], (n,)."""
        return high_passed(self.t, self.angle)

    def verdict(self) -> str:
        """Return in words what is known of the slow angle; never one number for both bands."""
        sd, size = np.degrees(self.quasi_static_sd), np.degrees(self.quasi_static)
        if 2.0 * sd > size:
            return f"quasi-static: not observable, ± {2.0 * sd:.2g} deg"
        return f"quasi-static: {size:.2g} deg RMS ± {2.0 * sd:.2g} deg"


@dataclass(frozen=True)
class BatchResult:
    """All runs and what they share."""

    runs: tuple[RunResult, ...]  # one result per run
    R_ST: Floats  # mounting, link to sensor, (3, 3)
    R_ST_cov: Floats  # covariance of its rotation vector [rad²]
    theta: Floats  # shared parameters, in the order of layout
    se: Floats  # their standard errors
    layout: Layout = field(repr=False)

    def shared(self, name: str) -> tuple[Floats, Floats]:
        """Return a group of shared parameters and their standard errors, e.g. "position"."""
        names = [n for n, s in self.layout.at.items() if s.start < self.layout.shared]
        require(name, names, "no shared parameter", DataError)
        return self.theta[self.layout[name]], self.se[self.layout[name]]

    @property
    def frequency(self) -> tuple[float, float]:
        """Natural frequency with the motors held and its standard error [Hz]."""
        f = float(np.exp(self.theta[0]) / (2.0 * np.pi))
        return f, f * float(self.se[0])

    @property
    def damping(self) -> tuple[float, float]:
        """Damping ratio and its standard error."""
        zeta = float(np.exp(self.theta[1]))
        return zeta, zeta * float(self.se[1])

    @property
    def seen(self) -> tuple[float, float]:
        """RMS of the deflection's velocity and of its standard deviation, all runs [rad/s]."""
        pairs = [(np.mean(r.velocity**2), np.mean(r.sd_velocity**2)) for r in self.runs]
        speed, sd = np.sqrt(np.mean(pairs, axis=0))
        return float(speed), float(sd)

    @property
    def R_GM_up(self) -> Floats:
        """Upward in the machine frame, (3,); about the joint's axis it contains the mean deflection's error too."""
        g = self.theta[self.layout["gravity"]]
        return -g / np.linalg.norm(g)


def run_result(
    m: RunModel, theta: Floats, cov: Floats, lay: Layout, clock: ClockFit, left: Remainder
) -> RunResult:
    """Return one run's result from its parameters, their covariance and the remainder."""
    rows = slice(None, None, m.fine.factor)
    t = m.fine.t[rows]
    columns = m.columns(theta, lay)
    extra, extra_sd = _on_clock(t, left)
    C = cov[np.ix_(lay.places, lay.places)]
    x, v, a = (c[rows] for c in columns)
    y = np.stack([c @ m.weights(theta, lay) for c in (x, v, a)], axis=1) + extra
    fast = high_passed(t, x)
    slow = x - x.mean(axis=0) - fast
    slow_angle = y[:, 0] - np.mean(y[:, 0]) - high_passed(t, y[:, 0])

    def sd(J: Floats, k: int) -> Floats:
        variance = np.einsum("ni,ij,nj->n", J, C, J)
        return np.sqrt(np.maximum(variance, 0.0) + extra_sd[:, k] ** 2)

    quasi = float(np.sqrt(np.mean(np.maximum(np.einsum("ni,ij,nj->n", slow, C, slow), 0.0))))
    se = np.sqrt(np.diag(cov))
    motion = y[:, 0], y[:, 1], y[:, 2], sd(fast, 0), sd(v, 1), sd(a, 2)
    slow_sizes = quasi, float(np.std(slow_angle))
    gyro = theta[lay["scale"]], se[lay["scale"]], theta[lay["bias"]].reshape(-1, 3)
    refined = _refined(m, theta, cov, lay, clock)
    unexplained = float(np.std(left.x[:, 0])), _parasitic(m, t, left)
    return RunResult(t, *motion, *slow_sizes, refined, *gyro, *unexplained)


def _parasitic(m: RunModel, t: Floats, left: Remainder) -> Floats:
    """Return the rates across the joint's axis on the servo clock, (n, 2)."""
    at = (left.seen_t - m.fine.t[0]) / m.fine.step
    R, axis = interpolate(m.fine.R, at)[0], interpolate(m.fine.axis, at)[0]
    frame = joint_frame(np.mean(np.einsum("nij,nj->ni", R, axis), axis=0))
    across = np.einsum("nij,nj->ni", R, left.seen_rate) @ frame[:, 1:]
    values = np.stack([np.interp(t, left.seen_t, c) for c in across.T], axis=1)
    sos = butter(2, 50.0, fs=1.0 / float(t[1] - t[0]), output="sos")
    return sosfiltfilt(sos, values, axis=0)


def joint_frame(axis: Floats) -> Floats:
    """Return a right-handed frame (columns) whose first axis is ``axis``."""
    x = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    helper = np.eye(3)[int(np.argmin(np.abs(x)))]
    y = np.cross(helper, x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _on_clock(t: Floats, left: Remainder) -> tuple[Floats, Floats]:
    """Return the remainder and its standard deviation at times t; zero outside the record."""
    inside = (t >= left.t[0]) & (t <= left.t[-1])
    increasing = np.concatenate([[True], np.diff(left.t) > 0])
    values = CubicSpline(left.t[increasing], left.x[increasing])(t)
    sd = np.stack([np.interp(t, left.t, c) for c in left.sd.T], axis=1)
    return np.where(inside[:, None], values, 0.0), sd


def _refined(m: RunModel, theta: Floats, cov: Floats, lay: Layout, clock: ClockFit) -> ClockFit:
    """Return the clock with the batch's corrections; the errors are the batch's."""
    shift, stretch = theta[lay["clock"]]
    C = cov[lay["clock"], lay["clock"]]
    skew = (1.0 + clock.skew) * (1.0 + stretch) - 1.0
    segments = []
    for s in clock.segments:
        at = s.at_pivot + shift + stretch * (s.at_pivot - m.pivot)
        d = s.at_pivot - m.pivot
        se = float(np.sqrt(max(C[0, 0] + 2 * d * C[0, 1] + d**2 * C[1, 1], 0.0)))
        segments.append(replace(s, at_pivot=at, se=float(np.hypot(se, m.priors.gyro_delay_sd))))
    return replace(clock, skew=skew, se_skew=float(np.sqrt(C[1, 1])), segments=tuple(segments))
