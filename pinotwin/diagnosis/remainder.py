"""What a gap that nothing in the catalogue explains looks like."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.rows import Rows


def describe(rows: Rows, residuals: list[Floats], joint: int) -> str:
    """Return in words what a remainder correlates with."""
    at = [k for k, c in enumerate(rows.channels) if c.joint == joint]
    r = np.concatenate([residuals[k] for k in at])
    if not len(r) or not r.any():
        return "nothing"
    kinds = [_periodic(rows, residuals, at), _event(r)]
    kinds.append(_smooth(rows, residuals, at, joint))
    kinds.sort(key=lambda x: -x[0])
    share, words = kinds[0]
    return words if share > 0.25 else "coloured, without a simple pattern"


def _periodic(rows: Rows, residuals: list[Floats], at: list[int]) -> tuple[float, str]:
    """Least-squares periodogram over time: a line that holds its phase through each log."""
    frequencies = np.linspace(0.5, 0.45 / rows.row_step, 600)
    gain, total = np.zeros(len(frequencies)), 0.0
    for k in at:
        c = rows.channels[k]
        t = rows.motions[c.log].t[c.centres]
        r = residuals[k] - residuals[k].mean()
        z = np.exp(-2j * np.pi * np.outer(frequencies, t)) @ r
        gain += 2.0 * np.abs(z) ** 2 / len(r)
        total += float(r @ r)
    best = int(np.argmax(gain))
    share = float(gain[best] / max(total, 1e-300))
    return share, f"time-periodic at {frequencies[best]:.3g} Hz"


def _event(r: Floats) -> tuple[float, str]:
    power = np.sort(r**2)[::-1]
    few = max(len(power) // 50, 1)
    share = float(power[:few].sum() / power.sum())
    return (share - 0.3, f"event-like: a fiftieth of the time holds {share:.0%} of it")


def _smooth(rows: Rows, residuals: list[Floats], at: list[int], joint: int) -> tuple[float, str]:
    """Share that a table of position, of velocity, of both, explains (cross-checked by halves)."""
    r = np.concatenate([residuals[k] for k in at])
    best = (0.0, "coloured")
    for name, words in (
        ("q", "a function of position"),
        ("v", "a function of velocity"),
        ("a", "a function of acceleration"),
    ):
        x = np.concatenate(
            [getattr(rows.motions[rows.channels[k].log], name)[rows.channels[k].centres, joint] for k in at]
        )
        edges = np.quantile(x, np.linspace(0, 1, 41))
        bins = np.clip(np.searchsorted(edges, x) - 1, 0, 39)
        odd = (np.arange(len(r)) // 25) % 2 == 1
        error = r.copy()
        for half in (odd, ~odd):
            count = np.bincount(bins[~half], minlength=40)
            mean = np.bincount(bins[~half], r[~half], 40) / np.maximum(count, 1)
            error[half] = r[half] - mean[bins[half]]
        share = 1.0 - float(error @ error) / max(float(r @ r), 1e-300)
        best = max(best, (share, words), key=lambda y: y[0])
    return best
