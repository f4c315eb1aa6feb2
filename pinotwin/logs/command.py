"""Whether the command was recorded late: a controller cannot answer to what has not been commanded yet.

Its effort is linear in error, integral, speed, dry friction and the command's derivatives. It fits best with a later
command only where the log has that late, by blocks of 1 s that were left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.logs.quality.results import Finding, finding
from pinotwin.logs.settings import Settings
from pinotwin.motion import Motion


def command_findings(motion: Motion, settings: Settings) -> Iterator[Finding]:
    """Name the axes whose command was recorded late, and by how much."""
    for j, name in enumerate(motion.names):
        late = late_by(motion, j, settings)
        if late:
            yield finding("command_late", f"{name}.qr", ms=1e3 * late * motion.step, rows=late)


def untold(motion: Motion, j: int, settings: Settings, late: float = 0.02) -> bool:
    """Whether a command of a joint that came late [s] would not be seen on this motion."""
    if motion.qr is None:
        return False
    qr, rows = motion.qr.copy(), max(1, round(late / motion.step))
    qr[:, j] = np.roll(qr[:, j], rows)
    return not late_by(replace(motion, qr=qr), j, settings)


def late_by(motion: Motion, j: int, settings: Settings, most: int = 40_000) -> int:
    """Return by how many rows the command of a joint comes late, by the first so many; 0 where that is not sure."""
    reach = min(round(settings.lag_reach / motion.step), 16)
    inside = [np.arange(s.start + reach + 1, s.stop - reach - 1) for s in motion.segments]
    rows = np.concatenate(inside)[:most] if inside else np.zeros(0, dtype=int)
    slow = motion.step > 1.0 / settings.slow_rate  # what a controller does falls between the samples
    if motion.qr is None or slow or len(rows) * motion.step < 4.0:
        return 0
    first = motion.cut(0, int(rows[-1]) + reach + 1)
    channels = motion.qr[rows, j], motion.u[rows, j]
    varies = all(np.isfinite(x).all() and np.ptp(x) > 0.0 for x in channels)
    return _late(first, j, rows, reach, settings) if varies else 0


def _late(motion: Motion, j: int, rows: Ints, reach: int, settings: Settings) -> int:
    """Return by how many rows the command of a joint comes late; 0 where that is not sure."""
    edges = np.flatnonzero(np.diff((motion.t[rows] - motion.t[0]) // 1.0)) + 1
    lags = np.arange(-reach, reach + 1)
    left = np.array([_left(motion, j, rows, edges, int(k), ()) for k in lags])
    best = int(np.argmin(left.sum(axis=1)))
    gain = np.log(left[reach] / np.maximum(left[best], 1e-300))
    error = float(np.std(gain)) / np.sqrt(len(gain))
    foretold = left[best].sum() < settings.poor * float(np.var(motion.u[rows, j])) * len(rows)
    sure = foretold and lags[best] > 0 and gain.mean() > settings.sure * error
    if not sure:
        return 0
    turn = 0.003, 0.01, 0.03, 0.1  # of the top speed, over which friction turns
    beside = [_left(motion, j, rows, edges, int(k), turn).sum() for k in lags]
    return int(lags[best]) if lags[np.argmin(beside)] > 0 else 0


def _left(motion: Motion, j: int, rows: Ints, edges: Ints, lag: int, turn: Sequence[float]) -> Floats:
    """Return the squared error of every block, foretold from others: command so many rows on, friction beside."""
    assert motion.qr is not None
    qr = np.roll(motion.qr[:, j], -lag)
    e, v, vr = qr - motion.q[:, j], motion.v[:, j], np.gradient(qr, motion.step)
    law = [e, np.cumsum(e) * motion.step, v, vr, np.gradient(vr, motion.step), np.ones(len(e))]
    law += [np.tanh(v / (share * np.abs(v[rows]).max())) for share in turn]
    X, y = np.column_stack(law)[rows], motion.u[rows, j]
    X = X / np.maximum(np.abs(X).max(axis=0), 1e-300)
    parts = list(zip(np.split(X, edges), np.split(y, edges), strict=True))
    G, g = np.array([x.T @ x for x, _ in parts]), np.array([x.T @ z for x, z in parts])
    rest = zip(G.sum(axis=0) - G, g.sum(axis=0) - g, strict=True)
    others = [np.linalg.lstsq(a, b, rcond=1e-12)[0] for a, b in rest]
    return np.array([np.sum((z - x @ c) ** 2) for (x, z), c in zip(parts, others, strict=True)]) + 1e-300
