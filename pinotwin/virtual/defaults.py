"""Fill in what a ``virtual.yaml`` leaves open, by rules a commissioning engineer would use.

Sizes are set against the *rated effort* of an axis: its inertia times its acceleration limit,
plus what gravity asks for. Gains come from the CAD inertia: the engineer does not know the truth
either.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.virtual.axis_truth import (
    CONTACT,
    AxisTruth,
    Controller,
    Drive,
    EffortSensor,
    Encoder,
    Friction,
    Limits,
)
from pinotwin.virtual.mass import gravity_at, inertia_at
from pinotwin.virtual.rigid import Tree


@dataclass(frozen=True)
class Scale:
    """Reference sizes of one axis, from CAD.

    Attributes:
        rotary: whether the axis turns.
        inertia: largest diagonal inertia over the travel, rotor included [kg or kg·m²].
        least: smallest inertia over the travel with the other joints free, without a rotor.
        hold: largest effort against gravity [N or N·m].
        rated: effort at the acceleration limit, gravity included [N or N·m].
        speed: speed limit.
        travel: span of the travel [m or rad].
    """

    rotary: bool
    inertia: float
    least: float
    hold: float
    rated: float
    speed: float
    travel: float


def resolved_limits(limits: Limits, model: pin.Model, joint: int, rotary: bool) -> Limits:
    """Return limits without gaps; the URDF's own where ``virtual.yaml`` has none."""
    i, iq = model.idx_vs[joint + 1], model.idx_qs[joint + 1]
    top = float(model.velocityLimit[i])
    usual = 2.0 if rotary else 0.3
    speed = limits.speed or (top if 0.0 < top < 1e3 else usual)
    acceleration = limits.acceleration or speed / 0.15
    jerk = limits.jerk or acceleration / 0.02
    travel = limits.travel
    if travel is None:
        low, high = float(model.lowerPositionLimit[iq]), float(model.upperPositionLimit[iq])
        bounded = model.nqs[joint + 1] == 1 and high > low and high - low < 1e3
        reach = 1.5 if rotary else 0.2
        low, high = (low, high) if bounded else (-reach, reach)
        travel = (low + 0.05 * (high - low), high - 0.05 * (high - low))
    return Limits(speed, acceleration, jerk, travel)


def survey(tree: Tree, travels: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the largest diagonal inertia, the smallest free one, and the largest holding effort.

    Args:
        tree: the machine as CAD believes.
        travels: lowest and highest position of every joint, shape (nv, 2).
    """
    rng = np.random.default_rng(0)
    nv = len(travels)
    inertia, least, hold = np.zeros(nv), np.full(nv, np.inf), np.zeros(nv)
    for q in [travels.mean(axis=1), *rng.uniform(travels[:, 0], travels[:, 1], (40, nv))]:
        M = inertia_at(tree, q)
        inertia = np.maximum(inertia, np.diag(M))
        least = np.minimum(least, 1.0 / np.diag(np.linalg.inv(M)))
        hold = np.maximum(hold, np.abs(gravity_at(tree, q)))
    return inertia, least, hold


def resolved_axis(axis: AxisTruth, scale: Scale) -> AxisTruth:
    """Return the truth of an axis without gaps."""
    friction = _friction(axis.friction, scale)
    controller = _controller(axis.controller, scale, friction)
    drive = _drive(axis.drive, scale)
    assert controller.effort_limit is not None
    effort = _effort(axis.effort, scale, controller.effort_limit)
    encoder = _encoder(axis.encoder, scale.rotary)
    return replace(
        axis, friction=friction, controller=controller, drive=drive, effort=effort, encoder=encoder
    )


def _controller(given: Controller, scale: Scale, friction: Friction) -> Controller:
    limit = given.effort_limit or 3.0 * scale.rated + 2.0 * scale.hold
    carried = 0.0
    if given.kind == "pid":
        p, w, zeta = given.poles or (55.0, 10.0, 0.75)
        p, w = 2.0 * np.pi * p, 2.0 * np.pi * w
        kv, kp, ki = p + 2.0 * zeta * w, 2.0 * zeta * w * p + w * w, p * w * w
        kp *= scale.inertia
        kd = kv * scale.inertia if given.kv is None else given.kv
        # What a set-point weight below 1 takes away at constant speed, the integral part brings back.
        lacking = (1.0 - given.derivative_weight) * kd
        carried = lacking * scale.speed
        forward = given.velocity_feedforward * (friction.viscous or 0.0) - lacking
    else:
        w = 2.0 * np.pi * (given.bandwidth or 30.0)
        kv, kp, ki = w, 0.25 * w, w * w / 6.0
        forward = given.velocity_feedforward
    return replace(
        given,
        kp=kp if given.kp is None else given.kp,
        kv=kv * scale.inertia if given.kv is None else given.kv,
        ki=ki * scale.inertia if given.ki is None else given.ki,
        velocity_feedforward=forward,
        effort_limit=limit,
        integral_limit=given.integral_limit or limit + carried,
    )


def _friction(given: Friction, scale: Scale) -> Friction:
    return replace(
        given,
        coulomb=fallback(given.coulomb, 0.06 * scale.rated),
        viscous=fallback(given.viscous, 0.08 * scale.rated / scale.speed),
        stribeck_speed=fallback(given.stribeck_speed, 0.015 * scale.speed),
        presliding=fallback(given.presliding, 2e-5 if scale.rotary else 5e-6),
    )


def _drive(given: Drive, scale: Scale) -> Drive:
    frequency, rotor = given.frequency, given.rotor or 0.0
    if given.backlash > 0.0 and frequency == 0.0:
        frequency = CONTACT
    if frequency > 0.0 and rotor == 0.0:
        rotor = given.motor_share * scale.inertia
    return replace(given, frequency=frequency, rotor=rotor)


def _encoder(given: Encoder, rotary: bool) -> Encoder:
    resolution = fallback(given.resolution, 5e-7 if rotary else 2e-8)
    return replace(given, resolution=resolution, noise=fallback(given.noise, 0.5 * resolution))


def _effort(given: EffortSensor, scale: Scale, limit: float) -> EffortSensor:
    return replace(
        given,
        white=fallback(given.white, 0.004 * scale.rated),
        coloured=fallback(given.coloured, 0.002 * scale.rated),
        resolution=fallback(given.resolution, 2.0 * limit / 2**14),
    )


def fallback(value: float | None, other: float) -> float:
    """Return the value, or the other where there is none."""
    return other if value is None else value


def scales(
    tree: Tree, joints: Mapping[str, int], axes: Mapping[str, AxisTruth], travels: Floats
) -> dict[str, Scale]:
    """Return the reference sizes of every axis; ``axes`` must have their limits."""
    inertia, least, hold = survey(tree, travels)
    out = {}
    for name, j in joints.items():
        limits = axes[name].limits
        assert limits.speed is not None
        assert limits.acceleration is not None
        assert limits.travel is not None
        total = float(inertia[j]) + (axes[name].drive.rotor or 0.0)
        rated = total * limits.acceleration + float(hold[j])
        span = limits.travel[1] - limits.travel[0]
        size = (total, float(least[j]), float(hold[j]), rated)
        out[name] = Scale(bool(tree.rotary[j]), *size, limits.speed, span)
    return out
