"""How much of an axis' inertia can lie behind a spring of its drive."""

from __future__ import annotations

import numpy as np

from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.evidence.held_out import Judged


def inertias(c: Comparison, judged: Judged, joint: int) -> tuple[float, float] | None:
    """Return an axis' mean inertia in the twin and beside a cause (of a twin the same) [kg or kg·m²], if told."""
    mass = c.new.motion.mass
    if mass is None:
        return None
    carried = float(np.mean(mass[:, joint, joint]))
    return carried, carried + (0.0 if c.change else _moved(c, judged, joint))


def fits(c: Comparison, judged: Judged, joint: int) -> bool:
    """Whether the load behind a spring is no more than all of its axis, by two standard errors.

    Its share of the twin's inertia has no bound; many times the whole is another misfit far below the resonance.
    """
    known = inertias(c, judged, joint)
    if known is None:
        return True
    carried, whole = known
    share, error = float(judged.theta[-1]), float(np.sqrt(max(judged.covariance[-1, -1], 0.0)))
    return carried * (share - 2.0 * error) < whole


def _moved(c: Comparison, judged: Judged, joint: int) -> float:
    """Return by how much a machine's mean inertia of an axis is refitted beside a cause."""
    at = 0
    for effect in c.model_columns:
        p = len(effect.coefficients())
        if effect.name == "rigid_body":
            still = np.zeros_like(c.new.motion.q[:1])
            push = still.copy()
            push[0, joint] = 1.0
            model, base = c.machine.model, c.machine.base
            middle = c.new.motion.q.mean(axis=0, keepdims=True)
            rows = base.regressor(model, middle, still, push) - base.regressor(model, middle, still, still)
            return float(rows[0, joint] @ judged.base[at : at + p])
        at += p
    return 0.0
