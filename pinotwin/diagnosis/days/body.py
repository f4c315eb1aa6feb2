"""A payload as a body that can exist: mass, centre of mass and inertia, with intervals, added or taken off.

The numbers are the change of the link's own parameters; ten free ones would imitate much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.diagnosis.result import Size
from pinotwin.dynamics.parameters import BODY_NAMES, BODY_UNITS

UNKNOWN = 0.3  # Standard error from which a centre of mass is not determined [m]


@dataclass(frozen=True)
class Body:
    """A body that was added to a link, or taken off it."""

    mass: float  # [kg]; negative where it was taken off
    mass_error: float  # standard error
    centre: Floats  # centre of mass in the frame of the joint [m], shape (3,); NaN where not determined
    centre_error: Floats  # standard errors, shape (3,)


def body_of(pi: Floats, covariance: Floats) -> Body:
    """Return the body whose ten parameters [m, m c, I ...] were found, with standard errors."""
    m, error = float(pi[0]), float(np.sqrt(max(covariance[0, 0], 0.0)))
    c, spread = _centre(pi, covariance)
    told = spread < UNKNOWN
    return Body(m, error, np.where(told, c, np.nan), np.where(told, spread, np.nan))


def _centre(pi: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return a centre of mass and its standard errors, shape (3,) each; inf where the mass is not determined."""
    m = float(pi[0])
    if abs(m) < 2.0 * float(np.sqrt(max(covariance[0, 0], 0.0))) or m == 0.0:
        return np.zeros(3), np.full(3, np.inf)
    c = pi[1:4] / m
    J = np.concatenate([-c[:, None], np.eye(3)], axis=1) / m  # derivative of m c / m by [m, m c]
    return c, np.sqrt(np.maximum(np.diag(J @ covariance[:4, :4] @ J.T), 0.0))


def possible(pi: Floats, covariance: Floats, model: pin.Model, *, removal: bool) -> bool:
    """Whether a body added, or on ``removal`` taken off, can have these parameters, by two standard errors.

    A mass is positive unless taken off, and then no heavier than the machine; its centre lies no farther off than that.
    """
    centre, spread = _centre(pi, covariance)
    if not np.isfinite(spread).all():
        return True
    m, error = float(pi[0]), float(np.sqrt(max(covariance[0, 0], 0.0)))
    whole = sum(body.mass for body in model.inertias)
    if m < 0.0 and (not removal or -m - 2.0 * error > whole):
        return False
    return float(np.linalg.norm(centre)) - 2.0 * float(np.linalg.norm(spread)) <= reach(model)


def reach(model: pin.Model) -> float:
    """Return how far a machine may carry something from a joint [m]: its own length, a metre at least."""
    return max(1.0, float(sum(np.linalg.norm(p.translation) for p in model.jointPlacements)))


def body_sizes(body: Body, pi: Floats, covariance: Floats) -> list[Size]:
    """Return mass and centre of mass as rows of a result; what turns it where its mass is not determined."""
    span = 1.645 * body.mass_error
    rows = [Size("payload.mass", 0.0, body.mass, "kg", (body.mass - span, body.mass + span))]
    for name, x, error in zip("xyz", body.centre, body.centre_error, strict=True):
        if np.isfinite(x):
            half = 1.645 * float(error)
            rows.append(Size(f"payload.c{name}", np.nan, float(x), "m", (float(x) - half, float(x) + half)))
    if np.isfinite(body.centre).any():
        return rows
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    turned = []
    for k in [k for k in range(1, 10) if abs(pi[k]) > 4.0 * errors[k]]:
        x, half = float(pi[k]), 1.645 * float(errors[k])
        turned.append(Size(f"payload.{BODY_NAMES[k]}", 0.0, x, BODY_UNITS[k], (x - half, x + half)))
    return [*turned, *rows]


def undetermined(sizes: Sequence[Size]) -> list[str]:
    """Return what of a payload's mass and centre these logs do not tell."""
    known = {s.name for s in sizes}
    mass = next(s for s in sizes if s.name == "payload.mass")
    out = ["mass"] if mass.interval[0] < 0.0 < mass.interval[1] else []
    places = [x for x in "xyz" if f"payload.c{x}" not in known]
    return [*out, *([f"centre of mass along {', '.join(places)}"] if places else [])]
