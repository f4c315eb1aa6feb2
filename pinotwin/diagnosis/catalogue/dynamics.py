"""Candidates of the mechanics: elastic drive or joint, backlash, payload, coupling, tilted axis."""

from __future__ import annotations

from collections.abc import Iterator

import numba
import numpy as np
import pinocchio as pin
from scipy.linalg import qr

from pinotwin.arrays import Floats, Mask
from pinotwin.diagnosis.context import Context, Family, Scene, Shape, on, shaken
from pinotwin.diagnosis.stage import Blocks
from pinotwin.dynamics.batch import inverse
from pinotwin.dynamics.parameters import parameters, with_parameters
from pinotwin.dynamics.regressor import regressor
from pinotwin.effects import RigidBody
from pinotwin.effects.layout import effect_slices

LOAD = 0.65  # share of the inertia behind a spring or a gap that is assumed
DAMPING = (0.03, 0.08, 0.2)
MODES = 15  # frequencies that are tried
TILT = 0.01  # [rad]


def axis_dynamics(context: Context, axis: str, joint: int) -> Iterator[Family]:
    """Yield the mechanical families of one axis."""
    yield _flexibility(context, axis, joint)
    yield _backlash(context, axis, joint)
    yield from _coupling(context, axis, joint)


def machine_dynamics(context: Context) -> Iterator[Family]:
    """Yield the families of the whole tree."""
    pi = _standard(context)
    if not np.any(context.machine.model.gravity.linear):
        yield _gravity(context)
    if not context.base.change:  # a twin's rotors do not change: its inertias are payload's
        for axis in context.machine.axes.values():
            yield _rotor(axis.name, axis.index)
    else:
        for axis in context.machine.axes.values():
            yield _payload(context, axis.name, axis.joint)
    for axis in context.machine.axes.values():
        yield _tilt(context, axis.name, axis.joint, pi)


def _flexibility(context: Context, axis: str, joint: int) -> Family:
    step = context.scenes[0].motion.step
    top = min(0.7 / context.rows.row_step, 120.0)

    def values(s: Scene, shape: Shape) -> Floats:
        load = s.rigid[:, joint]  # all that the spring carries: gravity and coupling too
        M = s.inertia(joint)
        ratio, w = np.mean(M) / M, 2.0 * np.pi * shape["frequency"]
        out = np.zeros(len(load))
        for part in s.motion.segments:
            out[part] = _sprung(load[part], ratio[part], w, shape["damping"], step) - load[part]
        return out

    shapes = [
        {"frequency": float(f), "damping": z}
        for f in np.geomspace(8.0, max(top, 16.0), MODES)
        for z in DAMPING
    ]
    return Family(
        "drive_flexibility",
        axis,
        ("share",),
        shaken(context, joint, values, LOAD),
        shapes,
        positive=True,
        shakes=True,
        fine={"frequency": 0.1, "damping": 0.5},
    )


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _sprung(load: Floats, ratio: Floats, w: float, zeta: float, step: float) -> Floats:
    """Return the effort that a spring with a damper passes on of a load (n,) that acts if it is stiff.

    With the mean inertia M, and ``ratio`` = M over that of the posture, the twist d of the spring follows
    ``s'' + 2 zeta w ratio s' + w^2 ratio s = ratio load``, s = M d; it passes on ``w^2 s + 2 zeta w s'``.
    Exact for a load that changes linearly, and an inertia that does not change, within a step.
    """
    n = len(load)
    out = np.empty(n)
    s, v, last = load[0] / (w * w), 0.0, -1.0
    out[0] = load[0]
    fade = c = sn = d = ww = wd = 0.0
    for k in range(1, n):
        r = 0.5 * (ratio[k - 1] + ratio[k])
        if r != last:
            d, ww, last = zeta * w * r, w * w * r, r
            wd = np.sqrt(max(ww - d * d, 1e-6 * ww))
            fade, c, sn = np.exp(-d * step), np.cos(wd * step), np.sin(wd * step) / wd
        slope = r * (load[k] - load[k - 1]) / (step * ww)
        level = r * load[k - 1] / ww - 2.0 * d * slope / ww
        x, u = s - level, v - slope
        s = level + slope * step + fade * (x * (c + d * sn) + u * sn)
        v = slope + fade * (u * (c - d * sn) - x * ww * sn)
        out[k] = w * w * s + 2.0 * zeta * w * v
    return out


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _carried(
    q: Floats, extra: Floats, ratio: Floats, gap: float, w: float, zeta: float, step: float
) -> Floats:
    """Return the effort per inertia that a drive with a gap carries, given the motor's path.

    The load (unit inertia) follows ``x'' + extra = T``, ``T = w^2 dz(q - x; gap) + 2 zeta w (q' - x')``
    in contact; ``extra`` is what else acts on it, per inertia; ``ratio`` as in :func:`_sprung`. Leapfrog
    steps; the effort of a sample is the mean over half a step before and after it: a mean over the step
    before it comes late, which of a small gap would be most that is seen.
    """
    parts = 2 * max(2, int(np.ceil(0.5 * step * w / 0.3)))
    h = step / parts
    out = np.zeros(len(q))
    x, v = q[0], (q[1] - q[0]) / step
    for k in range(1, len(q)):
        rate = (q[k] - q[k - 1]) / step
        stiff, damper = w * w * ratio[k], 2.0 * zeta * w * ratio[k]
        for i in range(parts):
            d = q[k - 1] + rate * h * i - x
            effort = 0.0
            if d > 0.5 * gap:
                effort = max(stiff * (d - 0.5 * gap) + damper * (rate - v), 0.0)
            elif d < -0.5 * gap:
                effort = min(stiff * (d + 0.5 * gap) + damper * (rate - v), 0.0)
            v += h * (effort - extra[k])
            x += h * v
            late = 0.0 if 2 * i < parts else 0.5 if 2 * i == parts else 1.0
            out[k - 1] += (1.0 - late) * effort / parts
            out[k] += late * effort / parts
    return out


GAPS = np.geomspace(0.1, 13.0, 13)
CONTACTS = ((90.0, 0.35), (150.0, 0.35), (220.0, 0.2), (300.0, 0.2))
"""Mode [Hz] and damping ratio of a load against the faces of a gap.

The softer ones are softer than faces are: the path is not known well enough to foretell each impact, and what
is left of them in the mean is a slower settling (best of 25 virtual machines with play: 10, 5, 5, 5 of them).
"""


def _backlash(context: Context, axis: str, joint: int) -> Family:
    usual = 1e-4 if context.machine.rotary[joint] else 1e-5
    step = context.scenes[0].motion.step

    def values(s: Scene, shape: Shape) -> Floats:
        q = np.ascontiguousarray(s.motion.q[:, joint])
        M = s.inertia(joint)
        rest = (s.rigid[:, joint] / M - s.motion.a[:, joint]) / LOAD
        ratio, out = np.mean(M) / M, np.zeros(len(q))
        play = shape["gap"], 2 * np.pi * shape["frequency"], shape["damping"]
        for part in s.motion.segments:
            out[part] = _carried(q[part], rest[part], ratio[part], *play, step)
        return LOAD * M * out - s.rigid[:, joint] + (1.0 - LOAD) * M * s.motion.a[:, joint]

    shapes = [{"gap": usual * float(g), "frequency": f, "damping": z} for g in GAPS for f, z in CONTACTS]
    return Family(
        "backlash",
        axis,
        ("share",),
        shaken(context, joint, values, LOAD),
        shapes,
        positive=True,
        shakes=True,
        fine={"gap": 0.25, "frequency": 0.3, "damping": 0.5},
    )


def _coupling(context: Context, axis: str, joint: int) -> Iterator[Family]:
    machine = context.machine
    for other, name in enumerate(machine.names):
        both = machine.rotary[joint] and machine.rotary[other]
        if other <= joint or not both or context.has("wrist_coupling", name):
            continue

        def make(s: Scene, _: Shape, other: int = other) -> Blocks:
            m = s.motion
            slide = np.sign(m.v[:, joint] + m.v[:, other])
            mine = np.stack([m.a[:, other], m.v[:, other], slide], axis=1)
            theirs = np.stack([m.a[:, joint], m.v[:, joint], slide], axis=1)
            return [(joint, mine), (other, theirs)]

        label = ("Ia_m", "b_m", "c_m")
        yield Family("wrist_coupling", name, label, make, ({"with": float(joint)},))


def _standard(context: Context) -> Floats:
    """Return standard parameters near CAD that agree with the base model's coefficients."""
    machine = context.machine
    at = [isinstance(e, RigidBody) for e in context.base.effects].index(True)
    beta = context.theta[effect_slices(context.base.effects)[at]]
    pi0 = parameters(machine.model)
    P = machine.base.P
    return np.asarray(pi0 + np.linalg.pinv(P) @ (beta - P @ pi0))


def _rotor(axis: str, joint: int) -> Family:
    """Inertia that turns faster than its axis: it adds to the effort of its own acceleration alone."""
    return Family("rotor_inertia", axis, ("Ja",), on(joint, lambda s, _: s.motion.a[:, joint]))


def _gravity(context: Context) -> Family:
    """Weight, where the model has none: the bodies' first moments under gravity."""
    model = pin.Model(context.machine.model)
    model.gravity = pin.Motion(np.array([0.0, 0.0, -9.81]), np.zeros(3))
    W = [_resting(model, scene.motion.q) for scene in context.scenes]
    every = np.concatenate(W).reshape(-1, W[0].shape[2])
    size = np.linalg.norm(every, axis=0)
    scaled = every[:, size > 1e-9 * size.max()]
    _, R, order = qr(scaled / np.linalg.norm(scaled, axis=0), mode="economic", pivoting=True)
    seen = np.abs(np.diag(R)) > 1e-6
    picked = np.flatnonzero(size > 1e-9 * size.max())[order[: len(seen)][seen]]

    def make(s: Scene, _: Shape) -> Blocks:
        own = W[s.log][:, :, picked]
        return [(k, own[:, k, :]) for k in range(model.nv)]

    return Family("gravity", None, tuple(f"w{k}" for k in range(len(picked))), make)


def _resting(model: pin.Model, q: Floats) -> Floats:
    zero = np.zeros_like(q)
    return regressor(model, q, zero, zero)


def _payload(context: Context, axis: str, joint: str) -> Family:
    model = context.machine.model
    first = 10 * (model.getJointId(joint) - 1)
    index = np.arange(first, first + 10)
    alive: list[Mask] = []

    def make(s: Scene, _: Shape) -> Blocks:
        m = s.motion
        W = regressor(model, m.q, m.v, m.a, index)
        if not alive:  # the columns that any motion can show, the same for every log
            alive.append(np.abs(W).reshape(-1, 10).max(axis=0) > 1e-12)
        return [(k, W[:, k, alive[0]]) for k in range(model.nv)]

    make(context.scenes[0], {})
    names = tuple(f"p{k}" for k in range(int(alive[0].sum())))
    return Family("payload", axis, names, make)


def _tilt(context: Context, axis: str, joint: str, pi: Floats) -> Family:
    machine = context.machine
    try:
        model = with_parameters(machine.model, pi)
    except (ValueError, RuntimeError):
        model = machine.model
    at = model.getJointId(joint)
    tilted = []
    direction = _direction(model, at)
    for side in _across(direction):
        copy = model.copy()
        copy.jointPlacements[at] = model.jointPlacements[at] * pin.SE3(pin.exp3(TILT * side), np.zeros(3))
        tilted.append(copy)

    def make(s: Scene, _: Shape) -> Blocks:
        m = s.motion
        straight = inverse(model, m.q, m.v, m.a)
        values = np.stack([(inverse(x, m.q, m.v, m.a) - straight) / TILT for x in tilted], axis=2)
        return [(k, values[:, k, :]) for k in range(model.nv)]

    return Family("geometric_error", axis, ("tilt1", "tilt2"), make)


def _direction(model: pin.Model, at: int) -> Floats:
    data = model.joints[at].createData()
    model.joints[at].calc(data, np.zeros(model.joints[at].nq), np.zeros(model.joints[at].nv))
    S = np.asarray(data.S).reshape(6)
    axis = S[:3] if np.linalg.norm(S[:3]) > 0.5 else S[3:]
    return np.asarray(axis / np.linalg.norm(axis))


def _across(direction: Floats) -> list[Floats]:
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first /= np.linalg.norm(first)
    return [first, np.cross(direction, first)]
