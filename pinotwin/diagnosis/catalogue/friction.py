"""Candidates of friction. The direction comes from bristles on position, the load from the model."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.bristle import bristles
from pinotwin.diagnosis.context import Context, Family, Scene, Shape, on

WARMING = (5.0, 15.0, 40.0)  # [s] time constants that are tried
PRESLIDING = (2.0, 4.0, 8.0, 16.0, 40.0, 100.0)  # times the usual distance


def friction(context: Context, axis: str, joint: int) -> Iterator[Family]:
    """Yield the friction families of one axis."""
    structure = not context.base.change
    for name, values in _simple(joint).items():
        if structure and context.has(name, axis):
            continue
        label = name
        if name == "offset" and context.has("coulomb", axis):
            label = "coulomb_asymmetric"  # beside coulomb the same to the letter: METHODS A0.5
        positive = structure and name != "offset"
        yield Family(label, axis, (NAMES[label],), on(joint, values), positive=positive)
    yield _load(context, axis, joint)
    if not context.has("viscous_asymmetric", axis):
        yield Family(
            "viscous_asymmetric", axis, ("b_diff",), on(joint, lambda s, _: np.abs(s.motion.v[:, joint]))
        )
    if not any(context.has(e, axis) for e in ("coulomb", "coulomb_asymmetric", "offset")):
        yield Family("coulomb_asymmetric", axis, ("c_plus", "c_minus"), on(joint, _both_ways(joint)))
    if not (structure and context.has("stribeck", axis)):
        yield _stribeck(context, axis, joint)
    if not (structure and context.has("presliding", axis)):  # its own form was found in this log
        yield _presliding(context, axis, joint)
    yield _thermal(axis, joint)


NAMES = {
    "viscous": "b",
    "coulomb": "c",
    "quadratic_drag": "b2",
    "offset": "f0",
    "coulomb_asymmetric": "f0",
}
Values = Callable[[Scene, Shape], Floats]


def _simple(joint: int) -> dict[str, Values]:
    return {
        "viscous": lambda s, _: s.motion.v[:, joint],
        "coulomb": lambda s, _: s.direction[:, joint],
        "quadratic_drag": lambda s, _: (s.motion.v * np.abs(s.motion.v))[:, joint],
        "offset": lambda s, _: np.ones(len(s.motion)),
    }


def _both_ways(joint: int) -> Values:
    def values(s: Scene, _: Shape) -> Floats:
        z = s.direction[:, joint]
        return np.stack([np.maximum(z, 0.0), np.minimum(z, 0.0)], axis=1)

    return values


def _load(context: Context, axis: str, joint: int) -> Family:
    """Friction that rises with the load: on the bodies' side of the drive, or with friction in it."""

    def values(s: Scene, shape: Shape) -> Floats:
        load = s.effort if shape["total"] else s.rigid
        return (np.abs(load) * s.direction)[:, joint]

    return Family(
        "load_friction",
        axis,
        ("mu",),
        on(joint, values),
        ({"total": 0.0}, {"total": 1.0}),
        positive=not context.base.change,
    )


def _stribeck(context: Context, axis: str, joint: int) -> Family:
    distance, top = float(context.base.distance[joint]), context.speed(joint)

    def values(s: Scene, shape: Shape) -> Floats:
        own = s.motion.axis(axis)
        return bristles(own, distance, np.exp(-((own.v / shape["v_s"]) ** 2)))[:, 1]

    shapes = [{"v_s": float(x), "exponent": 2.0} for x in np.geomspace(0.006, 0.3, 6) * top]
    return Family(
        "stribeck",
        axis,
        ("s",),
        on(joint, values),
        shapes,
        positive=not context.base.change,
        fine={"v_s": 0.6},
    )


def _presliding(context: Context, axis: str, joint: int) -> Family:
    usual = float(context.base.distance[joint])

    def values(s: Scene, shape: Shape) -> Floats:
        return bristles(s.motion.axis(axis), shape["distance"])[:, 0] - s.direction[:, joint]

    shapes = [{"distance": usual * times} for times in PRESLIDING]
    return Family(
        "presliding", axis, ("r",), on(joint, values), shapes, positive=True, fine={"distance": 0.5}
    )


def _thermal(axis: str, joint: int) -> Family:
    def values(s: Scene, shape: Shape) -> Floats:
        t = s.motion.t - s.motion.t[0]
        return np.asarray(s.motion.v[:, joint] * -np.expm1(-t / shape["tau"]))

    shapes = [{"tau": tau} for tau in WARMING]
    return Family("viscous_thermal", axis, ("b_warm",), on(joint, values), shapes, fine={"tau": 0.6})
