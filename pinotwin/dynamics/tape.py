"""Mass matrix and bias effort of one machine, M(q) a + h(q, v) = tau, as a straight line of multiply-adds.

Composite rigid bodies and recursive Newton-Euler (Featherstone 2008, 10.1007/978-1-4899-7560-7) are run once with
symbols; what is zero or constant for this machine folds away, and what remains is a list of

    t[k] = t[a] t[b] s[k] + t[c]

for :func:`pinotwin.dynamics.stepping.replay`. ``beta`` on the independent columns and zero elsewhere has the same
efforts as the whole ``pi`` (:mod:`pinotwin.dynamics.base`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.parameters import joint_axis, parameter_count
from pinotwin.dynamics.symbols import Expression, Trace
from pinotwin.errors import MachineError


@dataclass(frozen=True)
class Tape:
    """The straight line; see the module. ``t`` starts with cos q, sin q, q, v of every joint."""

    start: Floats  # first values of t: room for the inputs, then the constants, shape (m,)
    ops: Ints  # a, b, c of every operation, shape (k, 3)
    sign: Floats  # s of every operation, shape (k,)
    revolute: Ints  # joints whose cosine and sine are needed, shape (r,)
    mass: Ints  # row, column (row <= column), place in t of the entries of M that are not zero, (., 3)
    bias: Ints  # joint and place in t of the entries of h that are not zero, shape (., 2)

    @property
    def size(self) -> int:
        """Length of t."""
        return len(self.start) + len(self.ops)


def record(model: pin.Model, pi: Floats, coupled: Sequence[tuple[int, int, float, float]] = ()) -> Tape:
    """Return the tape of a machine with the inertial parameters ``pi``, shape (p,); joints turn or slide.

    ``coupled``: two joints that one motor turns, M_ij and viscous friction (h_i += b v_j, h_j += b v_i).
    """
    if np.shape(pi) != (parameter_count(model),):
        raise MachineError(f"machine {model.name!r}: pi has shape {np.shape(pi)}")
    nv = model.nv
    trace = Trace(4 * nv)
    bodies = _Bodies(model, np.asarray(pi, dtype=float), trace)
    mass = bodies.mass_matrix()
    bias = bodies.bias()
    for i, j, inertia, viscous in coupled:
        low, high = min(i, j), max(i, j)
        mass[low, high] = mass.get((low, high), 0.0) + inertia
        bias[i] = bias.get(i, 0.0) + viscous * bodies.v[j]
        bias[j] = bias.get(j, 0.0) + viscous * bodies.v[i]
    outputs = [*mass.values(), *bias.values()]
    start, ops, sign, places = trace.compile(outputs)
    entries = [(i, j, p) for (i, j), p in zip(mass, places, strict=False)]
    efforts = list(zip(bias, places[len(mass) :], strict=True))
    revolute = np.flatnonzero(bodies.revolute).astype(np.intp)
    tables = (np.array(x, dtype=np.intp).reshape(-1, k) for x, k in ((entries, 3), (efforts, 2)))
    return Tape(start, ops, sign, revolute, *tables)


class _Bodies:
    """The tree with symbols for the joints' positions and velocities."""

    def __init__(self, model: pin.Model, pi: Floats, trace: Trace) -> None:
        nv = model.nv
        self.parent = [int(k) - 1 for k in list(model.parents)[1:]]
        self.armature = pi[10 * nv :]
        self.gravity = _clean(np.array(model.gravity.linear))
        self.v = [trace.input(3 * nv + i) for i in range(nv)]
        self.revolute, self.axis, self.R, self.p, self.body = [], [], [], [], []
        for i in range(nv):
            c, s, q = (trace.input(k * nv + i) for k in range(3))
            turns, axis = _axis(model, i + 1)
            R0, p0 = model.jointPlacements[i + 1].rotation, model.jointPlacements[i + 1].translation
            along = R0 @ np.outer(axis, axis)  # Rodrigues: R0 (a a^T + cos q (1 - a a^T) + sin q skew(a))
            turned = _clean(along) + c * _clean(R0 - along) + s * _clean(R0 @ pin.skew(axis))
            self.revolute.append(turns)
            self.axis.append(_clean(axis))
            self.R.append(turned if turns else _clean(R0))
            self.p.append(_clean(p0) if turns else _clean(p0) + q * _clean(R0 @ axis))
            self.body.append(_inertia(pi[10 * i : 10 * i + 10]))

    def mass_matrix(self) -> dict[tuple[int, int], Expression]:
        """Return the entries (i <= j) of M that are not zero."""
        total = [list(body) for body in self.body]
        out: dict[tuple[int, int], Expression] = {}
        for i in reversed(range(len(self.parent))):
            m, h, inertia = total[i]
            self._column(i, m, h, inertia, out)
            if self.parent[i] >= 0:
                for k, x in enumerate(_moved(m, h, inertia, self.R[i], self.p[i])):
                    total[self.parent[i]][k] = total[self.parent[i]][k] + x
        return {key: out[key] for key in sorted(out) if not _is_zero(out[key])}

    def _column(self, i, m, h, inertia, out):  # type: ignore[no-untyped-def]
        """Fill column i of M: the force that a unit acceleration of joint i needs, carried down."""
        axis = self.axis[i]
        if self.revolute[i]:
            f, n = np.cross(axis, h), inertia @ axis
        else:
            f, n = m * axis, np.cross(h, axis)
        own = self.axis[i] @ (n if self.revolute[i] else f)
        out[i, i] = own + float(self.armature[i])
        j = i
        while self.parent[j] >= 0:
            f, n = self.R[j] @ f, self.R[j] @ n
            n = n + np.cross(self.p[j], f)
            j = self.parent[j]
            out[j, i] = self.axis[j] @ (n if self.revolute[j] else f)

    def bias(self) -> dict[int, Expression]:
        """Return the entries of h that are not zero."""
        forces = self._forces()
        out: dict[int, Expression] = {}
        for i in reversed(range(len(self.parent))):
            f, n = forces[i]
            out[i] = self.axis[i] @ (n if self.revolute[i] else f)
            k = self.parent[i]
            if k >= 0:
                f, n = self.R[i] @ f, self.R[i] @ n
                forces[k] = (forces[k][0] + f, forces[k][1] + n + np.cross(self.p[i], f))
        return {i: out[i] for i in sorted(out) if not _is_zero(out[i])}

    def _forces(self):  # type: ignore[no-untyped-def]
        """Return force and moment on every body at zero joint acceleration, in its own axes."""
        zero = np.zeros(3, dtype=object)
        motion = {-1: (zero, zero, -self.gravity)}
        forces = []
        for i, k in enumerate(self.parent):
            w, dw, a = motion[k]
            a = a + np.cross(dw, self.p[i]) + np.cross(w, np.cross(w, self.p[i]))
            w, dw, a = (self.R[i].T @ x for x in (w, dw, a))
            rate = self.axis[i] * self.v[i]
            if self.revolute[i]:
                dw = dw + np.cross(w, rate)
                w = w + rate
            else:
                a = a + 2.0 * np.cross(w, rate)
            motion[i] = (w, dw, a)
            m, h, inertia = self.body[i]
            f = m * a + np.cross(dw, h) + np.cross(w, np.cross(w, h))
            forces.append((f, inertia @ dw + np.cross(w, inertia @ w) + np.cross(h, a)))
        return forces


def _axis(model: pin.Model, joint: int) -> tuple[bool, Floats]:
    """Return whether a joint turns, and the unit vector that it turns about or slides along."""
    kind = model.joints[joint]
    if not (kind.nq == kind.nv == 1 and kind.shortname().startswith(("JointModelR", "JointModelP"))):
        raise MachineError(
            f"machine {model.name!r}: joint {model.names[joint]!r} is neither revolute nor prismatic; only "
            "those can be simulated"
        )
    return joint_axis(model, joint)


def _inertia(body: Floats):  # type: ignore[no-untyped-def]
    """Return mass, first moment and tensor about the joint's origin."""
    xx, xy, yy, xz, yz, zz = (float(x) for x in body[4:])
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=object)
    return float(body[0]), body[1:4].astype(object), tensor


def _moved(m, h, inertia, R, p):  # type: ignore[no-untyped-def]
    """Return mass, first moment and tensor of a body about the origin, in the axes, of its parent."""
    turned = R @ h
    cross = np.outer(p, turned)
    grown = R @ inertia @ R.T + _spread(m * np.outer(p, p)) + _spread(cross + cross.T)
    return m, turned + m * p, grown


def _spread(x):  # type: ignore[no-untyped-def]
    """Return trace(x) 1 - x."""
    return np.eye(3).astype(object) * (x[0, 0] + x[1, 1] + x[2, 2]) - x


def _clean(x: Floats, tiny: float = 1e-15):  # type: ignore[no-untyped-def]
    """Return Python floats, with rounding errors of an exact 0 or 1 removed, so that they fold."""
    whole = np.round(x)
    return np.where(np.abs(x - whole) < tiny, whole, x).astype(float).astype(object)


def _is_zero(x: Expression) -> bool:
    return isinstance(x, float | int) and x == 0.0
