r"""Covariance of theta that stays true when the residuals are coloured.

Every second of all axes together is a block g. With F F' = (W'W)^-1, V = W F and the noise levels as found,

    d_g = F (I - V_g' V_g)^-1/2 V_g' e_g,   cov = sum over g of d_g d_g'

so that neither correlation within a second, nor between axes, nor noise that varies with the motion spoils it, and
what the fit took from the residuals is given back: of white noise cov is F F' in the mean (Bell & McCaffrey 2002;
Pustejovsky & Tipton 2018, doi:10.1080/07350015.2016.1247004). A parameter is told by fewer than all blocks, a knot of
a table by those that pass it: with w_g the information on it in each, their effective number is (sum w)^2 / sum w^2
(Carter, Schnepel & Steigerwald 2017, doi:10.1162/REST_a_00639), and one less are its degrees of freedom.

Behind a turn no law of dry friction is true: what it does to theta lies between nothing and the step d without these
rows, evenly: d d' / 3 in the mean square, with degrees of freedom beside the others' (Welch 1947, Satterthwaite 1946).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.solve.jackknife import moved
from pinotwin.solve.problem import Problem
from pinotwin.solve.rank import r_factor

Inference = Literal["blocks", "ols", "none"]
"""By seconds, as above; as of independent residuals, wrong for filtered data; or nan, where the estimate is all."""


def spread(
    problem: Problem, sigma: Floats, error: Floats, root: Floats, inference: Inference = "blocks"
) -> tuple[Floats, Floats]:
    """Return the covariance of a weighted fit, shape (p, p), and degrees of freedom for Student's t, shape (p,).

    It leaves ``error`` (rows,) at noise ``sigma`` of each axis; ``root`` is F, F F' = (W'W)^-1 of rows over theirs.
    """
    p, rank = root.shape
    if inference == "none":
        return np.full((p, p), np.nan), np.full(p, np.nan)
    e = error / np.asarray(sigma)[problem.axis_place]
    if inference == "ols":
        left = max(len(error) - rank, 1)
        level = np.sum(e**2) / left
        return root @ root.T * level, np.full(p, float(left))

    def step(rows: Mapping[int, slice | Ints], power: float) -> tuple[Floats, Floats]:
        """Return V, (k, rank), for the rows' V'V in directions of ``root``, and the step of a power, see above."""
        parts = [problem.dense(part, e) for part in rows.values()]
        short = [(own, r_factor(A) if len(A) > len(own) else A) for own, A in parts]
        V = np.concatenate([A[:, :-1] @ (root[own] / s) for (own, A), s in zip(short, sigma, strict=True)])
        return V, root @ moved(V, np.concatenate([A[:, -1] for _, A in short]), power=power)

    told, steps = np.zeros((2, p)), []
    for rows in problem.seconds():
        V, d = step(rows, 0.5)
        share = np.sum((V @ root.T) ** 2, axis=0)
        told += share, share**2
        steps.append(d)
    dof = np.maximum(told[0] ** 2 / np.maximum(told[1], 1e-300) - 1.0, 1.0)
    covariance = np.array(steps).T @ np.array(steps)
    if problem.turning is not None:
        _, d = step({i: s.start + np.flatnonzero(problem.turning[s]) for i, s in problem.slices.items()}, 1.0)
        alone, covariance = np.diag(covariance), covariance + np.outer(d, d) / 3.0
        dof /= np.maximum(alone / np.maximum(np.diag(covariance), 1e-300), 1e-6) ** 2
    return covariance, dof
