"""By how much the effort is ahead of the position: a lag that no drive has, but many loggers do.

The effort of an axis is explained by what may cause it: accelerations, speeds and their signs of
all moving axes (a wrist couples them), and a quadratic in the positions in place of gravity
(positions may be those of motors, so that their sine means nothing). All pass the same low-pass.
The effort is shifted sample by sample and the residual's power drawn against the shift; a parabola
through the lowest three gives the fraction of a sample. Leaving out one block of the log after the
other (jackknife) gives the error. It is a cross-correlation of effort and acceleration from which
friction and gravity have been taken out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Ints

REACH = 0.010  # longest shift [s]
_ROWS = 8000
_BLOCKS = 6


@dataclass(frozen=True)
class Lead:
    """Time by which an effort is ahead.

    Attributes:
        seconds: the time [s]; negative when the effort comes late.
        error: its standard error, by the jackknife over blocks of the log [s].
        gain: share by which the residual's power falls when the effort is shifted back.
    """

    seconds: float
    error: float
    gain: float


@dataclass(frozen=True)
class Causes:
    """What the effort of any axis may follow.

    Attributes:
        q: filtered positions of the moving axes, shape (n, k).
        v: velocities.
        a: accelerations.
    """

    q: Floats
    v: Floats
    a: Floats

    def columns(self, rows: Ints) -> Floats:
        """Return the regressor of some rows, shape (len(rows), 5 k + 1)."""
        place = (self.q[rows] - self.q.mean(axis=0)) / self.q.std(axis=0)
        v = self.v[rows]
        return np.column_stack([self.a[rows], v, np.sign(v), place, place**2, np.ones(len(rows))])


def effort_lead(u: Floats, causes: Causes, rate: float, rows: Ints) -> Lead | None:
    """Return by how much an effort is ahead of the motion, or None where nothing tells.

    Args:
        u: filtered effort, shape (n,).
        causes: what it may follow.
        rate: sampling rate [Hz].
        rows: rows that may be used, in order.
    """
    reach = max(3, int(np.ceil(REACH * rate)))
    rows = rows[(rows >= reach) & (rows < len(u) - reach)]
    rows = rows[:: max(1, len(rows) // _ROWS)]
    columns = causes.columns(rows)
    if len(rows) < 20 * columns.shape[1]:
        return None
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis = np.linalg.qr(scaled)[0]
    shifts = np.unique(np.round(np.linspace(-reach, reach, min(2 * reach + 1, 41))).astype(int))
    bounds = np.linspace(0, len(rows), _BLOCKS + 1).astype(int)[:-1]
    power = np.empty((len(shifts), _BLOCKS))
    for i, shift in enumerate(shifts):
        y = u[rows - shift]
        residual = y - basis @ (basis.T @ y)
        power[i] = np.add.reduceat(residual**2, bounds)
    total = power.sum(axis=1)
    best = int(np.argmin(total))
    if best in (0, len(shifts) - 1) or total[best] <= 0:
        return None
    whole = _lowest(shifts, total)
    without = np.array([_lowest(shifts, total - p) for p in power.T])
    error = float(np.sqrt((_BLOCKS - 1) * np.mean((without - without.mean()) ** 2)))
    now = float(np.interp(0.0, shifts, total))
    return Lead(whole / rate, error / rate, 1.0 - float(total[best]) / now)


def _lowest(shifts: Ints, power: Floats) -> float:
    """Return the lowest point of the parabola through the three lowest neighbours."""
    i = int(np.clip(np.argmin(power), 1, len(shifts) - 2))
    left, middle, right = power[i - 1], power[i], power[i + 1]
    bend = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / bend if bend > 0 else 0.0
    return float(shifts[i] + np.clip(offset, -1.0, 1.0) * (shifts[i + 1] - shifts[i]))
