r"""What a twin leaves of its own logs that comes again with the motion: its habit.

What is left of an axis is told first by functions of its own motion,

    r = sum_k c_k X_k(q, v, m) + rest,      m the model's own effort,

under the ridge that predicts best stretches of the own logs from all others, and only where it closes enough of them.
Beyond what these have visited every function stays where it was last. The other axes' motion has no part in it: a
healthy robot would be said to be pushed where only its posture is new.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.data.samples import Sample
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.signals import hats, rms

FOLDS = 8  # Stretches of the own logs, each predicted from all others
WEIGHTS = (0.01, 0.1, 1.0)  # Weights of the ridge that are tried, of a column's own square
KNOTS = 9  # Of the curve over the position
TURNS = 0.02  # [of the top speed] Within which dry friction turns round
SLOW = (0.05, 0.2, 0.5)  # [of the top speed] Speeds over which friction may fall


@dataclass(frozen=True, eq=False)
class Habit:
    """What is left of one joint with the habit taken off."""

    new: Floats  # on the logs in question, shape (m,)
    own: Floats  # on the own logs, cross-validated, shape (k,)
    left: float  # RMS of ``own`` over what it was


def habit(new: Sample, own: Sample, joint: int, rules: Rules = RULES) -> Habit | None:
    """Return what is left of a joint without the habit of its twin; None where it has none."""
    r = own.residual[joint]
    if joint not in new.joints or len(r) < FOLDS * KNOTS:
        return None
    here, there = _columns(own, own, joint), _columns(new, own, joint)
    low, high, mean, scale = here.min(axis=0), here.max(axis=0), here.mean(axis=0), here.std(axis=0) + 1e-9
    X, Z = (np.column_stack([(np.clip(x, low, high) - mean) / scale, np.ones(len(x))]) for x in (here, there))
    fold: Ints = np.arange(len(r)) * FOLDS // len(r)
    tried = [_held_out(X, r, fold, weight) for weight in WEIGHTS]
    best = int(np.argmin([rms(x) for x in tried]))
    left = rms(tried[best]) / max(rms(r), 1e-300)
    rest = new.residual[joint] - Z @ _fit(X, r, WEIGHTS[best])
    # A push is in both: what most rows leave tells whether the habit is that of these logs, too.
    worse = np.median(np.abs(rest)) > np.median(np.abs(new.residual[joint]))
    if left > rules.habit or worse:
        return None
    return Habit(rest, tried[best], left)


def _held_out(X: Floats, r: Floats, fold: Ints, weight: float) -> Floats:
    rest = r.copy()
    for k in range(FOLDS):
        out = fold == k
        rest[out] -= X[out] @ _fit(X[~out], r[~out], weight)
    return rest


def _fit(X: Floats, r: Floats, weight: float) -> Floats:
    return np.asarray(np.linalg.solve(X.T @ X + weight * len(X) * np.eye(X.shape[1]), X.T @ r))


def _columns(s: Sample, own: Sample, joint: int) -> Floats:
    """Return the functions of the motion at the rows of a joint, shape (m, p); knots and speeds are the own logs'."""
    m, rows, there = s.motion, s.samples(joint), own.samples(joint)
    q, v = m.q[rows, joint], m.v[rows, joint]
    effort = np.zeros(len(rows)) if m.model is None else m.model[rows, joint]
    seen, top = own.motion.q[there, joint], float(np.abs(own.motion.v[there, joint]).max()) + 1e-12
    low, high = float(seen.min()), float(seen.max()) + 1e-12
    place = hats(np.clip(q, low, high), low, high, KNOTS)
    speed, turn = v / top, np.tanh(v / (TURNS * top))
    falls = [turn * np.exp(-np.abs(speed) / x) for x in SLOW]
    single = np.stack([*falls, speed * np.abs(speed), effort * turn, np.abs(effort)], axis=1)
    return np.concatenate([place, place * turn[:, None], single], axis=1)
