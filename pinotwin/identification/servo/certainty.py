"""How certain the gains and shapes of a controller are, and what the axes of one control tell of each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.identification.servo.output_error import Found, misfit
from pinotwin.identification.servo.problem import AS_FOUND, DRIVES, PLANT, AxisProblem
from pinotwin.loop.servo import DISTANCE, FOLLOWING, SHAPES, Roots, Servo
from pinotwin.solve.sandwich import batch_means

LAW_ERROR, FORWARD_ERROR = 1.5, 4.0
"""Standard error of a feedback gain and of the acceleration's feed-forward, as a share of itself, for each share
of the tracking error that the law misses on rows not fitted: a notch or a filter that it does not have bends its
gains, and no scatter of the rows shows that."""
FORM_ERROR, FORM_FORWARD = 0.005, 0.01
"""The same of a law from its own moments, whatever it misses: a drive differences, filters and adds up at its clock,
the law does so in continuous time (half a control period is 0.5 % of the time in which a loop of 10 Hz settles)."""
PLANT_ERROR = {"inertia": 0.01, "viscous": 0.02, "dry": 0.02, "fading": 0.2}
"""Standard errors of the identified plant that its gains take up: friction scatters by 1 to 2 % from run to run."""


def shared(
    looked: Sequence[tuple[AxisProblem, Found]], alike: float = 0.2
) -> list[dict[str, tuple[float, float]]]:
    """Return usual shapes for every axis: what the other axes show, to ``alike``, beside what drives have."""
    logs, told = {}, {}
    for k, (p, f) in enumerate(looked):
        V = np.diag(np.linalg.pinv(f.jacobian.T @ f.jacobian, hermitian=True))
        rows = len(f.residual) // 2
        for i, name in enumerate(f.search.names):
            if name in SHAPES:
                variance = V[i] * p.correlated / max(rows, 1) * f.cost / 2.0
                logs[k, name] = float(np.log(getattr(f.servo, name)))
                told[k, name] = max(1.0 / max(variance, 1e-12) - 1.0 / DRIVES[name][1] ** 2, 0.0)
    out = []
    for k in range(len(looked)):
        usual = dict(DRIVES)
        for name in SHAPES:
            others = [key for key in logs if key[1] == name and key[0] != k]
            w, x = np.array([told[key] for key in others]), np.array([logs[key] for key in others])
            if w.sum() <= 0.0:
                continue
            mean = float(w @ x / w.sum())
            width = max(1.0 / w.sum() + float(w @ (x - mean) ** 2 / w.sum()), alike**2)
            weights = 1.0 / DRIVES[name][1] ** 2, 1.0 / width
            middle = (weights[0] * np.log(DRIVES[name][0]) + weights[1] * mean) / sum(weights)
            usual[name] = (float(np.exp(middle)), float(np.sqrt(1.0 / sum(weights))))
        out.append(usual)
    return out


def same_gains(a: Servo, b: Servo, share: float = 0.02) -> bool:
    """Whether two searches ended at one point: kp alike to a share of itself."""
    x, y = a.cascade()["kp"], b.cascade()["kp"]
    return abs(x - y) < share * max(abs(x), abs(y))


def spread(p: AxisProblem, found: Found) -> Floats:
    """Return the covariance of what was searched, shape (k, k): by blocks of scores, and the doubt of the plant."""
    n, count = len(found.residual), len(found.x)
    J, left = found.jacobian[:n], found.residual
    own = found.jacobian[n:]
    scores = (J * left[:, None]).reshape(-1, 2, count).sum(axis=1)
    H = found.jacobian.T @ found.jacobian
    inverse = np.linalg.pinv(H, hermitian=True)
    share = p.correlated / max(n // 2, 1)
    total = batch_means(H, scores, count, n)[0] + inverse @ (own.T @ own) @ inverse * share + inverse * share
    measured = misfit(p, found.servo)
    for name, error in PLANT_ERROR.items():
        factors = dict(zip(PLANT, AS_FOUND, strict=True)) | {name: 1.0 + error}
        moved = misfit(p, found.servo, tuple(factors[k] for k in PLANT))  # type: ignore[arg-type]
        if name not in found.search.names and moved is not None and measured is not None:
            gain = -inverse @ (J.T @ (moved - measured))
            total = total + np.outer(gain, gain)
    return np.asarray(total)


def with_errors(
    p: AxisProblem, found: Found, rivals: Sequence[Found], missed: float | None, as_good: float = 1.1
) -> Servo:
    """Return the controller with the standard errors of its gains and shapes, and the cascade as good.

    ``rivals`` are the same form from the other side of the double root, ``missed`` the error of e on rows not fitted
    over its RMS; None for a law from its own moments, which tells the two sides apart. A cascade up to ``as_good``
    times the lowest cost fits as well, for what is wrong with the plant decides between the two too.
    """
    servo, cov = found.servo, spread(p, found)
    names = list(_told(servo))

    def at(x: Floats) -> Floats:
        told = _told(found.search.servo(x))
        return np.array([told[name] for name in names])

    G = np.stack([(at(found.x + d) - at(found.x - d)) / 2e-4 for d in 1e-4 * np.eye(len(found.x))], axis=1)
    errors = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", G, cov, G), 0.0))
    searched = {name: float(e) for name, e, row in zip(names, errors, G, strict=True) if np.any(row)}
    told = doubted(servo, searched, missed)
    other: dict[str, float] = {}
    if servo.form == "general" and len(servo.cascades()) == 2:
        other = servo.cascades()[1]
    from_moments = missed is None
    for rival in rivals:
        if servo.form == "cascade" and (from_moments or rival.cost < as_good * found.cost):
            other = rival.servo.cascade()
    if servo.form == "cascade" and not other and not from_moments:
        # the other way round, with a set-point weight the output error does not tell from 1: it errs by 2 %
        other = next((f for f in servo.cascades()[1:] if abs(f["weight"] - 1.0) < 0.02), {})
    return replace(servo, errors=told, other=other)


def _told(servo: Servo) -> dict[str, float]:
    """Return the values that get an error: smooth in the gains, a cascade's in the middle between its roots."""
    named, out = servo.named(), {k: getattr(servo, k) for k in SHAPES} | {FOLLOWING: servo.following()}
    if servo.form == "pid" or not servo.combined():
        return {**named, **servo.combined(), **out}
    roots = Roots.of(servo.gains, servo.velocity_lag)
    middle = servo.with_rate(roots.rate) or named
    if servo.form == "cascade":  # its weight was imposed
        middle = {k: x for k, x in middle.items() if k != "weight"}
    both = {"kp + rate": roots.kp + roots.rate, "kp * rate": roots.product, DISTANCE: roots.apart}
    return {**middle, **both, **out}


def doubted(
    servo: Servo, errors: Mapping[str, float], missed: float | None, clock: float = 1.5e-4
) -> dict[str, float]:
    """Return standard errors with those of the form of the law: half a control period ``clock`` [s], misses of e."""
    found, moved = _told(servo), {}
    if servo.form != "pid":
        moved = _told(replace(servo, velocity_lag=servo.velocity_lag + clock))
    A, B = (abs(servo.gains[i] / servo.gains[2]) if servo.gains[2] != 0.0 else 0.0 for i in (0, 1))
    size = {**{k: abs(x) for k, x in found.items()}, DISTANCE: float(np.hypot(2.0 * A**2, 4.0 * B))}
    out, apart = dict(errors), ("kp", "rate", DISTANCE) if DISTANCE in errors else ()
    for name in errors:
        if name in SHAPES or name == FOLLOWING:  # the error at constant velocity shows 1/Kv whatever the form
            continue
        if missed is not None:
            law = (FORWARD_ERROR if name == "ffa" else LAW_ERROR) * min(missed, 1.0)
        else:  # kp and 1/ti have their doubt from the clock, as far as they are apart
            law = 0.0 if name in apart else FORM_FORWARD if name == "ffa" else FORM_ERROR
        late = moved.get(name, found[name]) - found[name]
        out[name] = float(np.sqrt(errors[name] ** 2 + late**2 + (law * size[name]) ** 2))
    return out
