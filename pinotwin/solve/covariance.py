r"""Covariance of theta that stays true when the residuals are coloured.

Every second of all axes together is left out in turn (delete-a-group jackknife: Quenouille 1956; Efron 1982,
chapter 2). With F F' = (W'W)^-1, V = W F and the noise levels as found, the fit without block g is

    theta_g = theta - F (I - V_g' V_g)^-1 V_g' e_g,   cov = (1 - 1/G) sum over g of (theta_g - theta) (theta_g - theta)'

so that neither correlation within a second, nor between axes, nor noise that varies with the motion spoils it, and
what the fit took from the residuals is given back. A parameter is told by fewer than all blocks, a knot of a table by
those that pass it: with w_g the information on it in each, their effective number is (sum w)^2 / sum w^2 (Carter,
Schnepel & Steigerwald 2017, doi:10.1162/REST_a_00639), and one less are its degrees of freedom for Student's t.

Behind a turn no law of dry friction is true: what it does to theta lies between nothing and the step d without these
rows, evenly: in the mean square d d' / 3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.solve.jackknife import moved
from pinotwin.solve.problem import Problem
from pinotwin.solve.rank import r_factor

Inference = Literal["blocks", "ols", "none"]
"""By blocks left out; as of independent residuals, wrong for filtered data; or nan, where the estimate is all."""


@dataclass(frozen=True)
class Spread:
    """Covariance and the degrees of freedom of its estimate."""

    covariance: Floats  # of the estimate in the seen directions, shape (p, p)
    dof: Floats  # degrees of freedom for Student's t, of each parameter, shape (p,)


def spread(
    problem: Problem, sigma: Floats, error: Floats, root: Floats, inference: Inference = "blocks"
) -> Spread:
    """Return the covariance of a weighted fit with residuals ``error`` (rows,) and noise ``sigma`` of each axis.

    ``root`` is F with F F' = (W'W)^-1 of the rows over their noise, shape (p, rank).
    """
    p, rank = root.shape
    if inference == "none":
        return Spread(np.full((p, p), np.nan), np.full(p, np.nan))
    e = error / np.asarray(sigma)[problem.axis_place]
    if inference == "ols":
        left = max(len(error) - rank, 1)
        level = np.sum(e**2) / left
        return Spread(root @ root.T * level, np.full(p, float(left)))

    def step(rows: Mapping[int, slice | Ints]) -> tuple[Floats, Floats]:
        """Return V, (k, rank), for the rows' V'V in directions of ``root``, and how far the fit moves without them."""
        parts = [problem.dense(part, e) for part in rows.values()]
        short = [(own, r_factor(A) if len(A) > len(own) else A) for own, A in parts]
        V = np.concatenate([A[:, :-1] @ (root[own] / s) for (own, A), s in zip(short, sigma, strict=True)])
        return V, root @ moved(V, np.concatenate([A[:, -1] for _, A in short]))

    told, steps = np.zeros((2, p)), []
    for rows in problem.seconds():
        V, d = step(rows)
        share = np.sum((V @ root.T) ** 2, axis=0)
        told += share, share**2
        steps.append(d)
    dof = np.maximum(told[0] ** 2 / np.maximum(told[1], 1e-300) - 1.0, 1.0)
    covariance = np.array(steps).T @ np.array(steps) * (1.0 - 1.0 / len(steps))
    if problem.turning is not None:
        _, d = step({i: s.start + np.flatnonzero(problem.turning[s]) for i, s in problem.slices.items()})
        covariance += np.outer(d, d) / 3.0
    return Spread(covariance, dof)
