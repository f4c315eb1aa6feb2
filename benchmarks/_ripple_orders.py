r"""Which orders of position a motor's effort ripples with, by a search of known false alarm rate.

    u(q) = c + sum_k [ a_k cos(f_k q) + b_k sin(f_k q) ] + e(q)

Orders are taken one by one, the strongest that stands out from its neighbours first, and all
coefficients are solved anew after each (orthogonal matching pursuit: Pati, Rezaiifar, Krishnaprasad
1993, doi:10.1109/ACSSC.1993.342465). There is no threshold to tune.

What is left of a real spectrum is never white, so a line is compared with the median power z of N
neighbours, not with a level for all. For noise that is even over those, powers are exponentially
distributed, and the chance that one exceeds T z by accident is known exactly whatever the noise
level (Rohling 1983, doi:10.1109/TAES.1983.309350):

    P = product over i < N/2 of (N - i) / (N - i + T)

Times the number of lines that were looked at it bounds the chance of naming any line at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import DataError

_TURN = 2.0 * np.pi
_MOST_ROWS = 16_384
_LINEAR_OVERSAMPLING = 2


@dataclass(frozen=True, eq=False)
class RippleOrders:
    """What :func:`ripple_orders` found, strongest order first.

    Attributes:
        rotary: orders are counted per revolution, else per metre.
        orders: shape (k,).
        cosine: coefficient a of each [unit of the effort]; likewise ``sine``, b.
        chance: probability that noise alone gives this order or another (family-wise), shape (k,).
        mean: constant effort c.
        searched: all candidates, shape (m,).
        spectrum: amplitude of each candidate in the data, shape (m,).
        threshold: amplitude that a candidate must exceed in what was left at the end, shape (m,).
        travel: revolutions, or metres, that the data cover.
    """

    rotary: bool
    orders: Floats
    cosine: Floats
    sine: Floats
    chance: Floats
    mean: float
    searched: Floats
    spectrum: Floats
    threshold: Floats
    travel: float

    @property
    def amplitude(self) -> Floats:
        """Amplitude of each order [unit of the effort], shape (k,)."""
        return np.hypot(self.cosine, self.sine)

    @property
    def phase(self) -> Floats:
        """Phase phi of each order in ``amplitude cos(f q - phi)`` [rad], shape (k,)."""
        return np.arctan2(self.sine, self.cosine)

    def predict(self, q: Floats) -> Floats:
        """Return the effort at positions ``q`` [rad or m], shape (n,)."""
        waves = _waves(_cycles(q, self.rotary), self.orders)
        theta = np.stack([self.cosine, self.sine], axis=1).ravel()
        return self.mean + waves @ theta

    def compare(self, q: Floats, u: Floats) -> dict[str, float]:
        """Return how well these orders predict other data: ``correlation`` and ``nrmse_std``.

        The mean is left out of both: it is friction or offset, not ripple.
        """
        ripple, given = self.predict(q) - self.mean, u - np.mean(u)
        return {
            "correlation": float(np.corrcoef(ripple, given)[0, 1]) if len(self.orders) else 0.0,
            "nrmse_std": float(np.std(given - ripple) / np.std(given)),
        }


def ripple_orders(
    q: Floats,
    u: Floats,
    *,
    rotary: bool = True,
    max_order: float = 200.0,
    alpha: float = 0.01,
    most: int = 40,
) -> RippleOrders:
    """Find the orders of position with which an effort ripples.

    Args:
        q: positions [rad or m], shape (n,).
        u: effort there, what does not depend on position removed as far as possible, shape (n,).
        rotary: search whole orders per revolution; else orders per metre, not whole.
        max_order: highest order per revolution, or per metre.
        alpha: chance of naming any order at all where there is nothing but noise.
        most: largest number of orders.

    Raises:
        DataError: too few samples, or less than one revolution.
    """
    s, u, weight = _rows(q, u, rotary, max_order)
    travel = float(np.ptp(np.asarray(q))) / (_TURN if rotary else 1.0)
    candidates = _candidates(s, rotary, max_order, travel)
    oversampling = 1 if rotary else _LINEAR_OVERSAMPLING
    search = _Search(s, u, weight, candidates, oversampling)
    orders: list[float] = []
    chance: list[float] = []
    while len(orders) < most:
        power = search.powers(orders)
        found, p = strongest(power, search.floor(power), alpha)
        if found is None:
            break
        orders.append(float(candidates[found]) if rotary else search.refined(found, orders))
        chance.append(p)
    return _result(search, orders, chance, rotary, travel, alpha)


def _cycles(q: Floats, rotary: bool) -> Floats:
    return np.asarray(q, dtype=float) / (_TURN if rotary else 1.0)


def _waves(s: Floats, orders: Floats) -> Floats:
    """Return cos and sin of each order, side by side, shape (n, 2 k)."""
    angle = _TURN * np.outer(s, orders)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(len(s), -1)


def _rows(q: Floats, u: Floats, rotary: bool, max_order: float) -> tuple[Floats, Floats, Floats]:
    """Return positions [cycles], efforts and weights; long logs averaged in bins of position."""
    s, u = _cycles(q, rotary), np.asarray(u, dtype=float)
    good = np.isfinite(s) & np.isfinite(u)
    s, u = s[good], u[good]
    if len(s) <= _MOST_ROWS:
        return s, u, np.ones(len(s))
    place = np.floor((s % 1.0 if rotary else s - s.min()) * 16.0 * max_order).astype(int)
    _, group, count = np.unique(place, return_inverse=True, return_counts=True)
    wrapped = s % 1.0 if rotary else s
    rows = count.astype(float)
    means = [np.asarray(np.bincount(group, weights=x) / rows) for x in (wrapped, u)]
    return means[0], means[1], np.sqrt(rows)


def _candidates(s: Floats, rotary: bool, max_order: float, travel: float) -> Floats:
    resolvable = len(np.unique(s)) / (2.5 * (min(travel, 1.0) if rotary else travel))
    top = min(max_order, resolvable)
    if rotary and travel < 0.98:
        raise DataError(
            f"ripple orders need a full revolution; these data cover {travel:.2f} of one: "
            "record a longer move, or use the effect `ripple` with its pitch searched"
        )
    step = 1.0 if rotary else 1.0 / (_LINEAR_OVERSAMPLING * travel)
    out = step * np.arange(1, int(top / step) + 1)
    out = out if rotary else out[out * travel >= 1.5]
    if len(out) < 2 * NEIGHBOURS:
        raise DataError(
            f"{len(s)} samples resolve {len(out)} ripple orders, {2 * NEIGHBOURS} are needed to "
            "judge them: record more positions or a longer move"
        )
    return np.asarray(out)


@dataclass(frozen=True)
class _Search:
    """Rows and candidates of one search."""

    s: Floats
    u: Floats
    weight: Floats
    candidates: Floats
    oversampling: int

    def columns(self, orders: list[float]) -> Floats:
        """Return the weighted columns of the constant and of the orders, shape (n, 1 + 2 k)."""
        waves = _waves(self.s, np.asarray(orders, dtype=float))
        return np.column_stack([np.ones(len(self.s)), waves]) * self.weight[:, None]

    def left(self, orders: list[float]) -> tuple[Floats, Floats]:
        """Return a basis of the orders' columns and what of the effort lies outside it."""
        basis = np.linalg.qr(self.columns(orders))[0]
        rest = self.u * self.weight
        return basis, rest - basis @ (basis.T @ rest)

    def powers(self, orders: list[float]) -> Floats:
        """Return each candidate's power in what the orders leave, their own set to zero."""
        basis, rest = self.left(orders)
        out = np.array([self._power(f, basis, rest) for f in self.candidates])
        near = 0.75 * (self.candidates[1] - self.candidates[0]) * self.oversampling
        for f in orders:
            out[np.abs(self.candidates - f) < near] = 0.0
        return out

    def _power(self, order: float, basis: Floats, rest: Floats) -> float:
        pair = _waves(self.s, np.array([order])) * self.weight[:, None]
        pair = pair - basis @ (basis.T @ pair)
        if float(np.min(np.linalg.norm(pair, axis=0))) < 1e-3 * float(np.linalg.norm(self.weight)):
            return 0.0
        return float(np.sum((np.linalg.qr(pair)[0].T @ rest) ** 2))

    def floor(self, power: Floats) -> Floats:
        """Return the level of each candidate's neighbours."""
        return floor(self.candidates, power, 2 * self.oversampling - 1)

    def refined(self, found: int, orders: list[float]) -> float:
        """Return the order beside a candidate at which the power is largest."""
        from scipy.optimize import minimize_scalar

        basis, rest = self.left(orders)
        step = float(self.candidates[1] - self.candidates[0])
        centre = float(self.candidates[found])
        best = minimize_scalar(
            lambda f: -self._power(f, basis, rest),
            bounds=(centre - step, centre + step),
            method="bounded",
        )
        return float(best.x)


def _result(
    search: _Search,
    orders: list[float],
    chance: list[float],
    rotary: bool,
    travel: float,
    alpha: float,
) -> RippleOrders:
    theta = np.linalg.lstsq(search.columns(orders), search.u * search.weight, rcond=None)[0]
    pairs = theta[1:].reshape(-1, 2)
    rank = np.argsort(-np.hypot(pairs[:, 0], pairs[:, 1]), kind="stable")
    size = 2.0 / float(np.sum(search.weight**2))  # power -> amplitude², for even coverage
    floor = search.floor(search.powers(orders))
    return RippleOrders(
        rotary=rotary,
        orders=np.array(orders)[rank],
        cosine=pairs[rank, 0],
        sine=pairs[rank, 1],
        chance=np.array(chance)[rank],
        mean=float(theta[0]),
        searched=search.candidates,
        spectrum=np.sqrt(size * search.powers([])),
        threshold=np.sqrt(size * floor * ratio_at(alpha / len(search.candidates))),
        travel=travel,
    )


NEIGHBOURS = 24
"""N."""


def floor(orders: Floats, power: Floats, guard: int) -> Floats:
    """Return the median power of each line's neighbours.

    Neighbours are compared after the spectrum's slope is taken out, else a floor that falls with
    the order would make the lowest orders stand out.

    Args:
        orders: ascending, shape (m,).
        power: of each; zero takes a line out, shape (m,).
        guard: lines on either side that are no neighbours, since a strong line leaks into them.
    """
    slope = _slope(orders, power)
    level = power / slope
    places = np.arange(len(power))
    out = np.zeros(len(power))
    for k in places:
        distance = np.abs(places - k)
        order = np.argsort(distance, kind="stable")
        near: Ints = order[(distance[order] > guard) & (power[order] > 0.0)][:NEIGHBOURS]
        if len(near) == NEIGHBOURS:
            out[k] = np.sort(level[near])[NEIGHBOURS // 2 - 1]
    return out * slope


def _slope(orders: Floats, power: Floats) -> Floats:
    """Return the trend of the power, a parabola in logarithmic scales fitted by least moduli."""
    alive = power > 0.0
    x = np.log(orders / orders[-1])
    columns = np.stack([np.ones_like(x), x, x**2], axis=1)
    y = np.log(np.where(alive, power, 1.0))
    weight = alive.astype(float)
    theta = np.zeros(3)
    for _ in range(30):
        theta = np.linalg.lstsq(columns * weight[:, None], y * weight, rcond=None)[0]
        # The square root of the usual weight 1/|r|, with a floor that keeps it bounded.
        weight = alive / np.sqrt(np.maximum(np.abs(y - columns @ theta), 0.05))
    return np.asarray(np.exp(columns @ theta))


def false_alarm(ratio: Floats) -> Floats:
    """Return the chance that noise exceeds ``ratio`` times the median of its neighbours."""
    i = np.arange(NEIGHBOURS // 2)
    left = (NEIGHBOURS - i)[:, None]
    return np.asarray(np.prod(left / (left + np.atleast_1d(ratio)), axis=0))


def ratio_at(chance: float) -> float:
    """Return the ratio to the neighbours' median that noise exceeds with a given chance."""
    from scipy.optimize import brentq

    return float(brentq(lambda x: float(false_alarm(np.array([x]))[0]) - chance, 0.0, 1e6))


def strongest(power: Floats, level: Floats, alpha: float) -> tuple[int | None, float]:
    """Return the strongest line that stands out, and the chance of naming any by accident.

    Args:
        power: of each line, shape (m,).
        level: see :func:`floor`.
        alpha: largest chance allowed; above it no line is returned.
    """
    alive = (power > 0.0) & (level > 0.0)
    ratio = np.where(alive, power / np.where(alive, level, 1.0), 0.0)
    chance = np.minimum(false_alarm(ratio) * max(int(alive.sum()), 1), 1.0)
    named = np.flatnonzero(alive & (chance < alpha))
    if not len(named):
        return None, 1.0
    best = int(named[np.argmax(power[named])])
    return best, float(chance[best])
