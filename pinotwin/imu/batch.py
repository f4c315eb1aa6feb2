"""One estimate over servo and IMU data: gyro scale, bias, mounting, clocks and the deflection.

Nothing is integrated: the IMU has to read the encoders' rotation and the deflection, the response of a spring-mass-
damper (shared by all runs) to a known load, so its slow part is load over stiffness. All parameters have priors (MAP):
without them scale, asymmetry and sag look alike. Gauss-Newton (:mod:`pinotwin.imu.predict`) on residuals whitened by
the noise at rest; errors by leaving out stretches. The rest goes to :mod:`pinotwin.imu.result`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import DataError
from pinotwin.imu import rotation as rot
from pinotwin.imu.align import mounting_from_rates
from pinotwin.imu.clock import ClockFit
from pinotwin.imu.mode import respond
from pinotwin.imu.predict import Layout, RunModel
from pinotwin.imu.result import BatchResult, RunResult, remainder, run_result
from pinotwin.imu.runs import ImuRun, Priors, ServoRun
from pinotwin.imu.whiten import Whitener
from pinotwin.solve.sandwich import at_least, left_out

_REMEDY = (
    "move the axes that shake it with more acceleration, or check the stiffness of the passive "
    "joint and the link of the IMU (machine.yaml)"
)


@dataclass(frozen=True)
class _Problem:
    models: list[RunModel]
    lay: Layout
    R_ST: Floats
    mean: Floats  # prior means of all parameters, those of every run behind the shared ones
    sd: Floats
    whiteners: list[Whitener]

    def columns(self, r: int) -> Ints:
        """Return the places of run r's parameters in the whole vector."""
        local = self.lay.size - self.lay.shared
        own = self.lay.shared + r * local + np.arange(local)
        return np.concatenate([np.arange(self.lay.shared), own])

    def whitened(self, r: int, theta: Floats) -> tuple[Floats, Floats]:
        """Return whitened residuals (m, 6) and the Jacobian in units of the priors (m, 6, p) of run r."""
        m, at = self.models[r], self.columns(r)
        y, J = m.predict(theta[at], self.lay, self.R_ST)
        both = np.concatenate([(m.read - y)[:, :, None], J * self.sd[at]], axis=2)
        both = self.whiteners[r](both)[8:]  # the filter's own start
        return both[:, :, 0], both[:, :, 1:]


def estimate(
    servo: Sequence[ServoRun], imu: Sequence[ImuRun], p: Priors, clocks: Sequence[ClockFit]
) -> BatchResult:
    """Return the deflection of every run with all that had to be found for it; DataError where too little moves."""
    if not servo or len(servo) != len(imu):
        raise DataError(f"{len(servo)} servo runs and {len(imu)} IMU runs; they must come in pairs")
    try:
        with np.errstate(invalid="raise", over="raise", divide="raise"):
            problem = prepare(servo, imu, p, clocks)
            theta, cov = _solve(problem)
            result = _collect(problem, theta, cov, clocks)
    except (FloatingPointError, np.linalg.LinAlgError):
        raise _lost(p) from None
    speed, sd = result.seen
    if speed < sd:
        raise DataError(
            f"the joint deflects too little: {np.degrees(speed):.2g} deg/s RMS, known to "
            f"+-{np.degrees(sd):.2g} deg/s; {_REMEDY}"
        )
    return result


def _lost(p: Priors) -> DataError:
    return DataError(
        "the estimate does not converge: the IMU shows no vibration like that of a spring near "
        f"{p.frequency:.3g} Hz: the joint deflects too little, or its stiffness is far off; {_REMEDY}"
    )


def prepare(
    servo: Sequence[ServoRun], imu: Sequence[ImuRun], p: Priors, clocks: Sequence[ClockFit]
) -> _Problem:
    """Return the problem of all runs, linearised at the priors."""
    models = [RunModel(s, i, p, c.to_ref(i.t)) for s, i, c in zip(servo, imu, clocks, strict=True)]
    R_ST = _first_mounting(servo, models)
    lay = Layout(models[0].fine.load.shape[1], max(m.knots for m in models))
    whiteners = [Whitener.from_rest(m.read, 1.0 / m.interval) for m in models]
    mean, sd = _priors(p, lay, models)
    problem = _Problem(models, lay, R_ST, mean, sd, whiteners)
    return _tune_mode(problem, p)


def _first_mounting(servo: Sequence[ServoRun], models: list[RunModel]) -> Floats:
    rows = []
    for s, m in zip(servo, models, strict=True):
        said = make_interp_spline(s.t, np.hstack([s.w, s.R[:, 2]]), k=1)
        rows.append(np.hstack([said(m.base - m.delay), m.read]))
    w, up, gyr, acc = np.split(np.concatenate(rows), 4, axis=1)
    return mounting_from_rates(w, gyr, (up, acc)).R


def _priors(p: Priors, lay: Layout, models: list[RunModel]) -> tuple[Floats, Floats]:
    mean, sd = np.zeros(lay.size), np.ones(lay.size)
    wn = 2.0 * np.pi * p.frequency
    mean[lay["mode"]] = np.log([wn, p.damping])
    load = np.sqrt(np.mean([np.mean(m.fine.load**2, axis=0) for m in models], axis=0))
    sizes = {
        "mode": [p.log_frequency, p.log_damping],
        "gain": 0.02 * wn**2 / np.maximum(load, 1e-12),
        "turn": 0.1,
        "position": p.position_sd,
        "gravity": p.gravity_sd,
        "clock": [2e-3, p.skew],
        "start": [2e-4, 2e-2],
    }
    for name, where in lay.at.items():
        sd[where] = sizes[name] if name in sizes else getattr(p, name)
    mean[lay["position"]], mean[lay["gravity"]] = p.position, p.gravity
    runs = len(models) - 1
    return np.append(mean, np.tile(mean[lay.shared :], runs)), np.append(sd, np.tile(sd[lay.shared :], runs))


def _tune_mode(problem: _Problem, p: Priors) -> _Problem:
    """Return the problem with wn and zeta started at the best of a grid, judged on one run."""
    m, lay = problem.models[0], problem.lay
    y = m.read[:, :3]
    at = (m.base - m.fine.t[0]) / m.fine.step
    base = m.gyro_columns(at) @ problem.R_ST.T  # rigid rate, then axis
    u, axis = base[:, 0], base[:, 1]
    ones = np.tile(np.eye(3), (len(u), 1, 1))
    fixed = np.concatenate([u[:, :, None] * ones, -rot.skew(u), ones], axis=2)
    Q, _ = np.linalg.qr(fixed.reshape(-1, 9))
    e = (y - u).ravel()
    e = e - Q @ (Q.T @ e)
    best = (np.inf, 0.0, 0.0)
    spread = np.exp(p.log_frequency * np.linspace(-2, 2, 13))
    for f in p.frequency * spread:
        for zeta in p.damping * np.array([0.5, 1.0, 2.0]):
            r = respond(m.fine.load, m.fine.step, 2 * np.pi * f, zeta)
            v = m.seen(r.v, at)
            C = (axis[:, :, None] * v[:, None, :]).reshape(len(e), -1)
            C = C - Q @ (Q.T @ C)
            cost = float(np.sum((e - C @ np.linalg.lstsq(C, e, rcond=None)[0]) ** 2))
            if cost < best[0]:
                best = (cost, f, zeta)
    mean = problem.mean.copy()
    if np.isfinite(best[0]):
        mean[lay["mode"]] = np.log([2 * np.pi * best[1], best[2]])
    return replace(problem, mean=mean)


def _solve(problem: _Problem, iterations: int = 12) -> tuple[Floats, Floats]:
    """Return the parameters of all runs and their covariance, by rounds of Gauss-Newton."""
    problem = replace(problem, whiteners=[*problem.whiteners])
    lay, mean, sd = problem.lay, problem.mean, problem.sd
    theta, last = mean.copy(), np.inf
    for k in range(iterations):
        A = np.eye(len(theta))
        g = -(theta - mean) / sd
        for r, whitener in enumerate(problem.whiteners):
            at = problem.columns(r)
            e, J = problem.whitened(r, theta)
            if k == 2:  # from here the model fits as well as it can: admit what it leaves
                problem.whiteners[r] = whitener.at_least(e)
                e, J = problem.whitened(r, theta)
            flat = J.reshape(-1, len(at))
            A[np.ix_(at, at)] += flat.T @ flat
            g[at] += flat.T @ e.ravel()
        step = np.linalg.solve(A, g)
        step *= min(1.0, 3.0 / max(np.abs(step[: lay["mode"].stop]).max(), 1e-12))
        theta = theta + sd * step
        mode = lay["mode"]
        away = np.abs(theta[mode] - mean[mode]) / sd[mode]  # standard deviations from the prior
        overdamped = theta[mode][1] >= 0.0
        if overdamped or not np.isfinite(theta).all() or away.max() > 5.0:
            raise _lost(problem.models[0].priors)
        size = float(np.sqrt(np.mean(step**2)))
        if k > 3 and (size < 1e-5 or size > 0.9 * last):
            break
        last = size
    return theta, _covariance(problem, theta, A)


def _covariance(problem: _Problem, theta: Floats, A: Floats) -> Floats:
    """Return the covariance A^-1 S A^-1 of all parameters, S by leaving out stretches of 1 s, several decay times."""
    inverse = np.asarray(np.linalg.inv(A), dtype=np.float64)
    S = np.eye(len(theta))
    for r, m in enumerate(problem.models):
        at = problem.columns(r)
        e, J = problem.whitened(r, theta)
        S[np.ix_(at, at)] += left_out(J, e, inverse[np.ix_(at, at)], round(1.0 / m.interval))
    return at_least(inverse @ S @ inverse, inverse) * np.outer(problem.sd, problem.sd)


def _collect(problem: _Problem, theta: Floats, cov: Floats, clocks: Sequence[ClockFit]) -> BatchResult:
    lay = problem.lay
    R_ST = rot.to_matrix(rot.exp(theta[lay["turn"]])) @ problem.R_ST
    runs: list[RunResult] = []
    for r, m in enumerate(problem.models):
        at = problem.columns(r)
        one, C = theta[at], cov[np.ix_(at, at)]
        left = remainder(m, one, lay, problem.R_ST, problem.whiteners[r])
        runs.append(run_result(m, one, C, lay, clocks[r], left))
    se = np.sqrt(np.diag(cov))
    return BatchResult(
        tuple(runs), R_ST, cov[lay["turn"], lay["turn"]], theta[: lay.shared], se[: lay.shared], lay
    )
