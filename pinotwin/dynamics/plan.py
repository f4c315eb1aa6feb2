"""What the compiled kernel computes for the wanted columns of a regressor, and the call of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.tree import Tree


@dataclass(frozen=True)
class Plan:
    """What the kernel computes: see ``kernels.fill`` for the rows of each array.

    Attributes:
        bodies: bodies whose motion is needed, parents first, shape (., 2).
        pairs: Jacobian columns needed in bodies' frames, inner bodies first, shape (., 3).
        entries: entries of W that can differ from zero, shape (., 4).
        columns: number of columns of W.
    """

    bodies: Ints
    pairs: Ints
    entries: Ints
    columns: int


def plan_columns(geometry: Tree, wanted: Ints) -> Plan:
    """Return the plan for some columns, without the entries that are zero whatever the motion."""
    full = _structure(geometry, [*_candidates(geometry, wanted)], len(wanted))
    nv = len(geometry.parent)
    # An entry is an analytic function of the motion: zero at random points means zero everywhere.
    rng = np.random.default_rng(0)
    W = run(geometry, full, *(rng.uniform(-3.0, 3.0, (16, nv)) for _ in range(3)))
    size = np.abs(W).max(axis=0)
    alive = size > 1e-13 * np.maximum(size.max(axis=0), 1e-300)
    kept = [e for e in _candidates(geometry, wanted) if alive[e[0], e[1]]]
    return _structure(geometry, kept, len(wanted))


def _candidates(geometry: Tree, wanted: Ints) -> Iterator[tuple[int, int, int, int]]:
    """Yield (row, column, body or 0 for a rotor, part) for every entry on a body's chain."""
    bodies = 10 * len(geometry.parent)
    for column, index in enumerate(wanted.tolist()):
        if index >= bodies:
            yield index - bodies, column, 0, 0
            continue
        body, part = index // 10 + 1, index % 10
        for joint in geometry.chain(body):
            yield joint - 1, column, body, part


def _structure(geometry: Tree, entries: list[tuple[int, int, int, int]], columns: int) -> Plan:
    """Return the plan for a list of entries with the bodies and Jacobian columns that it needs."""
    needed = {(i, row + 1) for row, _, body, _ in entries if body for i in _between(geometry, body, row + 1)}
    pairs: dict[tuple[int, int], int] = {pair: k for k, pair in enumerate(sorted(needed))}
    carried = [pairs.get((int(geometry.parent[i - 1]), j), -1) if i != j else -1 for i, j in pairs]
    bodies = sorted({k for i, _ in pairs for k in geometry.chain(i)})
    rows = [(row, k, pairs[body, row + 1] if body else -1, part) for row, k, body, part in entries]
    return Plan(
        _table([(i, int(geometry.parent[i - 1])) for i in bodies], 2),
        _table([(*p, c) for p, c in zip(pairs, carried, strict=True)], 3),
        _table(rows, 4),
        columns,
    )


def _table(rows: Sequence[tuple[int, ...]], width: int) -> Ints:
    return np.array(rows, dtype=np.intp).reshape(-1, width)


def _between(geometry: Tree, body: int, joint: int) -> list[int]:
    """Return the bodies from ``body`` down to the one that ``joint`` moves."""
    chain = geometry.chain(body)
    return chain[: chain.index(joint) + 1]


def run(geometry: Tree, plan: Plan, q: Floats, v: Floats, a: Floats) -> Floats:
    """Return the planned regressor, zero where nothing is planned, shape (n, nv, columns)."""
    from pinotwin.dynamics.kernels import fill  # numba takes 0.5 s to import: only when needed

    g = geometry
    W = np.zeros((len(q), q.shape[1], plan.columns))
    fill(
        (g.revolute, g.axis, g.still, g.cosine, g.sine, g.origin, g.slide, g.gravity),
        (plan.bodies, plan.pairs, plan.entries),
        q,
        v,
        a,
        W,
    )
    return W
