"""Are the residuals white? Durbin-Watson and Ljung-Box per axis, holes in the time axis respected.

    d = sum (e_t - e_{t-1})^2 / sum e_t^2           2 for white residuals, 0 for a slow drift
    Q = n (n + 2) sum_l rho_l^2 / (n_l)             chi-square with as many degrees as lags

Durbin & Watson 1950, doi:10.1093/biomet/37.3-4.409; Ljung & Box 1978, doi:10.1093/biomet/65.2.297.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from pinotwin.arrays import Floats
from pinotwin.solve.problem import Problem


@dataclass(frozen=True)
class Whiteness:
    """Whiteness per axis, in the order of ``problem.slices``; arrays of shape (axes,).

    Attributes:
        durbin_watson: 2 for white residuals.
        ljung_box: statistic over ``lags`` lags.
        p_value: chance of a larger statistic if the residuals were white.
        lags: number of lags looked at.
        autocorrelation: of the residuals, shape (axes, lags).
    """

    durbin_watson: Floats
    ljung_box: Floats
    p_value: Floats
    lags: int
    autocorrelation: Floats


def whiteness(problem: Problem, residual: Floats, lags: int = 20) -> Whiteness:
    """Return the whiteness of residuals, shape (rows,), over ``lags`` lags."""
    axes = list(problem.slices.values())
    rho = np.zeros((len(axes), lags))
    durbin, box = np.full(len(axes), 2.0), np.zeros(len(axes))
    for i, rows in enumerate(axes):
        e = np.zeros((len(residual), 2))
        e[rows, 0], e[rows, 1] = residual[rows], 1.0
        slots = problem.grid.spread(e, lags)
        value, there = slots[:, 0], slots[:, 1]
        power = float(value @ value)
        if power <= 0:
            continue
        n = float(there.sum())
        for lag in range(1, lags + 1):
            pairs = float(there[lag:] @ there[:-lag])
            if pairs > 0:
                rho[i, lag - 1] = (value[lag:] @ value[:-lag] / pairs) / (power / n)
                box[i] += n * (n + 2) * rho[i, lag - 1] ** 2 * (pairs / n) / n
        durbin[i] = _durbin_watson(value, there)
    return Whiteness(durbin, box, np.asarray(chdtrc(lags, box)), lags, rho)


def _durbin_watson(value: Floats, there: Floats) -> float:
    pair = (there[1:] > 0) & (there[:-1] > 0)
    if not pair.any():
        return 2.0
    change = np.mean(np.diff(value)[pair] ** 2)
    return float(change / (value @ value / there.sum()))
