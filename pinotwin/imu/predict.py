"""What gyro and accelerometer should read for a set of parameters, and the Jacobian, for one run.

    gyro   y = (I + diag(s)) (I + N) u + a |u| + c u³ + G f_s + b(t),    u = R_ST (w + axis delta')
    accel  y = (I + E) R_ST f + b_a
    f      = a - R' g + (w' x p + w x w x p) + delta'' axis x (arm + p)
             + 2 delta' axis x (w x p) - delta axis x f0

(f0: f without delta), at t_ref = (1 + skew) t_imu + offset after the sensors' low-pass. delta is linear in the load's
gains, the sag and the start; :class:`Layout` names the columns: shared parameters first, those of the run last.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from pinotwin.arrays import Floats
from pinotwin.imu import rotation as rot
from pinotwin.imu.filters import group_delay, low_pass
from pinotwin.imu.mode import Response, decay, respond
from pinotwin.imu.runs import FineRun, ImuRun, Priors, ServoRun, interpolate
from pinotwin.signals import hats

_PAIRS = ((0, 1), (0, 2), (1, 2))  # N is symmetric: its antisymmetric part is in R_ST


class Layout:
    """Names and places of the parameters: shared ones, then those of one run."""

    def __init__(self, loads: int, knots: int) -> None:
        triples = ("sag", "turn", "cross", "asymmetry", "cubic")
        sizes = {"mode": 2, "gain": loads, **dict.fromkeys(triples, 3), "g_sensitivity": 9}
        sizes |= {"accel_matrix": 9, "accel_bias": 3, "position": 3, "gravity": 3, "accel_delay": 1}
        self.shared, self.knots = sum(sizes.values()), knots
        sizes |= {"clock": 2, "scale": 3, "start": 2, "bias": 3 * knots}
        ends = np.cumsum([0, *sizes.values()]).tolist()
        self.at = {name: slice(*ends[k : k + 2]) for k, name in enumerate(sizes)}
        self.size: int = ends[-1]
        # of the parameters that the deflection's columns belong to
        self.places = np.r_[*(self.at[name] for name in ("mode", "gain", "sag", "start"))]

    def __getitem__(self, name: str) -> slice:
        return self.at[name]


class RunModel:
    """One run, prepared: filtered rigid motion, stamps, bias knots."""

    def __init__(self, servo: ServoRun, imu: ImuRun, priors: Priors, start: Floats) -> None:
        """Prepare; ``start`` holds t_ref of every stamp, (m,), NaN where unknown."""
        self.priors = priors
        self.fine = f = FineRun(servo)
        margin = 0.02
        inside = np.isfinite(start) & (start > f.t[0] + margin) & (start < f.t[-1] - margin)
        self.read = np.hstack([imu.gyr, imu.acc])[inside]  # (m, 6)
        self.base = start[inside]
        self.pivot = float(np.mean(self.base))
        self.centred = self.base - self.pivot
        # of the bias; all runs take the most of any
        self.knots = max(2, 1 + round(np.ptp(self.base) / priors.knots))
        self.interval = float(np.median(np.diff(self.base)))
        self.delay = group_delay(priors.gyro_cutoff)
        up = np.einsum("nji->nij", f.R)
        S, W = rot.skew(f.w_dot), rot.skew(f.w)
        rigid = np.concatenate([f.a, up.reshape(-1, 9), (S + W @ W).reshape(-1, 9)], axis=1)
        self.w = low_pass(f.w, priors.gyro_cutoff, f.step)
        self.rigid = low_pass(rigid, priors.accel_cutoff, f.step)
        gravity = priors.gravity / np.linalg.norm(priors.gravity)
        cross = np.cross(up @ gravity, f.axis)
        sag = cross - cross[0]
        v = np.gradient(sag, f.step, axis=0)
        self.sag = Response(sag, v, np.gradient(v, f.step, axis=0))
        self.w_max = float(np.max(np.abs(f.w)))

    def seen(self, x: Floats, at: Floats) -> Floats:
        """Return signals (n, k) of the fine clock as the gyro sees them at fractional indices."""
        return interpolate(low_pass(x, self.priors.gyro_cutoff, self.fine.step), at)[0]

    def gyro_columns(self, at: Floats) -> Floats:
        """Return the rigid rate and the joint's axis in the link frame, (m, 2, 3)."""
        axis = interpolate(self.fine.axis, at - self.delay / self.fine.step)[0]
        return np.stack([interpolate(self.w, at)[0], axis], axis=1)

    def readings(self, t: Floats, delta: Floats, R_ST: Floats, p: Floats) -> tuple[Floats, Floats]:
        """Return readings (m, 3) of ideal sensors at p [m]; ``delta``: deflection, rate, acceleration at t, (n, 3)."""
        delta = CubicSpline(t, delta)(self.fine.t)
        at = (self.base - self.fine.t[0]) / self.fine.step
        rigid = self.gyro_columns(at)
        gyr = rigid[:, 0] + rigid[:, 1] * self.seen(delta[:, 1:2], at)
        d, slope = interpolate(low_pass(delta, self.priors.accel_cutoff, self.fine.step), at)
        f, _, _ = self._force(d, slope, self.priors.gravity, p, at)
        return gyr @ R_ST.T, f @ R_ST.T

    def columns(self, theta: Floats, lay: Layout) -> Response:
        """Return delta and its derivatives per parameter (gains, sag, start, mode): fine clock."""
        wn, zeta = np.exp(theta[lay["mode"]])
        gain = theta[lay["gain"]]
        r = respond(self.fine.load, self.fine.step, wn, zeta)
        d = decay(len(self.fine.t), self.fine.step, wn, zeta)
        f = self.fine

        def sensitivity(x: Floats, v: Floats, *, rest: bool) -> Response:
            """With respect to the logarithms of wn and zeta."""
            drive = np.stack([-2 * zeta * v - 2 * wn * x, -2 * wn * v], axis=1)
            return respond(drive * np.array([wn, zeta]), f.step, wn, zeta, rest=rest)

        free = theta[lay["start"]]
        s = sensitivity(r.x @ gain, r.v @ gain, rest=True)
        e = sensitivity(d.x @ free, d.v @ free, rest=False)
        mode = map(np.add, s, e)  # s.a is the whole derivative of a: drive minus the mode's own
        parts = zip(mode, r, self.sag, d, strict=True)
        return Response(*(np.concatenate(p, axis=1) for p in parts))

    def weights(self, theta: Floats, lay: Layout) -> Floats:
        """Return the weights (k,) with which the columns add up to delta, delta' and delta''."""
        return np.concatenate([[0.0, 0.0], theta[lay["gain"]], theta[lay["sag"]], theta[lay["start"]]])

    def predict(self, theta: Floats, lay: Layout, R_ST: Floats) -> tuple[Floats, Floats]:
        """Return readings (m, 6), gyro then accelerometer, and Jacobian (m, 6, p); "turn" turns ``R_ST``."""
        columns = self.columns(theta, lay)
        R = rot.to_matrix(rot.exp(theta[lay["turn"]])) @ R_ST
        clock = theta[lay["clock"]]
        at = (self.base + clock[0] + clock[1] * self.centred - self.fine.t[0]) / self.fine.step
        J = np.zeros((len(self.base), 6, lay.size))
        y = np.empty((len(self.base), 6))
        f_s, J_f = self._accel(theta, lay, R, columns, at)
        y[:, :3], J[:, :3] = self._gyro(theta, lay, R, columns, at, f_s)
        y[:, 3:], J[:, 3:] = self._accel_output(theta, lay, f_s, J_f)
        J[:, :, lay["clock"]][..., 1] = J[:, :, lay["clock"]][..., 0] * self.centred[:, None]
        return y, J

    def _gyro(
        self, theta: Floats, lay: Layout, R: Floats, c: Response, at: Floats, f_s: Floats
    ) -> tuple[Floats, Floats]:
        step, m, weights = self.fine.step, len(at), self.weights(theta, lay)[:, None]
        cols, slopes = interpolate(low_pass(c.v, self.priors.gyro_cutoff, step), at)
        v, v_slope = cols @ weights, slopes @ weights
        w, w_slope = interpolate(self.w, at)
        axis = interpolate(self.fine.axis, at - self.delay / step)[0] @ R.T
        u = w @ R.T + axis * v
        N = np.zeros((3, 3))
        for k, (i, j) in enumerate(_PAIRS):
            N[i, j] = N[j, i] = theta[lay["cross"]][k]
        scale, a, cubic = theta[lay["scale"]], theta[lay["asymmetry"]], theta[lay["cubic"]]
        G = theta[lay["g_sensitivity"]].reshape(3, 3)
        K = (np.eye(3) + np.diag(scale)) @ (np.eye(3) + N)
        sheared = u @ (np.eye(3) + N).T
        cube = u**3 / self.w_max**2
        hat = hats(self.base, self.base[0], self.base[-1], lay.knots)
        bias = hat @ theta[lay["bias"]].reshape(lay.knots, 3)
        y = u @ K.T + a * np.abs(u) + cubic * cube + f_s @ G.T + bias
        J, eye = np.zeros((m, 3, lay.size)), np.eye(3)
        J[:, :, lay.places] = (axis @ K.T)[:, :, None] * cols[:, None, :]
        J[:, :, lay["turn"]] = -K @ rot.skew(u)
        J[:, :, lay["clock"].start] = (w_slope @ R.T + axis * v_slope) @ K.T / step
        J[:, :, lay["scale"]] = sheared[:, :, None] * eye
        for k, (i, j) in enumerate(_PAIRS):
            J[:, i, lay["cross"].start + k], J[:, j, lay["cross"].start + k] = u[:, j], u[:, i]
        J[:, :, lay["asymmetry"]] = np.abs(u)[:, :, None] * eye
        J[:, :, lay["cubic"]] = cube[:, :, None] * eye
        J[:, :, lay["g_sensitivity"]] = np.einsum("ij,nk->nijk", eye, f_s).reshape(m, 3, 9)
        J[:, :, lay["bias"]] = np.einsum("nk,ij->nikj", hat, eye).reshape(m, 3, -1)
        return y, J

    def _accel(self, theta: Floats, lay: Layout, R: Floats, c: Response, at: Floats) -> tuple[Floats, Floats]:
        """Return the specific force in perfect sensor axes (m, 3) and its Jacobian."""
        step, m, n = self.fine.step, len(at), c.x.shape[1]
        at = at - theta[lay["accel_delay"]] / step
        g, p = theta[lay["gravity"]], theta[lay["position"]]
        stacked = low_pass(np.concatenate(c, axis=1), self.priors.accel_cutoff, step)
        cols, slopes = (x.reshape(m, 3, n) for x in interpolate(stacked, at))
        weights = self.weights(theta, lay)
        d = cols @ weights
        f, moved, T = self._force(d, slopes @ weights, g, p, at)
        rigid, axis = interpolate(self.rigid, at)[0], interpolate(self.fine.axis, at)[0]
        J = np.zeros((m, 3, lay.size))
        J[:, :, lay.places] = T @ cols
        J[:, :, lay["gravity"]] = -rigid[:, 3:12].reshape(m, 3, 3)
        J[:, :, lay["position"]] = rigid[:, 12:].reshape(m, 3, 3) + d[:, 2, None, None] * rot.skew(axis)
        J[:, :, lay["clock"].start] = moved
        J[:, :, lay["accel_delay"].start] = -moved
        f, J = f @ R.T, R @ J
        J[:, :, lay["turn"]] = -rot.skew(f)
        return f, J

    def _force(
        self, d: Floats, d_slope: Floats, g: Floats, p: Floats, at: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return the specific force in the link frame (m, 3), its slope [1/s], df/d(delta), for seen deflections."""
        step, m = self.fine.step, len(at)
        rigid, slope = interpolate(self.rigid, at)

        def still(x: Floats) -> Floats:
            return x[:, :3] - x[:, 3:12].reshape(m, 3, 3) @ g + x[:, 12:].reshape(m, 3, 3) @ p

        lag = group_delay(self.priors.accel_cutoff) / step
        places = (self.fine.axis, self.fine.arm, self.fine.w)
        axis, arm, w = (interpolate(x, at - lag)[0] for x in places)
        force = still(rigid)
        turning, levered = 2.0 * np.cross(axis, np.cross(w, p)), np.cross(axis, arm + p)
        T = np.stack([-np.cross(axis, force), turning, levered], axis=2)
        f = force + np.einsum("nij,nj->ni", T, d)
        return f, (still(slope) + np.einsum("nij,nj->ni", T, d_slope)) / step, T

    def _accel_output(self, theta: Floats, lay: Layout, f: Floats, J_f: Floats) -> tuple[Floats, Floats]:
        M = np.eye(3) + theta[lay["accel_matrix"]].reshape(3, 3)
        J = M @ J_f
        eye = np.eye(3)
        J[:, :, lay["accel_matrix"]] = np.einsum("ij,nk->nijk", eye, f).reshape(len(f), 3, 9)
        J[:, :, lay["accel_bias"]] = eye
        return f @ M.T + theta[lay["accel_bias"]], J
