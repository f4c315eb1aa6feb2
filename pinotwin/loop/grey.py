"""Find the controller itself: effort, error and command are all measured (grey box).

The law of ``controller`` is linear in its gains once delay, velocity filter and (in the cascade)
the integral rate 1/ti are known; those shapes are searched, first on a grid, then by bounded least
squares with the gains projected out. The integrator's unknown start is one constant per segment.
The controller computes its effort from the same error that is logged, so there is no
errors-in-variables bias from the loop being closed; a log whose channels were filtered differently
would have one.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import DataError
from pinotwin.loop.controller import Controller, Kind
from pinotwin.loop.data import LoopData
from pinotwin.loop.law import HALF, SETTLE, Signals, law_columns, signals_of
from pinotwin.solve.sandwich import block_covariance

SHAPES = ("delay", "lag", "filter", "rate")
"""Delay of the law, further delay of the velocity, its filter [samples]; 1/ti [1/s]."""
LONGEST = (5.0, 3.0, 20.0)
GRID = ((0.0, 1.0, 2.0, 3.0, 4.0, 5.0), (0.0, 0.5, 1.5), (0.0, 3.0), (0.0, 3.0, 20.0, 100.0))
PAYS = 0.98
"""A delay that is no whole number of samples must leave less than this share of the rest.

To first order a delay trades with kv and ffv (kp kv e delayed is kp kv e less a share of e' = vr -
v), so that a misfit in the velocity's filter would otherwise be paid for with the gains.
"""
GRID_ROWS = 2000
"""Rows on which shapes are looked for; all of them then settle the digits."""


def identify_controller(data: LoopData, *, kind: Literal["p_pi", "pid", "auto"] = "auto") -> Controller:
    """Return the controller whose law explains the measured effort.

    Args:
        data: outputs must be the tracking error and the effort, in this order; disturbances are not
            used.
        kind: form of the law; "auto" takes the one that leaves less, the cascade when they are
            equal.

    Raises:
        DataError: too short, or nothing moves.
    """
    data.require_motion()
    signals = signals_of(data)
    if kind != "auto":
        return _fit(signals, kind, data.axis)
    cascade, pid = (_fit(signals, k, data.axis) for k in ("p_pi", "pid"))
    assert cascade.rms is not None
    assert pid.rms is not None
    return pid if pid.rms < 0.99 * cascade.rms else cascade


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows that are fitted.

    Attributes:
        at: their numbers, shape (n,).
        starts: first of each segment among them.
        counts: rows of each segment.
        u: their effort, each segment's mean taken off, shape (n,).
        size: standard deviation of the effort, 1 where it has none.
    """

    at: Ints
    starts: Ints
    counts: Ints
    u: Floats
    size: float

    @classmethod
    def of(cls, s: Signals, most: int | None = None) -> _Rows:
        """Return the rows of the segments behind their beginnings, thinned to at most ``most``."""
        rows = [np.arange(p.start + SETTLE, p.stop) for p in s.segments]
        every = 1 if most is None else max(1, sum(map(len, rows)) // most)
        thin = [r[::every] for r in rows]
        counts, at = np.array([len(r) for r in thin]), np.concatenate(thin)
        bare = cls(at, np.concatenate([[0], np.cumsum(counts)[:-1]]), counts, np.zeros(0), 1.0)
        u = s.u[at]
        return replace(bare, u=bare.centred(u[:, None])[:, 0], size=float(np.std(u)) or 1.0)

    def centred(self, x: Floats) -> Floats:
        """Return x (n, k) less its mean over each segment: the constants projected out."""
        means = np.add.reduceat(x, self.starts, axis=0) / self.counts[:, None]
        return x - (means if len(means) == 1 else np.repeat(means, self.counts, axis=0))


def _misfit(s: Signals, kind: Kind, shape: Floats, rows: _Rows) -> tuple[Floats, Floats, Floats]:
    """Return residual, gains and centred columns at a shape."""
    return _left(law_columns(s, kind, shape)[rows.at], rows)


def _left(columns: Floats, rows: _Rows) -> tuple[Floats, Floats, Floats]:
    """Return residual, gains and centred columns of the law's columns on the rows."""
    W = rows.centred(columns)
    size = np.maximum(np.sqrt(np.einsum("nk,nk->k", W, W) / len(W)), 1e-300)
    gains = np.linalg.lstsq(W / size, rows.u, rcond=1e-10)[0] / size
    return rows.u - W @ gains, gains, W


def _fit(s: Signals, kind: Kind, axis: str) -> Controller:
    with threadpool_limits(1, "blas"):
        shape = _search(s, kind)
        rows = _Rows.of(s)
        residual, gains, W = _misfit(s, kind, shape, rows)
        slopes = _slopes(s, kind, shape, rows)
    spread = block_covariance(np.column_stack([W, slopes]), residual)
    offset = float(np.mean(s.u[rows.at] - law_columns(s, kind, shape)[rows.at] @ gains))
    found = _named(s, kind, gains, shape)
    errors = _errors(s, kind, gains, shape, spread)
    return Controller(
        kind,
        **found,
        step=s.step,
        offset=offset,
        errors=errors,
        r2=1.0 - float(residual @ residual / (rows.u @ rows.u)),
        rms=float(np.sqrt(np.mean(residual**2))),
        notes=_notes(found, axis),
    )


def _search(s: Signals, kind: Kind) -> Floats:
    """Return the shape: whole delays first, a fraction only where it pays."""
    few, rows = _Rows.of(s, GRID_ROWS), _Rows.of(s)
    rates = GRID[3] if kind == "p_pi" else (0.0,)
    inner = [np.array((0.0, *x)) for x in itertools.product(*GRID[1:3], rates)]
    costs = np.array([_by_delay(law_columns(s, kind, x), few) for x in inner])
    shapes = [inner[k] + np.array([d, 0.0, 0.0, 0.0]) for k, d in zip(costs.argmin(0), GRID[0], strict=True)]
    best = list(zip(costs.min(0), shapes, strict=True))
    lowest = min(cost for cost, _ in best)
    close = [x for cost, x in best if cost <= 1.5 * lowest]
    refined = [_refine(s, kind, x, few, whole=True, close=1e-5) for x in close]
    found = min(refined, key=lambda f: f[0])
    early = next(f for f in refined if f[0] <= 1.01 * found[0])
    whole = _refine(s, kind, early[1], rows, whole=True)
    fraction = _refine(s, kind, whole[1], rows, whole=False)
    return _simplest(s, kind, fraction[1] if fraction[0] < PAYS**2 * whole[0] else whole[1], rows)


def _by_delay(columns: Floats, rows: _Rows) -> list[float]:
    """Return what is left at every whole delay of :data:`GRID`: all columns are late by it, none changes else."""
    return [float(np.sum(_left(columns[rows.at - int(delay)], rows)[0] ** 2)) for delay in GRID[0]]


def _refine(
    s: Signals, kind: Kind, shape: Floats, rows: _Rows, *, whole: bool, close: float = 1e-8
) -> tuple[float, Floats]:
    """Return cost and shape after a bounded search to a ``close`` cost; ``whole`` keeps the delay."""
    scale = np.array([1.0, 1.0, 1.0, 30.0])
    high = np.array([*LONGEST, 0.2 / s.step]) / scale
    free = np.array([not whole, True, True, kind == "p_pi"])

    def full(x: Floats) -> Floats:
        moved = shape.copy()
        moved[free] = x * scale[free]
        return moved

    found = least_squares(
        lambda x: _misfit(s, kind, full(x), rows)[0] / rows.size,
        np.clip(shape[free] / scale[free], 0.02, 0.98 * high[free]),
        bounds=(np.zeros(free.sum()), high[free]),
        diff_step=1e-3,
        xtol=1e-6,
        ftol=close,
        max_nfev=30,
    )
    return 2.0 * float(found.cost) * rows.size**2, full(found.x)


def _simplest(s: Signals, kind: Kind, shape: Floats, rows: _Rows) -> Floats:
    """Return the shape with every part set to zero that explains nothing."""
    cost = float(np.sum(_misfit(s, kind, shape, rows)[0] ** 2))
    for i in range(len(shape)):
        without = shape.copy()
        without[i] = 0.0
        other = float(np.sum(_misfit(s, kind, without, rows)[0] ** 2))
        if other <= 1.0001 * cost:
            shape, cost = without, max(cost, other)
    return shape


def _slopes(s: Signals, kind: Kind, shape: Floats, rows: _Rows) -> Floats:
    """Return the derivative of the fitted effort by the searched shapes, shape (n, 4)."""
    gains = _misfit(s, kind, shape, rows)[1]
    out = np.zeros((len(rows.at), len(shape)))
    for i in _searched(shape):
        move = np.zeros(len(shape))
        move[i] = 1e-3 * max(shape[i], 1e-2)
        ahead, behind = (law_columns(s, kind, shape + f * move)[rows.at] for f in (1.0, -1.0))
        out[:, [i]] = rows.centred(((ahead - behind) @ gains / (2.0 * move[i]))[:, None])
    return out


def _searched(shape: Floats) -> list[int]:
    """Return the indices of shapes that were searched: neither dropped nor a whole delay."""
    return [i for i, x in enumerate(shape) if x != 0.0 and (i > 0 or x != round(x))]


def _named(s: Signals, kind: Kind, gains: Floats, shape: Floats) -> dict[str, float]:
    names = ("delay", "velocity_delay", "filter_time")
    samples = shape[:3] + np.array([0.0, HALF, 0.0])
    late = {k: float(x * s.step) for k, x in zip(names, samples, strict=True)}
    if kind == "pid":
        own_names = ("kp", "integral", "kd", "ffv", "ffa")
        return {**dict(zip(own_names, map(float, gains), strict=True)), **late}
    position, forward, kv, ffa = map(float, gains)
    if kv == 0.0:
        raise DataError("the effort does not follow the velocity: no cascade controller is seen in it")
    own = {"kp": position / kv, "kv": kv, "integral": float(shape[3]), "ffv": forward / kv}
    own["ffa"] = ffa
    return {**own, **late}


def _errors(s: Signals, kind: Kind, gains: Floats, shape: Floats, spread: Floats) -> dict[str, float]:
    """Return standard errors of the named gains, by the delta method."""
    base = np.concatenate([gains, shape])
    here = _named(s, kind, gains, shape)
    jacobian = np.zeros((len(here), len(base)))
    for i, x in enumerate(base):
        move = 1e-6 * (abs(x) or 1.0)
        moved = base.copy()
        moved[i] += move
        there = _named(s, kind, moved[: len(gains)], moved[len(gains) :])
        jacobian[:, i] = [(there[k] - here[k]) / move for k in here]
    variances = np.einsum("ij,jk,ik->i", jacobian, spread, jacobian)
    found = dict(zip(here, np.sqrt(np.maximum(variances, 0.0)).tolist(), strict=True))
    names = ("delay", "velocity_delay", "filter_time", "integral")
    held = {n for i, n in enumerate(names) if i not in _searched(shape)}
    held -= {"integral"} if kind == "pid" else set()
    return {name: error for name, error in found.items() if name not in held}


def _notes(found: dict[str, float], axis: str) -> tuple[str, ...]:
    bad = [k for k in ("kp", "kv", "kd") if found.get(k, 0.0) < 0.0]
    if not bad:
        return ()
    return (f"{axis}: {', '.join(bad)} came out negative: check the sign of e and of the effort",)
