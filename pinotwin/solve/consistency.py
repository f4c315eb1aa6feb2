"""Parameters that a real body could have: masses and inertias behind the base parameters.

    minimise  || R theta - z ||^2 + eps || (pi - pi0) / size ||^2,   theta = (beta, phi), beta = P
    pi such that every body's pseudo-inertia is positive, rotor inertias and bounded phi likewise

The data speak first. If some consistent pi has P pi equal to the beta already found, beta is kept
as it is and pi is the one nearest pi0. Only if there is none do the constraints move theta, and the
result says at what cost. Bodies that the data do not see keep pi0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.errors import DataError
from pinotwin.solve.cone import Cone, best, nearest_with, stack_upper
from pinotwin.solve.pseudoinertia import ROUNDING, Size, sizes
from pinotwin.solve.result import LinearFit

MARGIN = 1e-6
"""Smallest eigenvalue asked of a body's scaled pseudo-inertia (whose trace is near 2); a consistent prior with less
keeps its own."""
PRIOR = 1e-6
"""Weight of the prior beside the weighted residual, where the data must give way."""

SHARES = (1.0, 0.99, 0.9, 0.5)
"""Of the way from a compromise to the nearest parameters of the same beta that are tried."""


@dataclass(frozen=True)
class Bodies:
    """What the standard parameters are made of.

    Attributes:
        P: matrix of the base parameters, beta = P pi, shape (b, p_std).
        pi0: standard parameters believed before the data (CAD), shape (p_std,).
        bodies: the ten indices in pi of every body, Pinocchio's order.
        rotors: indices in pi of the reflected rotor inertias, which are not negative.
    """

    P: Floats
    pi0: Floats
    bodies: tuple[Ints, ...]
    rotors: Ints = field(default_factory=lambda: np.zeros(0, int))


@dataclass(frozen=True)
class Evidence:
    """What an unconstrained fit found.

    Attributes:
        factor: R of the weighted rows, shape (k, p).
        right: z, shape (k,).
        theta: unconstrained coefficients, shape (p,).
        beta: indices of the base parameters within theta, in the order of P's rows.
        lower: smallest values of theta, shape (p,), -inf for free.
        residual: weighted residual sum of squares at theta.
    """

    factor: Floats
    right: Floats
    theta: Floats
    beta: Ints
    lower: Floats
    residual: float

    @classmethod
    def of(cls, fit: LinearFit, beta: Ints) -> Self:
        """Return the evidence of a linear fit whose parameters ``beta`` are the base parameters."""
        weighted = fit.residual / fit.sigma[fit.problem.axis_place]
        return cls(fit.factor, fit.right, fit.theta, np.asarray(beta), fit.lower, float(weighted @ weighted))


@dataclass(frozen=True)
class ConsistentFit:
    """A physically consistent set of parameters.

    Attributes:
        pi: standard parameters, shape (p_std,); P pi equals theta[beta].
        theta: coefficients, the given ones if no constraint binds, shape (p,).
        moved: whether the constraints moved theta.
        cost_ratio: weighted residual sum of squares over the unconstrained one; 1 if not moved.
        smallest: per body, smallest eigenvalue of the pseudo-inertia in units of its size.
    """

    pi: Floats
    theta: Floats
    moved: bool
    cost_ratio: float
    smallest: Floats


def consistent(evidence: Evidence, bodies: Bodies) -> ConsistentFit:
    """Return the consistent parameters nearest the data, then nearest the prior.

    Args:
        evidence: what the fit found.
        bodies: base parameters, prior and bodies.

    Raises:
        DataError: shapes that do not fit, or no consistent parameters near the data.
    """
    _check(evidence, bodies)
    size = sizes(bodies.pi0, bodies.bodies)
    cone = _cone(bodies, size)
    theta = evidence.theta
    inside = bool((theta >= evidence.lower).all())
    pi = nearest_with(cone, bodies.P, theta[evidence.beta]) if inside else None
    moved = pi is None
    if pi is None:
        pi, theta, stiff = _compromise(cone, bodies.P, evidence)
        pi = _nearer(pi, theta[evidence.beta], cone, bodies, size) if stiff else pi
    pairs = zip(bodies.bodies, size, strict=True)
    smallest = np.array([s.smallest(pi[index]) for index, s in pairs])
    ratio = _cost_ratio(evidence, theta) if moved else 1.0
    return ConsistentFit(pi, theta, moved, ratio, smallest)


def _compromise(cone: Cone, P: Floats, evidence: Evidence) -> tuple[Floats, Floats, bool]:
    """Return pi and theta where the constraints must move theta, and whether the prior was too faint to hold pi."""
    R, beta = evidence.factor, evidence.beta
    others = np.setdiff1d(np.arange(R.shape[1]), beta)
    length = np.linalg.norm(R[:, others], axis=0)
    unit = 1.0 / np.where(length > 0, length, 1.0)
    model = np.concatenate(
        [R[:, beta] @ (P[:, cone.free] * cone.size[cone.free]), R[:, others] * unit], axis=1
    )
    start = np.maximum(evidence.theta[others], evidence.lower[others])
    offset = evidence.right - R[:, beta] @ (P @ cone.pi0) - R[:, others] @ start
    slack = (evidence.lower[others] - start) / unit
    found = best(cone, model, offset, slack, PRIOR)
    stiff = found is None
    if stiff:
        found = best(cone, model, offset, slack, PRIOR, unit=float(np.linalg.norm(offset)) or 1.0)
    if found is None:
        raise DataError(
            "no physically consistent parameters found near the data: check the masses and "
            "inertias of the URDF and the sign of the measured effort"
        )
    pi, u = found
    theta = evidence.theta.copy()
    theta[beta] = P @ pi
    theta[others] = np.maximum(start + unit * u, evidence.lower[others])
    return pi, theta, stiff


def _nearer(pi: Floats, beta: Floats, cone: Cone, bodies: Bodies, size: tuple[Size, ...]) -> Floats:
    """Return parameters of the same beta as near the prior as bodies can be.

    Where constraints bind, the nearest may lie a rounding error outside them; what lies between it and the compromise
    has the same beta and is the more inside.
    """
    nearest = nearest_with(cone, bodies.P, beta)
    if nearest is None:
        return pi
    for share in SHARES:
        between = share * nearest + (1.0 - share) * pi
        if all(
            s.smallest(between[index]) >= 0.5 * margin
            for s, index, margin in zip(size, bodies.bodies, cone.margins, strict=True)
        ):
            return between
    return pi


def _cone(bodies: Bodies, size: tuple[Size, ...]) -> Cone:
    """Return the cone of consistent parameters around the prior."""
    seen = np.linalg.norm(bodies.P, axis=0) > 0
    free: Mask = np.zeros(len(bodies.pi0), bool)
    unit = np.ones(len(bodies.pi0))
    margins = np.full(len(bodies.bodies), MARGIN)
    for k, (index, s) in enumerate(zip(bodies.bodies, size, strict=True)):
        now = s.smallest(bodies.pi0[index])
        if -ROUNDING <= now < MARGIN:
            margins[k] = min(now, 0.0) if now < 0 else now
        free[index] = seen[index].any() or now < -ROUNDING
        unit[index] = s.units()
    rotors = np.asarray(bodies.rotors, dtype=np.intp)
    free[rotors] = seen[rotors] | (bodies.pi0[rotors] < 0)
    unit[rotors] = _rotor_size(bodies, size)
    return Cone(tuple(_upper_map(s) for s in size), bodies.bodies, margins, rotors, free, bodies.pi0, unit)


def _rotor_size(bodies: Bodies, size: tuple[Size, ...]) -> Floats:
    """Return the size of the rotor inertias: their own, or a tenth of a usual body's inertia."""
    usual = 0.1 * float(np.median([s.mass * s.length**2 for s in size])) if size else 1.0
    now = np.abs(bodies.pi0[bodies.rotors])
    return np.where(now > 0, now, usual)


def _upper_map(size: Size) -> Floats:
    """Return the map from ten parameters to the stacked scaled pseudo-inertia, shape (10, 10)."""
    return np.stack([stack_upper(size.scaled(unit)) for unit in np.eye(10)], axis=1)


def _cost_ratio(evidence: Evidence, theta: Floats) -> float:
    """Return the residual sum of squares at theta over the one that was found."""

    def misfit(x: Floats) -> float:
        return float(np.sum((evidence.factor @ x - evidence.right) ** 2))

    more = misfit(theta) - misfit(evidence.theta)
    return 1.0 + more / evidence.residual if evidence.residual > 0 else np.inf


def _check(evidence: Evidence, bodies: Bodies) -> None:
    """Refuse shapes that do not fit."""
    b, p_std = bodies.P.shape
    if len(evidence.beta) != b:
        raise DataError(f"P has {b} base parameters, beta names {len(evidence.beta)} of theta")
    if bodies.pi0.shape != (p_std,):
        raise DataError(f"P has {p_std} standard parameters, pi0 has {bodies.pi0.shape}")
    if any(len(index) != 10 for index in bodies.bodies):
        raise DataError("every body needs the indices of its ten parameters")
