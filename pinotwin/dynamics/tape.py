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
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.parameters import joint_axis, parameter_count
from pinotwin.errors import MachineError

Operation: TypeAlias = tuple[int, int, int, float]
"""a, b and c, nodes before it, and s; a product has ``zero`` for c, a sum ``one`` for b."""


class Trace:
    """The list of nodes under construction, constants folded: inputs, constants, operations."""

    def __init__(self, inputs: int) -> None:
        self.nodes: list[Operation | float | None] = [None] * inputs
        self._known: dict[Operation | float, int] = {}
        self.zero, self.one = self.node(0.0), self.node(1.0)

    def node(self, made: Operation | float) -> int:
        """Return the node of a constant or an operation."""
        if made not in self._known:
            self._known[made] = len(self.nodes)
            self.nodes.append(made)
        return self._known[made]

    def product(self, i: int, j: int) -> int:
        """Return the node of a product; two constant factors become one."""
        a, b = sorted((i, j), key=lambda k: (not isinstance(self.nodes[k], float), k))
        factor, other = self.nodes[a], self.nodes[b]
        if isinstance(factor, float) and isinstance(other, tuple) and other[2] == self.zero:
            inner = self.nodes[other[0]]
            if isinstance(inner, float):
                a, b = self.node(factor * inner), other[1]
        return self.node((a, b, self.zero, 1.0))

    def sum(self, i: int, j: int, sign: float) -> tuple[int, float]:
        """Return node and sign of ``i + sign j``."""
        if i == j:
            return (self.product(self.node(2.0), i), 1.0) if sign > 0 else (-1, 0.0)
        flip = -1.0 if (sign < 0 and j < i) else 1.0
        return self.node((max(i, j), self.one, min(i, j), sign)), flip

    def compile(self, outputs: Sequence[Expression]) -> tuple[Floats, Ints, Floats, list[int]]:
        """Return start values, operations (a, b, c), signs, and the place of every output."""
        ends = [self._signed(x) for x in outputs]
        found = {k: x for k, x in enumerate(self.nodes) if isinstance(x, tuple)}
        uses = self._uses(found, ends)
        self._fuse(found, uses)
        ops = {k: x for k, x in found.items() if uses[k]}
        constants = {k: x for k, x in enumerate(self.nodes) if uses[k] and isinstance(x, float)}
        inputs = [k for k, x in enumerate(self.nodes) if x is None]
        place = {k: at for at, k in enumerate([*inputs, *constants, *ops])}
        start = np.array([*np.zeros(len(inputs)), *constants.values()])
        table = np.array([[place[k] for k in x[:3]] for x in ops.values()], dtype=np.intp).reshape(-1, 3)
        return start, table, np.array([sign for *_, sign in ops.values()]), [place[k] for k in ends]

    def _signed(self, x: Expression) -> int:
        """Return the node that is ``x`` itself, sign included."""
        if not isinstance(x, Symbol):
            return self.node(float(x))
        return x.node if x.sign > 0 else self.node((self.node(-1.0), x.node, self.zero, 1.0))

    def _uses(self, ops: dict[int, Operation], ends: Sequence[int]) -> list[int]:
        """Return how often each node is used by the outputs; an output counts as two."""
        uses = [0] * len(self.nodes)
        for k in ends:
            uses[k] += 2
        for k in reversed(ops):
            for used in ops[k][:3] if uses[k] else ():
                uses[used] += 1
        return uses

    def _fuse(self, ops: dict[int, Operation], uses: list[int]) -> None:
        """Let products live in the one sum that uses them; at most one a sum."""
        for k, (j, b, i, sign) in ops.items():
            if uses[k] and b == self.one:
                for own, rest in [(j, i)] if sign < 0 else [(j, i), (i, j)]:
                    if uses[own] == 1 and own in ops and ops[own][2] == self.zero:
                        ops[k] = (*ops[own][:2], rest, sign)
                        uses[own] = 0
                        break


@dataclass(frozen=True, eq=False)
class Symbol:
    """Plus or minus a node: a number that remembers how it was computed."""

    trace: Trace
    node: int
    sign: float

    def __neg__(self) -> Symbol:
        return Symbol(self.trace, self.node, -self.sign)

    def __mul__(self, other: Expression) -> Expression:
        if isinstance(other, Symbol):
            return Symbol(self.trace, self.trace.product(self.node, other.node), self.sign * other.sign)
        if not isinstance(other, float | int):
            return NotImplemented
        size, sign = abs(float(other)), float(np.sign(other))
        if size == 0.0:
            return 0.0
        node = self.node if size == 1.0 else self.trace.product(self.trace.node(size), self.node)
        return Symbol(self.trace, node, sign * self.sign)

    __rmul__ = __mul__

    def __add__(self, other: Expression) -> Expression:
        if not isinstance(other, Symbol):
            if not isinstance(other, float | int):
                return NotImplemented
            if other == 0.0:
                return self
            other = Symbol(self.trace, self.trace.node(abs(float(other))), float(np.sign(other)))
        node, sign = self.trace.sum(self.node, other.node, self.sign * other.sign)
        # i + s j, or j + s i = s (i + s j): the sign of the first term comes out in front.
        return 0.0 if node < 0 else Symbol(self.trace, node, sign * self.sign)

    __radd__ = __add__

    def __sub__(self, other: Expression) -> Expression:
        return self + (-other)

    def __rsub__(self, other: Expression) -> Expression:
        return (-self) + other


Expression: TypeAlias = Symbol | float


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
        self.v = [Symbol(trace, 3 * nv + i, 1.0) for i in range(nv)]
        self.revolute, self.axis, self.R, self.p, self.body = [], [], [], [], []
        for i in range(nv):
            c, s, q = (Symbol(trace, k * nv + i, 1.0) for k in range(3))
            turns, axis = _axis(model, i + 1)
            R0, p0 = model.jointPlacements[i + 1].rotation, model.jointPlacements[i + 1].translation
            along = R0 @ np.outer(axis, axis)  # Rodrigues: R0 (a a^T + cos q (1 - a a^T) + sin q skew(a))
            turned = _clean(along) + c * _clean(R0 - along) + s * _clean(R0 @ pin.skew(axis))
            self.revolute.append(turns)
            self.axis.append(_clean(axis))
            self.R.append(turned if turns else _clean(R0))
            self.p.append(_clean(p0) if turns else _clean(p0) + q * _clean(R0 @ axis))
            # mass, first moment and tensor about the joint's origin
            mass, moment = float(pi[10 * i]), pi[10 * i + 1 : 10 * i + 4].astype(object)
            xx, xy, yy, xz, yz, zz = map(float, pi[10 * i + 4 : 10 * i + 10])
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=object)
            self.body.append((mass, moment, tensor))

    def mass_matrix(self) -> dict[tuple[int, int], Expression]:
        """Return the entries (i <= j) of M that are not zero."""
        total: list[list[Any]] = [list(body) for body in self.body]
        out: dict[tuple[int, int], Expression] = {}
        for i in reversed(range(len(self.parent))):
            m, h, inertia = total[i]
            # the force that a unit acceleration of joint i needs, carried down
            axis = self.axis[i]
            f = np.cross(axis, h) if self.revolute[i] else m * axis
            n = inertia @ axis if self.revolute[i] else np.cross(h, axis)
            out[i, i] = axis @ (n if self.revolute[i] else f) + float(self.armature[i])
            j = i
            while self.parent[j] >= 0:
                f, n = self.R[j] @ f, self.R[j] @ n
                n = n + np.cross(self.p[j], f)
                j = self.parent[j]
                out[j, i] = self.axis[j] @ (n if self.revolute[j] else f)
            if self.parent[i] >= 0:
                for k, x in enumerate(_moved(m, h, inertia, self.R[i], self.p[i])):
                    total[self.parent[i]][k] = total[self.parent[i]][k] + x
        return {key: out[key] for key in sorted(out) if not _is_zero(out[key])}

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
