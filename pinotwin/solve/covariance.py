r"""Covariance of theta that stays true when the residuals are coloured.

    cov = F Omega F',   Omega = sum over lags of k(lag) E[s(t) s(t + lag)'],   s(t) = F' W(t)' e(t)

with F F' = (W'W)^-1 and the scores ``s`` summed over the axes of one instant, so that correlation
between axes counts too. Estimates of Omega:

* ``"hac"``: Bartlett kernel on the scores (Newey & West 1987, doi:10.2307/1913610) with Andrews'
  bandwidth (1991, doi:10.2307/2938229), never shorter than 1.3 sqrt(T) as Lazarus, Lewis, Stock &
  Watson 2018, doi:10.1080/07350015.2018.1506926, ask; the kernel's downward bias is taken out and
  the degrees of freedom are those of the kernel (Kiefer & Vogelsang 2005,
  doi:10.1017/S0266466605050565). True also where the noise level varies with the motion.
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
from typing import Literal

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.solve.problem import Problem
from pinotwin.solve.sandwich import bartlett

Inference = Literal["hac", "ols", "none"]


@dataclass(frozen=True)
class Spread:
    """Covariance and the degrees of freedom of its estimate."""

    covariance: Floats  # of the estimate in the seen directions, shape (p, p)
    dof: float  # degrees of freedom for Student's t
    lags: int  # bandwidth used, in slots of the time axis; 0 where none


def spread(
    problem: Problem, sigma: Floats, error: Floats, root: Floats, inference: Inference = "hac"
) -> Spread:
    """Return the covariance of a weighted fit with residuals ``error`` (rows,) and noise ``sigma`` of each axis.

    ``root`` is F with F F' = (W'W)^-1 of the rows over their noise, shape (p, rank).
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
        left = np.maximum(1 - np.einsum("nk,nk->n", V, V), 0.2)  # of a row's own noise
        V *= (error / left)[:, None]
        Omega, dof, lags = _hac(problem, V)
    else:
        Omega = np.eye(root.shape[1]) * np.mean(error**2)
        dof, lags = float(max(len(error) - root.shape[1], 1)), 0
    factor = inflation(Omega, error)
    if inference == "hac":
        factor = max(factor * (1 - min(root.shape[1] / len(error), 0.5)), 1.0)
    return Spread(root @ (Omega * factor) @ root.T, dof, lags)


def inflation(Omega: Floats, error: Floats, most: float = 4.0) -> float:
    """Return n / (n - p_eff), which gives the residuals back what the fit took; beyond ``most`` rows are too few."""
    power = float(error @ error)
    left = power - float(np.trace(Omega))
    return power / left if left * most > power else most


def _hac(problem: Problem, scores: Floats) -> tuple[Floats, float, int]:
    """Return Omega by the Bartlett kernel, its degrees of freedom and the bandwidth."""
    T = problem.grid.times
    lags = bandwidth(problem, scores)
    total = bartlett(problem.grid.spread(scores, lags), lags)
    b = min(lags / T, 1.0)
    return total / (1 - b + b * b / 3), max(1.5 / b, 1.0), lags


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
