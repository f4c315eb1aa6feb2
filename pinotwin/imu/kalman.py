"""Kalman filter and smoother for linear, time-varying models (Rauch, Tung and Striebel 1965, DOI 10.2514/3.3166).

x[k+1] = F[k] x[k] + u[k] + w[k],  w ~ N(0, Q[k])
z[k]   = H[k] x[k] + e[k],         e ~ N(0, r[k]) independent; a variance of infinity leaves one out
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.system.kernels import compiled


@dataclass(frozen=True)
class LinearModel:
    """The matrices of the module's equations; a leading length of 1 means constant."""

    F: Floats  # transitions, (n - 1 or 1, d, d)
    u: Floats  # known inputs, (n - 1, d)
    Q: Floats  # covariance of the process noise, (n - 1 or 1, d, d)
    H: Floats  # measurement rows, (n or 1, m, d)
    x0: Floats  # first state, (d,)
    P0: Floats  # its covariance, (d, d)

    def smooth(self, z: Floats, variance: Floats) -> tuple[Floats, Floats]:
        """Return smoothed states (n, d) and covariances (n, d, d) for measurements (n, m) with variances (n, m)."""
        return backward(np.ascontiguousarray(self.F, dtype=float), *self._filtered(z, variance)[:4])

    def log_likelihood(self, z: Floats, variance: Floats) -> float:
        """Return the log-likelihood of measurements alone (one forward pass)."""
        return float(self._filtered(z, variance)[4])

    def _filtered(self, z: Floats, variance: Floats) -> tuple[Floats, Floats, Floats, Floats, float]:
        """Return predicted states and covariances, the filtered ones, and the log-likelihood."""
        given = (self.F, self.u, self.Q, self.H, z, np.broadcast_to(variance, np.shape(z)), self.x0, self.P0)
        return _filter(*(np.ascontiguousarray(x, dtype=float) for x in given))


@compiled
def update(x, P, h, z, r):  # type: ignore[no-untyped-def]
    """Take one measurement z = h x with variance r into state and covariance; return its log-likelihood."""
    d = len(x)
    Ph = P @ h
    s = r + h @ Ph
    e = z - h @ x
    for i in range(d):
        x[i] += Ph[i] * e / s
        for j in range(d):
            P[i, j] -= Ph[i] * Ph[j] / s
    return -0.5 * (e * e / s + np.log(2.0 * np.pi * s))


@compiled
def _filter(F, u, Q, H, z, r, x0, P0):  # type: ignore[no-untyped-def]  # noqa: PLR0913
    n, m = z.shape
    d = len(x0)
    xp, xf = np.empty((n, d)), np.empty((n, d))
    Pp, Pf = np.empty((n, d, d)), np.empty((n, d, d))
    x, P = x0.copy(), P0.copy()
    likelihood = 0.0
    for k in range(n):
        if k > 0:
            A = F[min(k - 1, len(F) - 1)]
            x = A @ x + u[k - 1]
            P = A @ P @ A.T + Q[min(k - 1, len(Q) - 1)]
        xp[k], Pp[k] = x, P
        for i in range(m):
            if np.isfinite(r[k, i]):
                likelihood += update(x, P, H[min(k, len(H) - 1), i], z[k, i], r[k, i])
        P = 0.5 * (P + P.T)
        xf[k], Pf[k] = x, P
    return xp, Pp, xf, Pf, likelihood


@compiled
def backward(F, xp, Pp, xf, Pf):  # type: ignore[no-untyped-def]
    """Return smoothed states and covariances of transitions, predictions and filtered ones."""
    n, d = xf.shape
    x, P = xf.copy(), Pf.copy()
    for k in range(n - 2, -1, -1):
        A = F[min(k, len(F) - 1)]
        scale = 1.0 / np.sqrt(np.diag(Pp[k + 1]) + 1e-300)
        S = Pp[k + 1] * np.outer(scale, scale) + 1e-14 * np.eye(d)
        right = np.ascontiguousarray((A @ Pf[k]) * scale.reshape(d, 1))
        C = np.ascontiguousarray((np.linalg.solve(S, right) * scale.reshape(d, 1)).T)
        x[k] = xf[k] + C @ (x[k + 1] - xp[k + 1])
        P[k] = Pf[k] + C @ (P[k + 1] - Pp[k + 1]) @ C.T
    return x, P
