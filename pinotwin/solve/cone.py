"""The two small semidefinite programs behind physical consistency, written for Clarabel.

Both search d, the standard parameters' distance from the prior in units of their size, among
pseudo-inertias with all eigenvalues above the margin (Goulart & Chen 2024, arXiv:2405.12762).
"""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints, Mask

TOLERANCES = (1e-10, 1e-8, 1e-6)
"""The tightest first: weakly seen bodies can leave a problem too stiff for it."""
SOLVED = (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
TOO_STIFF = (
    clarabel.SolverStatus.InsufficientProgress,
    clarabel.SolverStatus.MaxIterations,
    clarabel.SolverStatus.NumericalError,
)
"""Ends that a looser tolerance may help."""
UPPER = tuple((i, j) for j in range(4) for i in range(j + 1))
"""Upper triangle of a 4 by 4 matrix, column by column, as Clarabel stacks it."""


@dataclass(frozen=True)
class Cone:
    """Where consistent parameters may lie.

    Attributes:
        maps: per body, the linear map from its ten parameters to the stacked upper triangle of its
            scaled pseudo-inertia, off-diagonals times sqrt(2), shape (10, 10).
        indices: per body, its ten indices in pi.
        margins: per body, the smallest eigenvalue allowed.
        rotors: indices in pi that are not negative.
        free: parameters that may move; the others stay at the prior, shape (p_std,).
        pi0: prior, shape (p_std,).
        size: size of each parameter, shape (p_std,).
    """

    maps: tuple[Floats, ...]
    indices: tuple[Ints, ...]
    margins: Floats
    rotors: Ints
    free: Mask
    pi0: Floats
    size: Floats

    def rows(self) -> tuple[Floats, Floats, list[clarabel.SupportedConeT]]:
        """Return A, b and the cones of b - A d in cones, for d of the free parameters."""
        A, b, cones = [], [], []
        for M, index, margin in zip(self.maps, self.indices, self.margins, strict=True):
            if not self.free[index].any():
                continue
            row = np.zeros((10, len(self.pi0)))
            row[:, index] = -M * self.size[index]
            A.append(row[:, self.free])
            b.append(M @ self.pi0[index] - margin * stack_upper(np.eye(4)))
            cones.append(clarabel.PSDTriangleConeT(4))
        rotors = self.rotors[self.free[self.rotors]]
        if len(rotors):
            row = np.zeros((len(rotors), len(self.pi0)))
            row[np.arange(len(rotors)), rotors] = -self.size[rotors]
            A.append(row[:, self.free])
            b.append(self.pi0[rotors])
            cones.append(clarabel.NonnegativeConeT(len(rotors)))
        width = int(self.free.sum())
        return np.concatenate([np.zeros((0, width)), *A]), np.concatenate([[], *b]), cones

    def parameters(self, d: Floats) -> Floats:
        """Return pi for a distance d of the free parameters."""
        pi = self.pi0.copy()
        pi[self.free] += self.size[self.free] * d
        return pi


def stack_upper(J: Floats) -> Floats:
    """Return the upper triangle of a symmetric 4 by 4 matrix, off-diagonals times sqrt(2)."""
    return np.array([J[i, j] * (1.0 if i == j else np.sqrt(2)) for i, j in UPPER])


def nearest_with(cone: Cone, P: Floats, beta: Floats) -> Floats | None:
    """Return the consistent pi nearest the prior with P pi = beta exactly; None if there is none.

    Args:
        cone: where pi may lie.
        P: shape (b, p_std).
        beta: shape (b,).
    """
    A, b, cones = cone.rows()
    E = P[:, cone.free] * cone.size[cone.free]
    gap = beta - P @ cone.pi0
    size = np.linalg.norm(E, axis=1)
    if ((size == 0) & (np.abs(gap) > 1e-12 * np.abs(beta))).any():
        return None
    E, gap = E[size > 0] / size[size > 0, None], gap[size > 0] / size[size > 0]
    d = _solve(
        np.eye(E.shape[1]),
        np.zeros(E.shape[1]),
        np.concatenate([E, A]),
        np.concatenate([gap, b]),
        [clarabel.ZeroConeT(len(gap)), *cones],
    )
    if d is None:
        return None
    d = d + np.linalg.lstsq(E, gap - E @ d)[0]
    return cone.parameters(d)


def best(
    cone: Cone, model: Floats, offset: Floats, slack: Floats, eps: float, unit: float = 1.0
) -> tuple[Floats, Floats] | None:
    """Return pi and u that minimise || M (d, u) - offset ||^2 + eps || (d, u) ||^2, u >= slack.

    Args:
        cone: where pi may lie.
        model: M, shape (k, free + n): first the columns of d, then those of u.
        offset: shape (k,).
        slack: smallest values of u, -inf for free, shape (n,).
        eps: weight of the prior.
        unit: in which offset and u are counted. A residual of thousands of standard deviations beside steps of d near
            1 keeps Clarabel from its end; counted in its own length it does not, but the prior is then lost.
    """
    A, b, cones = cone.rows()
    k, width = model.shape
    count = A.shape[1]
    bound = np.flatnonzero(np.isfinite(slack))
    below = np.zeros((len(bound), width))
    below[np.arange(len(bound)), count + bound] = -1.0
    scaled = np.concatenate([model[:, :count] / unit, model[:, count:]], axis=1)
    left = np.concatenate([scaled, np.pad(A, ((0, 0), (0, width - count))), below])
    rows = np.concatenate([left, np.eye(len(left), k) * -1.0], axis=1)
    prior = np.concatenate([np.full(count, eps / unit**2), np.full(width - count, eps)])
    quadratic = np.diag(np.concatenate([prior, np.ones(k)]))
    x = _solve(
        quadratic,
        np.zeros(width + k),
        rows,
        np.concatenate([offset / unit, b, -slack[bound] / unit]),
        [clarabel.ZeroConeT(k), *cones, clarabel.NonnegativeConeT(len(bound))],
    )
    return None if x is None else (cone.parameters(x[:count]), unit * x[count:width])


def _solve(Q: Floats, q: Floats, A: Floats, b: Floats, cones: list[clarabel.SupportedConeT]) -> Floats | None:
    """Return the minimiser of x'Qx/2 + q'x with b - A x in the cones, or None."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    for tolerance in TOLERANCES:
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        solver = clarabel.DefaultSolver(
            scipy.sparse.csc_matrix(Q), q, scipy.sparse.csc_matrix(A), b, cones, settings
        )
        found = solver.solve()
        if found.status in SOLVED:
            return np.array(found.x)
        if found.status not in TOO_STIFF:
            return None
    return None
