"""A factor on all of an axis' effort: what its own columns take up whole is told by what it shares with others.

Other axes feel its inertia and weight, and so foretell its effort. All rows count: those of the others by numbers that
they have without the axis, those of the axis by what these leave open of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.ground import Ground, Tables
from pinotwin.diagnosis.settings import SETTINGS


def coupled(g: Ground, j: int) -> tuple[Ground, Tables, float]:
    """Return the ground of an axis by what others know of it, the effort that they foretell, and a price.

    The price is by how much all logs are likelier by the numbers of all axes together [nats]: without a factor they
    are those of one machine. That they are less likely is no gain of a factor: any cause on an axis makes them so.
    """
    turn, gram = g.shared
    wide, others = SETTINGS.wide * g.noise[j][0], [k for k in g.parts if k != j]
    told = np.eye(turn.shape[1] + 1) / wide**2 + sum(gram[k] for k in others)
    known, all_ = told[:-1, :-1], told + gram[j]
    off = turn @ np.linalg.solve(known, told[:-1, -1])
    every = turn @ np.linalg.solve(all_[:-1, :-1], all_[:-1, -1])
    columns = [g.columns(k, j) for k in range(len(g.parts[j]))]
    out = replace(g, parts=dict(g.parts), base=dict(g.base))
    open_ = _spread(columns[0], turn, known, 0.01 * g.noise[j][0]) / wide
    pairs = zip(g.parts[j], columns, strict=True)
    out.parts[j] = [replace(p, twin=X @ open_, left=p.left - X @ off) for p, X in pairs]
    out.base[j] = out.alone(j)
    out.settle(j)
    likelier = _density(g, every, list(g.parts)) - _density(g, off, others) - out.base[j].density
    theta = off + np.pad(g.c.twin.theta, (0, len(off) - len(g.c.twin.theta)))
    return out, [{j: (X @ theta)[:, None]} for X in columns], max(likelier, 0.0)


def _spread(X: Floats, turn: Floats, known: Floats, least: float) -> Floats:
    """Return what turns columns X (m, b) into the effort that stays open [N or N·m], each by one standard deviation.

    ``known``: information of the others (z, z) on what ``turn`` (b, z) makes of them; ``least``: RMS of what counts.
    """
    size, V = np.linalg.eigh(known)
    root = turn @ (V / np.sqrt(np.maximum(size, 1e-15 * size.max())))
    _, size, W = np.linalg.svd(X @ root, full_matrices=False)
    return np.asarray(root @ W[size > least * np.sqrt(len(X))].T)


def _density(g: Ground, off: Floats, joints: Sequence[int]) -> float:
    """Return the log density of the logs of some joints where the twin's numbers are off by so much, (b,) [nats]."""
    out = replace(g, parts={}, base={})
    for k in joints:
        p = g.parts[k][0]
        out.parts[k] = [replace(p, twin=p.twin[:, :0], left=p.left - g.columns(0, k) @ off)]
        out.base[k] = out.alone(k)
        out.settle(k)
    return sum(x.density for x in out.base.values())
