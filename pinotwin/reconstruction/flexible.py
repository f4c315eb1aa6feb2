r"""The flexible plant with its spring, in two steps (thesis Section 7.2, and the spring explicitly).

1. The motors' rows with the reconstructed vibration (Eq. 7.2). The passive joint's own row is left
   out: it has no measured effort, so that theta = 0 solves it, and weights that follow the
   residuals would end there.
2. That row alone, with what step 1 knows as the ruler for force:

       W_d(q, v, a) beta + k q_d + c v_d = 0,      beta ~ N(beta_1, cov_1),

   both sides high-passed (the slow angle is not measured). What the motors cannot see of beta, the
   link's own inertia about the joint, has a wide prior around the CAD value and is found here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from pinotwin.arrays import Floats
from pinotwin.dynamics import parameters
from pinotwin.dynamics.parameters import body_count
from pinotwin.errors import DataError
from pinotwin.fit.consistency import Bodies, Evidence, consistent
from pinotwin.imu.statistics import long_run
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.preparation import prepare
from pinotwin.reconstruction.merge import with_vibration
from pinotwin.reconstruction.result import Vibration
from pinotwin.twin import Twin
from pinotwin.twin.parameters import verdict

_DOUBT = 0.5  # CAD values that the motors do not see may be off by this share of the largest
_LAG = 0.25  # correlation time of the residuals [s]


@dataclass(frozen=True)
class Found:
    """A number with its standard error, SI."""

    value: float
    error: float

    def interval(self, z: float = 1.959964) -> tuple[float, float]:
        """Return the interval ``value ± z error``; 95 % by default."""
        return self.value - z * self.error, self.value + z * self.error


@dataclass(frozen=True)
class Flexible:
    """A flexible plant.

    Attributes:
        twin: motors' rows fitted with the vibration; its spring is the one found.
        stiffness: of the passive joint [N·m/rad].
        damping: [N·m·s/rad].
        residual: RMS of the joint's own row [N·m]. load: RMS of the torque it balances [N·m].
    """

    twin: Twin
    stiffness: Found
    damping: Found
    residual: float
    load: float


def identify_flexible(
    machine: Machine,
    logs: Log | Sequence[Log],
    vibrations: Vibration | Log | Sequence[Vibration | Log],
    *,
    validate: Sequence[Log] = (),
    cutoff: float | None = None,
    report: Callable[[str, float], None] | None = None,
) -> Flexible:
    """Identify the open loop of a machine with the vibration of its passive joint.

    Args:
        machine: with one passive joint.
        logs: servo log(s).
        vibrations: the reconstruction that belongs to each.
        validate: servo logs that hold ``<joint>.v``, to judge on.
        cutoff: corner of the zero-phase low-pass [Hz]; chosen from the data when None.
        report: called with the stage and the share done.

    Raises:
        DataError: logs and vibrations do not come in pairs.
    """
    from pinotwin.identification import identify

    several = [logs] if isinstance(logs, Log) else list(logs)
    given: list[Vibration | Log]
    given = [vibrations] if isinstance(vibrations, Vibration | Log) else list(vibrations)
    if len(several) != len(given):
        raise DataError(f"{len(several)} logs and {len(given)} vibrations; give them in pairs")
    pairs = list(zip(several, given, strict=True))
    twin = identify(
        machine, [with_vibration(log, v) for log, v in pairs], validate=list(validate) or None,
        loop=False, consistent=False, cutoff=cutoff, report=report,
    )  # fmt: skip
    full = [with_vibration(log, v, row=True) for log, v in pairs]
    found = _with_spring(twin, full, next(iter(machine.passive)))
    return _with_mode_errors(found, [v for v in given if isinstance(v, Vibration)])


def _with_mode_errors(found: Flexible, vibrations: Sequence[Vibration]) -> Flexible:
    """Return the same with the reconstruction's own uncertainty of the mode: k ~ wn², c ~ zeta wn."""
    if not vibrations:
        return found
    relative = []
    for v in vibrations:
        (f, f_se), (zeta, zeta_se) = v.frequency, v.damping
        relative.append((2.0 * f_se / f, float(np.hypot(f_se / f, zeta_se / zeta))))
    share = np.sqrt(np.mean(np.square(relative), axis=0) / len(relative))
    k, c = (
        replace(x, error=float(np.hypot(x.error, x.value * s)))
        for x, s in zip((found.stiffness, found.damping), share, strict=True)
    )
    return replace(found, stiffness=k, damping=c)


@dataclass(frozen=True)
class _Row:
    """The joint's own row, weighted: columns (n, b + 2), and the prior."""

    X: Floats
    mean: Floats
    precision: Floats

    def solve(self, lag: int) -> tuple[Floats, Floats, float]:
        """Return coefficients, their covariance, and the RMS of what is left."""
        sigma = 1.0
        x: Floats = self.mean
        for _ in range(4):
            A = self.X.T @ self.X / sigma**2 + self.precision
            x = np.asarray(np.linalg.solve(A, self.precision @ self.mean), dtype=float)
            e = self.X @ x
            # independent noise is worth fewer samples when it is correlated
            sigma = float(np.sqrt(np.mean(e**2) * min(lag, len(e) // 20)))
        scores = self.X * e[:, None] / sigma**2
        inverse = np.linalg.inv(A)
        cov = inverse @ (long_run(scores, lag) + self.precision) @ inverse
        return x, cov, float(np.sqrt(np.mean(e**2)))


def _with_spring(twin: Twin, logs: Sequence[Log], joint: str) -> Flexible:
    machine = twin.machine
    index, base = machine.passive[joint].index, machine.base
    rows, loads = [], []
    for log in logs:
        motion = prepare(machine, log, cutoff=twin.settings["cutoff"], decimate=1)
        W = base.regressor(machine.model, motion.q, motion.v, motion.a)[:, index]
        spring = np.stack([motion.q[:, index], motion.v[:, index]], axis=1)
        for part in motion.segments:
            rows.append(_band(np.hstack([W[part], spring[part]]), 1.0 / motion.step))
    X = np.concatenate(rows)
    mean, precision = _prior(twin)
    lag = max(1, round(_LAG / motion.step))
    theta, cov, left = _Row(X, mean, precision).solve(lag)
    loads = X[:, -2] * theta[-2]
    k, c = (Found(float(theta[i]), float(np.sqrt(cov[i, i]))) for i in (-2, -1))
    known = _updated(twin, joint, theta, cov)
    return Flexible(known, k, c, left, float(np.sqrt(np.mean(loads**2))))


def _band(x: Floats, rate: float, low: float = 1.0, high: float = 60.0) -> Floats:
    """Return signals (n, k) between two corners [Hz], zero phase, ends cut."""
    sos = butter(2, (low, min(high, 0.4 * rate)), "bandpass", fs=rate, output="sos")
    edge = min(round(0.5 * rate / low), len(x) // 8)
    y: Floats = sosfiltfilt(sos, x, axis=0, padlen=min(len(x) - 1, 3 * edge))[edge : len(x) - edge]
    return y


def _prior(twin: Twin) -> tuple[Floats, Floats]:
    """Return mean and precision of (beta, k, c): step 1, and CAD for what it leaves open."""
    machine = twin.machine
    at = twin.slices[twin.keys.index("rigid_body")]
    cad = machine.base.from_standard(parameters(machine.model))
    units = np.array(machine.base.units)
    size = np.array([np.abs(cad[units == u]).max() for u in units])
    wide = (_DOUBT * np.maximum(size, 1e-6)) ** -2.0
    table = {p.name: p for p in twin.parameters}
    seen = np.array([table[f"rigid_body.{label}"].determined for label in machine.base.labels])
    precision = np.diag(np.append(wide, [1e-12, 1e-12]))
    mean = np.append(cad, [0.0, 0.0])
    b = np.flatnonzero(seen)
    cov = twin.covariance[at, at][np.ix_(b, b)]
    scale = 1.0 / np.sqrt(np.diag(cov))
    own = np.linalg.pinv(cov * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
    right = precision @ mean
    precision[np.ix_(b, b)] += own
    right[b] += own @ twin.theta[at][b]
    return np.linalg.solve(precision, right), precision


def _updated(twin: Twin, joint: str, theta: Floats, cov: Floats) -> Twin:
    """Return the twin with the rigid body and the spring of the second step."""
    machine, base = twin.machine, twin.machine.base
    rigid = twin.slices[twin.keys.index("rigid_body")]
    spring = twin.slices[twin.keys.index(f"{joint}.spring")]
    b = len(base)
    scale = np.sqrt(np.diag(cov)[:b])
    correlation = cov[:b, :b] / np.outer(scale, scale)
    factor = np.linalg.cholesky(np.linalg.inv(correlation)).T / scale
    evidence = Evidence(
        factor, factor @ theta[:b], theta[:b], np.arange(b), np.full(b, -np.inf), float(b)
    )
    count = body_count(machine.model)
    pi0 = parameters(machine.model)
    bodies = tuple(np.arange(10 * i, 10 * i + 10) for i in range(count))
    found = consistent(evidence, Bodies(base.P, pi0, bodies, np.arange(10 * count, len(pi0))))
    whole, full = twin.theta.copy(), twin.covariance.copy()
    whole[rigid], whole[spring] = found.theta, theta[b:]
    for at, own in ((rigid, slice(0, b)), (spring, slice(b, b + 2))):
        full[at, :] = full[:, at] = 0.0
        full[at, at] = cov[own, own]
    values = dict(zip([f"rigid_body.{n}" for n in base.labels], range(b), strict=True))
    values |= {f"{joint}.spring.k": b, f"{joint}.spring.c": b + 1}
    table = tuple(
        p if p.name not in values else _row(p, whole, rigid, theta, cov, values[p.name], b)
        for p in twin.parameters
    )
    return replace(twin, theta=whole, covariance=full, parameters=table, pi=found.pi)


def _row(p, whole, rigid, theta, cov, i: int, b: int):  # type: ignore[no-untyped-def]
    value = float(whole[rigid][i]) if i < b else float(theta[i])
    error = float(np.sqrt(cov[i, i]))
    word = verdict(value, error, at_bound=False)
    return replace(p, value=value, error=error, determined=True, verdict=word)
