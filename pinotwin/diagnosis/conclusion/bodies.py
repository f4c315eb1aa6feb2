"""A payload as a body: mass, centre of mass and inertia that can exist, with intervals.

Ten free numbers on a link imitate much; a body's do not. The numbers found are the change of the link's
own parameters; they are held to those of a body that is added, or of one that is taken off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.result import Size


@dataclass(frozen=True)
class Body:
    """A body that was added to a link, or taken off it.

    Attributes:
        mass: [kg]; negative where it was taken off.
        mass_error: standard error.
        centre: centre of mass in the frame of the joint [m], shape (3,); NaN where not determined.
        centre_error: standard errors, shape (3,).
    """

    mass: float
    mass_error: float
    centre: Floats
    centre_error: Floats


def body_of(pi: Floats, covariance: Floats) -> Body:
    """Return the body whose ten parameters [m, m c, I ...] were found, with standard errors."""
    m = float(pi[0])
    error = float(np.sqrt(max(covariance[0, 0], 0.0)))
    if abs(m) < 2.0 * error or m == 0.0:
        return Body(m, error, np.full(3, np.nan), np.full(3, np.nan))
    c = pi[1:4] / m
    J = np.concatenate([-c[:, None], np.eye(3)], axis=1) / m  # derivative of m c / m by [m, m c]
    spread = np.sqrt(np.maximum(np.diag(J @ covariance[:4, :4] @ J.T), 0.0))
    return Body(m, error, c, spread)


def possible(pi: Floats, covariance: Floats, reach: float) -> bool:
    """Whether a body that is added or taken off can have these parameters, within two standard errors.

    Args:
        pi: ten parameters.
        covariance: of them.
        reach: farthest that a centre of mass may be from the joint [m].
    """
    body = body_of(pi, covariance)
    if not np.isfinite(body.centre).all():
        return True
    return bool(np.linalg.norm(body.centre) - 2.0 * np.linalg.norm(body.centre_error) <= reach)


def body_sizes(body: Body) -> list[Size]:
    """Return mass and centre of mass as rows of a result."""
    span = 1.645 * body.mass_error
    rows = [Size("payload.mass", 0.0, body.mass, "kg", (body.mass - span, body.mass + span))]
    for name, x, error in zip("xyz", body.centre, body.centre_error, strict=True):
        if np.isfinite(x):
            half = 1.645 * float(error)
            rows.append(Size(f"payload.c{name}", np.nan, float(x), "m", (float(x) - half, float(x) + half)))
    return rows
