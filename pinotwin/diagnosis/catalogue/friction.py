"""Candidates of friction. The direction comes from bristles on position, the load from the model."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.bristle import bristles
from pinotwin.diagnosis.context import Candidate, Context, Family, Scene

WARMING = (5.0, 15.0, 40.0)  # [s] time constants that are tried
PRESLIDING = (4.0, 8.0, 16.0, 40.0, 100.0)  # times the usual distance


def friction(context: Context, axis: str, joint: int) -> Iterator[Family]:
    """Yield the friction families of one axis."""
    positive = not context.base.change
    for name, make in _simple(joint).items():
        if name == "offset" and context.has("offset", axis) and positive:
            continue
        label = name
        if name == "offset" and context.has("coulomb", axis):
            label = "coulomb_asymmetric"  # beside coulomb the same to the letter: METHODS A0.5
        if not (context.has(name, axis) and positive):
            yield [_one(context, label, axis, joint, make, positive=positive and name != "offset")]
    yield _load(context, axis, joint)
    yield _viscous_asymmetric(context, axis, joint)
    if not context.has("coulomb_asymmetric", axis):
        yield _coulomb_asymmetric(context, axis, joint)
    yield _stribeck(context, axis, joint)
    yield _presliding(context, axis, joint)
    yield _thermal(context, axis, joint)


def _simple(joint: int):  # type: ignore[no-untyped-def]
    return {
        "viscous": lambda s: s.motion.v[:, [joint]],
        "coulomb": lambda s: s.direction[:, [joint]],
        "quadratic_drag": lambda s: (s.motion.v * np.abs(s.motion.v))[:, [joint]],
        "offset": lambda s: np.ones((len(s.motion), 1)),
    }


def _load(context: Context, axis: str, joint: int) -> Family:
    """Friction that rises with the load: on the bodies' side of the drive, or with friction in it."""
    loads = {
        0.0: lambda s: (np.abs(s.rigid) * s.direction)[:, [joint]],
        1.0: lambda s: (np.abs(s.effort) * s.direction)[:, [joint]],
    }
    positive = not context.base.change
    return [
        Candidate("load_friction", axis, {"total": total}, context.on_joint(joint, make), ("mu",),
                  positive=positive)
        for total, make in loads.items()
    ]  # fmt: skip


def _one(context, name, axis, joint, make, *, positive):  # type: ignore[no-untyped-def]
    names = {"viscous": "b", "coulomb": "c", "quadratic_drag": "b2", "load_friction": "mu",
             "offset": "f0", "coulomb_asymmetric": "f0"}  # fmt: skip
    return Candidate(
        name, axis, {}, context.on_joint(joint, make), (names[name],), positive=positive
    )


def _viscous_asymmetric(context: Context, axis: str, joint: int) -> Family:
    def make(s: Scene) -> Floats:
        return np.abs(s.motion.v[:, [joint]])

    if context.has("viscous_asymmetric", axis):
        return []
    return [Candidate("viscous_asymmetric", axis, {}, context.on_joint(joint, make), ("b_diff",))]


def _coulomb_asymmetric(context: Context, axis: str, joint: int) -> Family:
    if context.has("coulomb", axis):
        return []  # beside coulomb it is an offset, to the letter: METHODS A0.5

    def make(s: Scene) -> Floats:
        z = s.direction[:, joint]
        return np.stack([np.maximum(z, 0.0), np.minimum(z, 0.0)], axis=1)

    columns = context.on_joint(joint, make)
    return [Candidate("coulomb_asymmetric", axis, {}, columns, ("c_plus", "c_minus"))]


def _stribeck(context: Context, axis: str, joint: int) -> Family:
    if context.has("stribeck", axis) and not context.base.change:
        return []
    top = context.speed(joint)
    out = []
    distance = float(context.base.distance[joint])
    for v_s in np.geomspace(0.006, 0.3, 6) * top:

        def make(s: Scene, v_s: float = v_s) -> Floats:
            own = s.motion.axis(axis)
            return bristles(own, distance, np.exp(-((own.v / v_s) ** 2)))[:, 1:]

        columns = context.on_joint(joint, make)
        shape = {"v_s": float(v_s), "exponent": 2.0}
        out.append(
            Candidate("stribeck", axis, shape, columns, ("s",), positive=not context.base.change)
        )
    return out


def _presliding(context: Context, axis: str, joint: int) -> Family:
    usual = float(context.base.distance[joint])
    out = []
    for times in PRESLIDING:

        def make(s: Scene, d: float = usual * times) -> Floats:
            return bristles(s.motion.axis(axis), d)[:, :1] - s.direction[:, [joint]]

        columns = context.on_joint(joint, make)
        shape = {"distance": usual * times}
        out.append(Candidate("presliding", axis, shape, columns, ("r",), positive=True))
    return out


def _thermal(context: Context, axis: str, joint: int) -> Family:
    out = []
    for tau in WARMING:

        def make(s: Scene, tau: float = tau) -> Floats:
            t = s.motion.t - s.motion.t[0]
            return (s.motion.v[:, joint] * -np.expm1(-t / tau))[:, None]

        columns = context.on_joint(joint, make)
        out.append(Candidate("viscous_thermal", axis, {"tau": tau}, columns, ("b_warm",)))
    return out
