"""Two clocks: when did the machine's log see what the IMU saw?

    t_ref = (1 + skew) t_imu + offset

Coarse: normalised cross-correlation of the rates' magnitudes, the same in every frame (thesis Section 6.4.1), over
the overlap alone (Padfield 2012, DOI 10.1109/TIP.2011.2181402). Fine: Gauss-Newton in offset, skew, A and b on
``y(t) = A r(t_ref(t)) + b + noise``, both low-passed alike; A is 3x3 (mounting, scale factors), of magnitudes a number.
``delay`` is the group delay of a sensor's low-pass. After a restart a stretch has its own offset; all share the skew.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import DataError
from pinotwin.signals import joined
from pinotwin.solve.sandwich import sandwich


@dataclass(frozen=True)
class ClockSegment:
    """One unbroken stretch of the IMU's clock."""

    rows: slice
    pivot: float  # a stamp within it [s]
    at_pivot: float  # reference time there [s]
    se: float  # its standard error [s]


@dataclass(frozen=True)
class ClockFit:
    """How the IMU's clock relates to the reference: t_ref = (1 + skew) t_imu + offset."""

    skew: float  # relative rate deviation [-]
    se_skew: float  # standard error of the skew [-]
    segments: tuple[ClockSegment, ...] = field(repr=False)  # the stretches that could be placed, in order
    size: int  # number of IMU samples

    @property
    def main(self) -> ClockSegment:
        """The longest stretch."""
        return max(self.segments, key=lambda g: g.rows.stop - g.rows.start)

    @property
    def offset(self) -> float:
        """Reference time at stamp zero of the longest stretch [s]."""
        return self.main.at_pivot - (1.0 + self.skew) * self.main.pivot

    @property
    def se_offset(self) -> float:
        """Standard error of the offset [s]."""
        return float(np.hypot(self.main.se, self.main.pivot * self.se_skew))

    def to_ref(self, t_imu: Floats) -> Floats:
        """Return reference times of all stamps, (n,); NaN on stretches that could not be placed."""
        t = np.full(len(t_imu), np.nan)
        if len(t_imu) != self.size:
            raise DataError(f"this clock was fitted on {self.size} stamps, not {len(t_imu)}")
        for s in self.segments:
            t[s.rows] = s.at_pivot + (1.0 + self.skew) * (np.asarray(t_imu)[s.rows] - s.pivot)
        return t


@dataclass(frozen=True)
class SyncSettings:
    """How to synchronise."""

    delay: float = 0.0  # group delay of the sensor's own filter [s]
    smoothing: float = 0.02  # standard deviation in time of the low-pass on both signals [s]
    skew: float = 2e-4  # prior standard deviation of the skew [-]
    minimum: float = 0.01  # RMS variation of rate that counts as a rotation [rad/s]
    agreement: float = 0.6  # least correlation coefficient of the coarse step
    least: int = 50  # samples between two restarts of a clock that can be matched


def sync(
    t_ref: Floats, rate_ref: Floats, t_imu: Floats, rate_imu: Floats, settings: SyncSettings | None = None
) -> ClockFit:
    """Return the relation of two clocks from angular rates that both saw; DataError if they show none.

    ``t_ref`` [s], (n,), is uniform, ``rate_ref`` [rad/s], (n, 3), in a frame of the link; ``t_imu`` [s], (m,), may lack
    samples, ``rate_imu`` [rad/s], (m, 3), is the gyro's reading; of both rates the magnitudes will do.
    """
    s = SyncSettings() if settings is None else settings
    t_ref, r, t_imu, y = _checked(t_ref, rate_ref, t_imu, rate_imu, s)
    step = float(np.median(np.diff(t_imu)))
    parts = [rows for rows in joined(t_imu) if rows.stop - rows.start >= s.least]
    found = [(rows, _coarse(t_ref, r, t_imu[rows], y[rows], step, s)) for rows in parts]
    placed = [(rows, shift) for rows, shift in found if shift is not None]
    if not placed:
        raise DataError(
            "the IMU's angular rate does not match the encoders' anywhere (no common rotation); "
            "check that both logs are of the same run and that the IMU sits on a rotating link"
        )
    if 1 in (r.shape[1], y.shape[1]):
        r, y = (np.linalg.norm(x, axis=1, keepdims=True) for x in (r, y))
    pivots, x, cov = _fine(t_ref, r, t_imu, y, placed, s)
    wider = _fine(t_ref, r, t_imu, y, placed, replace(s, smoothing=1.5 * s.smoothing))[1]
    # What a stronger low-pass changes is added to the standard errors.
    se = np.sqrt(np.maximum(np.diag(cov), 0.0) + (2.0 * (x - wider)) ** 2)
    segments = tuple(
        ClockSegment(rows, float(p), float(at), float(e))
        for (rows, _), p, at, e in zip(placed, pivots, x, se, strict=False)
    )
    return ClockFit(float(x[-1]), float(se[-1]), segments, len(t_imu))


def _checked(
    t_ref: Floats, rate_ref: Floats, t_imu: Floats, rate_imu: Floats, s: SyncSettings
) -> tuple[Floats, Floats, Floats, Floats]:
    arrays = [np.asarray(x, dtype=float) for x in (t_ref, rate_ref, t_imu, rate_imu)]
    t_ref, r, t_imu, y = arrays
    if any(not np.isfinite(x).all() for x in arrays):
        raise DataError("times or angular rates hold NaN or infinity; drop those samples first")
    if len(t_ref) != len(r) or len(t_imu) != len(y) or min(len(r), len(y)) < s.least:
        raise DataError(f"a clock fit needs at least {s.least} samples each, as many times as rates")
    if np.any(np.diff(t_ref) <= 0.0):
        raise DataError("the reference clock does not increase; sort or split that log first")
    r, y = (x[:, None] if x.ndim == 1 else x for x in (r, y))
    for x, who in ((r, "the encoders'"), (y, "the IMU's")):
        variation = np.std(np.linalg.norm(x, axis=1))
        if variation < s.minimum:
            raise DataError(
                f"{who} angular rate varies by {np.degrees(variation):.2g} deg/s only: nothing "
                "rotates, so the clocks cannot be matched; move a rotary axis in the log"
            )
    return t_ref, r, t_imu, y


def _coarse(t_ref: Floats, r: Floats, t: Floats, y: Floats, step: float, s: SyncSettings) -> float | None:
    """Return t_ref - t_imu, or None where nothing agrees."""
    a = np.interp(np.arange(t_ref[0], t_ref[-1], step), t_ref, np.linalg.norm(r, axis=1))
    b = np.interp(np.arange(t[0], t[-1], step), t, np.linalg.norm(y, axis=1))
    if np.std(b) < s.minimum:
        return None
    lag, score = best_lag(a, b)
    return float(t_ref[0] - t[0] + lag * step) if score >= s.agreement else None


def best_lag(a: Floats, b: Floats) -> tuple[float, float]:
    """Return by how many samples ``b`` begins after ``a`` and the coefficient; short or still overlaps do not count."""
    size = 1 << int(np.ceil(np.log2(len(a) + len(b))))
    A, A2, ones_a = (np.fft.rfft(x, size) for x in (a, a * a, np.ones_like(a)))
    B, B2, ones_b = (np.conj(np.fft.rfft(x, size)) for x in (b, b * b, np.ones_like(b)))
    n, sa, sb, ab, aa, bb = (
        np.fft.irfft(x, size)
        for x in (ones_a * ones_b, A * ones_b, ones_a * B, A * B, A2 * ones_b, ones_a * B2)
    )
    n = np.maximum(n, 1e-9)
    va, vb = np.maximum(aa - sa**2 / n, 0.0), np.maximum(bb - sb**2 / n, 0.0)
    shorter = min(len(a), len(b))
    enough = (n > 0.5 * shorter) & (vb > 0.1 * np.max(vb)) & (va > 1e-3 * np.max(va))
    score = np.where(enough, (ab - sa * sb / n) / np.sqrt(np.maximum(va * vb, 1e-12)), -1.0)
    # a lag that fits only where little overlaps must not beat the full overlap
    k = int(np.argmax(score * np.sqrt(np.minimum(n / shorter, 1.0))))
    left, mid, right = score[k - 1], score[k], score[(k + 1) % size]
    curve = left - 2.0 * mid + right
    part = 0.5 * (left - right) / curve if curve < 0.0 and min(left, right) > -1.0 else 0.0
    return float((k if k < len(a) else k - size) + part), float(mid)


def _smoothed(t: Floats, x: Floats, smoothing: float) -> tuple[Floats, Floats, Mask]:
    """Return a uniform grid, the low-passed signal on it, and where no hole or end is near."""
    step = float(np.median(np.diff(t)))
    grid = t[0] + step * np.arange(round((t[-1] - t[0]) / step) + 1)
    values = np.stack([np.interp(grid, t, c) for c in x.T], axis=1)
    nearest_sample = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    gap = t[nearest_sample] - t[nearest_sample - 1]
    width = max(smoothing / step, 1e-3)
    bad = gaussian_filter1d((gap > 2.5 * step).astype(float), width, mode="constant", cval=1.0)
    return grid, gaussian_filter1d(values, width, axis=0, mode="nearest"), bad < 1e-3


def _fine(
    t_ref: Floats, r: Floats, t_imu: Floats, y: Floats, placed: list[tuple[slice, float]], s: SyncSettings
) -> tuple[Floats, Floats, Floats]:
    """Return pivots, t_ref there and skew, and their covariance, by Gauss-Newton with linear gains."""
    grid, smooth, _ = _smoothed(t_ref, r, s.smoothing)
    spline = CubicSpline(grid, smooth)
    parts = [_smoothed(t_imu[rows], y[rows], s.smoothing) for rows, _ in placed]
    pivots = np.array([0.5 * (p[0][0] + p[0][-1]) for p in parts])
    # a filter's delay makes a sample show the past: compare at t_ref - delay
    x = np.array([pivot + shift for pivot, (_, shift) in zip(pivots, placed, strict=True)] + [0.0])
    for _ in range(12):
        J, e, scores = _linearised(spline, grid, parts, pivots, x, s)
        precision = np.zeros(len(x))
        precision[-1] = (np.median(np.abs(e)) / 0.6745) ** 2 / s.skew**2
        A = J.T @ J + np.diag(precision)
        dx = np.linalg.solve(A, J.T @ e - precision * x)
        x = x + dx
        if np.max(np.abs(dx)) < 1e-9:
            break
    lag = max(1, round(max(0.25, 4.0 * s.smoothing) / float(np.median(np.diff(t_imu)))))
    return pivots, x, sandwich(scores, A, lag)


def _linearised(
    spline: CubicSpline,
    grid: Floats,
    parts: list[tuple[Floats, Floats, Mask]],
    pivots: Floats,
    x: Floats,
    s: SyncSettings,
) -> tuple[Floats, Floats, Floats]:
    """Return the Jacobian and residual with gains projected out, and scores per sample."""
    rows = []
    for i, (t, y, good) in enumerate(parts):
        at = x[i] + (1.0 + x[-1]) * (t - pivots[i]) - s.delay
        use = good & (at > grid[0] + 3 * s.smoothing) & (at < grid[-1] - 3 * s.smoothing)
        if y.shape[1] == 1:  # a magnitude near zero is rectified noise
            use &= y[:, 0] > s.minimum
        at, since = at[use], t[use] - pivots[i]
        rows.append((spline(at), spline(at, 1), y[use], np.full(len(at), i), since))
    R, D, Y, k, dt = (np.concatenate(x) for x in zip(*rows, strict=True))
    X = np.hstack([R, np.ones((len(R), 1))])
    gain = np.linalg.lstsq(X, Y, rcond=None)[0]
    e = Y - X @ gain
    for _ in range(2):  # bounded influence: what a knock leaves is not a clock's doing
        size = np.linalg.norm(e, axis=1)
        w = np.minimum(1.0, 3.0 * np.median(size) / np.maximum(size, 1e-12))[:, None]
        gain = np.linalg.lstsq(X * np.sqrt(w), Y * np.sqrt(w), rcond=None)[0]
        e = Y - X @ gain
    slope = D @ gain[:-1]  # (n, channels)
    columns = [slope * (k == i)[:, None] for i in range(len(parts))] + [slope * dt[:, None]]
    root = np.sqrt(w)
    Q, _ = np.linalg.qr(X * root)
    free = [c * root - Q @ (Q.T @ (c * root)) for c in columns]
    e = e * root
    J = np.stack([c.ravel() for c in free], axis=1)
    scores = np.stack([np.sum(c * e, axis=1) for c in free], axis=1)
    return J, e.ravel(), scores
