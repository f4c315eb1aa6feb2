"""Search of one moving block with everything else projected out.

For a candidate C of the block's columns the drop of the weighted sum of squares is g' G^-1 g, g = C' P r, G = C' P C,
with P the projector off all other columns and r the residual they leave: one thin product each, so that the block's
whole grid is scanned, the best basins are kept, and each is refined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.solve.moving import Moving
from pinotwin.solve.projection import RANK, Projection, directions


@dataclass(frozen=True)
class Basin:
    """A local optimum of one block's shapes: search coordinates (s,), and what they take off the sum of squares."""

    x: Floats
    gain: float


class Scan:
    """The gain of one block as a function of its shapes, all other columns held."""

    def __init__(
        self,
        projection: Projection,
        b: int,
        others: Sequence[tuple[int, Floats]],
        sigma: Floats,
        kept: int = 4,
    ) -> None:
        """Project out the fixed columns and those of other blocks, (block, columns); ``kept`` basins are refined."""
        self.kept = kept
        self.block: Moving = projection.moving[b]
        pieces = [(k, C, projection.numbers(k)) for k, C in others]
        spans = [s.wider(*projection.on_axis(i, pieces)) for i, s in enumerate(projection.spans)]
        sizes = [len(s.coordinates) for s in spans]
        offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
        small = np.zeros((int(offsets[-1]), projection.width))
        for i, span in enumerate(spans):
            small[offsets[i] : offsets[i + 1], span.index] = span.coordinates / sigma[i]
        effort = small[:, projection.fixed]
        rest = np.delete(small, projection.fixed, axis=1)
        base = directions(rest)[0]
        self._base = base
        self._residual = effort - base @ (base.T @ effort)
        self._residual -= base @ (base.T @ self._residual)
        self._where = [
            (spans[i], place, slice(offsets[i], offsets[i + 1]), 1 / sigma[i])
            for i, place in projection.placed[b].items()
        ]
        self._rows = int(offsets[-1])

    def gain(self, x: Floats) -> float:
        """Return the drop of the weighted sum of squares at search coordinates x."""
        return float(self.gains(x[None])[0])

    def gains(self, points: Floats) -> Floats:
        """Return the gain at every point, shape (m,), for points of shape (m, s)."""
        c = len(self.block.names)
        inside, gram = np.zeros((len(points), self._rows, c)), np.zeros((len(points), c, c))
        for k, x in enumerate(points):
            C = self.block.at(x)
            for span, place, where, weight in self._where:
                part = C if place is None else place @ C
                inside[k, where] = span.across(part) * weight
                gram[k] += (part.T @ part) * weight**2
        length = np.diagonal(gram, axis1=1, axis2=2)
        scale = np.sqrt(np.where(length > 0, length, 1.0))
        left = inside - self._base @ (self._base.T @ inside)
        gram = gram - np.swapaxes(inside, 1, 2) @ inside + np.swapaxes(left, 1, 2) @ left
        values, vectors = np.linalg.eigh(gram / (scale[:, :, None] * scale[:, None, :]))
        slope = (np.swapaxes(left, 1, 2) @ self._residual) / scale
        part = np.squeeze(np.swapaxes(vectors, 1, 2) @ slope[:, :, None], axis=2)
        good = values > np.maximum(1e-10, RANK * values[:, -1:])  # what lies outside the other columns
        return np.sum(np.where(good, part**2 / np.where(good, values, 1.0), 0.0), axis=1)

    def basins(self, start: Floats, refine: bool = True) -> list[Basin]:
        """Return the best basins at ``start``, shape (s,), best first; also between the grid's values if ``refine``.

        The longest grid is scanned first, then each further shape from every basin kept.
        """
        grids = self.block.grids
        kept = [Basin(start, self.gain(start))]
        for k in sorted(range(len(grids)), key=lambda k: -len(grids[k])):
            found = [peak for basin in kept for peak in self._peaks(basin.x, k)]
            kept = self._best([*found, *kept])
        if not refine:
            return kept
        return self._best([self._refined(basin) for basin in kept])

    def _peaks(self, x: Floats, k: int) -> list[Basin]:
        """Return the local maxima along the grid of shape k, best first."""
        grid = self.block.grids[k]
        points = np.repeat(x[None], len(grid), axis=0)
        points[:, k] = grid
        gains = self.gains(points)
        padded = np.concatenate([[-np.inf], gains, [-np.inf]])
        peak = (gains >= padded[:-2]) & (gains >= padded[2:])
        order = np.flatnonzero(peak)[np.argsort(-gains[peak], kind="stable")]
        return [Basin(points[i], float(gains[i])) for i in order[: self.kept]]

    def _best(self, basins: Sequence[Basin]) -> list[Basin]:
        """Return the best few basins, of neighbours within half a grid cell only the best."""
        out: list[Basin] = []
        for basin in sorted(basins, key=lambda b: -b.gain):
            for other in out:
                cells = np.array([self._neighbours(value, k) for k, value in enumerate(other.x)])
                if np.all(np.abs(basin.x - other.x) <= 0.25 * np.diff(cells).ravel()):
                    break
            else:
                out.append(basin)
        return out[: self.kept]

    def _refined(self, basin: Basin) -> Basin:
        """Return the optimum near a basin: one shape at a time, each within its grid neighbours."""
        x, best = basin.x.copy(), basin.gain
        count = len(x)
        for _ in range(min(count, 2)):
            for k in range(count):
                low, high = self._neighbours(x[k], k)
                if high <= low:
                    continue

                def loss(value: float, k: int = k) -> float:
                    trial = x.copy()
                    trial[k] = value
                    return -self.gain(trial)

                found = scipy.optimize.minimize_scalar(
                    loss, bounds=(low, high), method="bounded", options={"xatol": 1e-2 * (high - low)}
                )
                if -found.fun > best:
                    x[k], best = found.x, -found.fun
        return Basin(x, float(best))

    def _neighbours(self, value: float, k: int) -> tuple[float, float]:
        """Return the grid values on both sides of a value, or the bounds beyond the ends."""
        low, high = (float(bound[k]) for bound in self.block.bounds)
        grid = self.block.grids[k]
        below, above = grid[grid < value], grid[grid > value]
        return float(below[-1]) if len(below) else low, float(above[0]) if len(above) else high
