r"""Covariance of theta that stays true when the residuals are coloured.

    cov = F Omega F',   Omega = sum over lags of k(lag) E[s(t) s(t + lag)'],   s(t) = F' W(t)' e(t)

with F F' = (W'W)^-1 and the scores ``s`` summed over the axes of one instant, so that correlation
between axes counts too. Three estimates of Omega:

* ``"hac"``: Bartlett kernel on the scores (Newey & West 1987, doi:10.2307/1913610) with Andrews'
  bandwidth (1991, doi:10.2307/2938229), never shorter than 1.3 sqrt(T) as Lazarus, Lewis, Stock &
  Watson 2018, doi:10.1080/07350015.2018.1506926, ask; the kernel's downward bias is taken out and
  the degrees of freedom are those of the kernel (Kiefer & Vogelsang 2005,
  doi:10.1017/S0266466605050565). True also where the noise level varies with the motion.
* ``"stationary"``: the residuals' own spectrum, as an autoregression per axis with correlated
  innovations. Narrower and steadier, if the noise is the same everywhere.
* ``"ols"``: independent residuals. For comparison; it is wrong for filtered data.
* ``"none"``: no covariance (nan), where only the estimate is asked for.

A fit with p parameters takes power away from the residuals. For white ones that is p / n; under
coloured noise it is tr(Omega) / n in units of the residual variance, often five times more, and
Omega is multiplied by n / (n - tr). The kernel estimate also divides each residual by one minus its
leverage (the jackknife's HC3, MacKinnon & White 1985, doi:10.1016/0304-4076(85)90158-7): rows that
alone carry a parameter have residuals too small to judge by. Rows missing inside a block are slots
of zero score (Parzen 1963; Datta & Du 2012).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from scipy.signal import lfilter

from pinotwin.arrays import Floats
from pinotwin.errors import DataError, nearest
from pinotwin.solve.autoregression import Autoregression, autoregressions, whiten
from pinotwin.solve.problem import Problem

Inference = Literal["hac", "stationary", "ols", "none"]
MAX_INFLATION = 4.0
"""Largest factor n / (n - p_eff): beyond it the data are too few for any estimate."""
LEAST_LEFT = 0.2
"""Smallest share of a row's own noise that its residual is taken to keep."""
CHUNK = 1 << 16
"""Slots whose windows are summed at once: those of an hour of five axes fill a gigabyte."""


@dataclass(frozen=True)
class Spread:
    """Covariance and the degrees of freedom of its estimate.

    Attributes:
        covariance: of the estimate in the seen directions, shape (p, p).
        dof: degrees of freedom for Student's t.
        lags: bandwidth used, in slots of the time axis; 0 where none.
    """

    covariance: Floats
    dof: float
    lags: int


def spread(
    problem: Problem, sigma: Floats, error: Floats, root: Floats, inference: Inference = "hac"
) -> Spread:
    """Return the covariance of a weighted least-squares estimate.

    Args:
        problem: rows.
        sigma: noise level of each axis that has any.
        error: residuals, shape (rows,).
        root: F with F F' = (W'W)^-1 of rows divided by their noise level, shape (p, rank).
        inference: which estimate of Omega.
    """
    if inference == "none":
        return Spread(np.full((len(root), len(root)), np.nan), np.nan, 0)
    # One basis of all those of F: which of equally long columns a pivoted factorisation takes first is a matter of
    # rounding, and the bandwidth depends on it (standard errors of a real robot moved by 2 %).
    root = np.asarray(np.linalg.qr(root.T, mode="r")).T
    level = np.asarray(sigma)[problem.axis_place]
    V, error = problem.product(root), error / level
    V /= level[:, None]  # in place, as below: an hour of five axes is a gigabyte
    if inference == "hac":
        left = np.maximum(1 - np.einsum("nk,nk->n", V, V), LEAST_LEFT)
        V *= (error / left)[:, None]
        Omega, dof, lags = _hac(problem, V)
    elif inference == "stationary":
        Omega, dof, lags = _stationary(problem, V, error)
    elif inference == "ols":
        Omega = np.eye(root.shape[1]) * np.mean(error**2)
        dof, lags = float(max(len(error) - root.shape[1], 1)), 0
    else:
        raise DataError(f"unknown inference {inference!r}; {nearest(inference, get_args(Inference))}")
    factor = inflation(Omega, error)
    if inference == "hac":
        factor = max(factor * (1 - min(root.shape[1] / len(error), 0.5)), 1.0)
    return Spread(root @ (Omega * factor) @ root.T, dof, lags)


def inflation(Omega: Floats, error: Floats) -> float:
    """Return n / (n - p_eff), which gives the residuals back what the fit took."""
    power = float(error @ error)
    left = power - float(np.trace(Omega))
    return power / left if left * MAX_INFLATION > power else MAX_INFLATION


def _hac(problem: Problem, scores: Floats) -> tuple[Floats, float, int]:
    """Return Omega by the Bartlett kernel, its degrees of freedom and the bandwidth."""
    T = problem.grid.times
    lags = bandwidth(problem, scores)
    running = problem.grid.spread(scores, lags)
    np.cumsum(running, axis=0, out=running)
    total = running[:lags].T @ running[:lags]
    for start in range(lags, len(running), CHUNK):
        stop = min(start + CHUNK, len(running))
        window = running[start:stop] - running[start - lags : stop - lags]
        total += window.T @ window
    b = min(lags / T, 1.0)
    return total / (lags * (1 - b + b * b / 3)), max(1.5 / b, 1.0), lags


def bandwidth(problem: Problem, scores: Floats) -> int:
    """Return Andrews' bandwidth for the Bartlett kernel, bounded below and above, in slots."""
    T = problem.grid.times
    total = problem.grid.spread(scores, 1)
    there = problem.grid.spread(np.ones((len(scores), 1)), 1)[:, 0] > 0
    pair = there[1:] & there[:-1]
    variance = np.einsum("tk,tk->k", total, total)
    ok = variance > 0
    share = float(np.mean(pair)) / max(float(np.mean(there)), 1e-12)
    lagged = np.einsum("tk,tk->k", total[:-1], total[1:])  # holes are zero
    rho = lagged[ok] / variance[ok] / max(share, 1e-12)
    rho = np.clip(rho, -0.97, 0.97)
    weight = (1 - rho**2) ** 2 / (1 - rho) ** 4
    alpha = np.sum(weight * 4 * rho**2 / ((1 - rho**2) ** 2)) / max(float(np.sum(weight)), 1e-12)
    andrews = 1.1447 * (alpha * T) ** (1 / 3)
    longest = max(problem.grid.lengths)
    return int(np.clip(np.ceil(max(andrews, 1.3 * np.sqrt(T))), 1, max(min(T // 6, longest), 1)))


def _stationary(problem: Problem, V: Floats, error: Floats) -> tuple[Floats, float, int]:
    """Return Omega = V' Gamma V with Gamma from an autoregression of the residuals per axis."""
    order = int(np.clip(problem.grid.times // 20, 1, 16))
    models = autoregressions(problem, error, order)
    Omega = np.zeros((V.shape[1], V.shape[1]))
    tail = max(model.memory for model in models)
    filtered = [_coloured(problem, V, i, model, tail) for i, model in enumerate(models)]
    Q = _innovations(problem, error, models)
    for i, Zi in enumerate(filtered):
        for j, Zj in enumerate(filtered):
            Omega += Q[i, j] * (Zi.T @ Zj)
    dof = max(problem.grid.times - V.shape[1] / len(models), 1.0)
    return 0.5 * (Omega + Omega.T), dof, order


def _coloured(problem: Problem, V: Floats, axis: int, model: Autoregression, tail: int) -> Floats:
    """Return the columns of one axis filtered backwards in time by 1/A, block by block."""
    slots = problem.grid.spread(np.where((problem.axis_place == axis)[:, None], V, 0.0), tail)
    starts = problem.grid.starts(tail)
    denominator = np.concatenate([[1.0], -model.coefficients])
    for a, b in pairwise(starts):
        reverse = np.roll(slots[a:b], tail, axis=0)[::-1]
        slots[a:b] = lfilter([1.0], denominator, reverse, axis=0)
    return slots


def _innovations(problem: Problem, error: Floats, models: tuple[Autoregression, ...]) -> Floats:
    """Return the covariance of the axes' innovations, shape (axes, axes)."""
    white, keep = whiten(problem, error[:, None], models)
    mine = problem.axis_place[:, None] == np.arange(len(models))
    there = problem.grid.spread((mine & keep[:, None]).astype(float), 1)
    value = problem.grid.spread(np.where(mine & keep[:, None], white, 0.0), 1)
    return value.T @ value / np.maximum(there.T @ there, 1.0)
