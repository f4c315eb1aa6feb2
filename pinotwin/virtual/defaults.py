"""Fill in what a ``virtual.yaml`` leaves open, as a commissioning engineer would, who does not know the truth either.

*Rated effort* of an axis: inertia times acceleration limit, plus what gravity asks for. Gains: from CAD inertia.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.trajectories.moves import Limits
from pinotwin.virtual.axis_truth import CONTACT, AxisTruth, Controller, Friction
from pinotwin.virtual.tree import axes_of, gravity_at, inertia_at

Part = TypeVar("Part")


@dataclass(frozen=True)
class Scale:
    """Reference sizes of one axis, from CAD."""

    rotary: bool  # whether the axis turns
    inertia: float  # largest diagonal inertia over the travel, rotor included [kg or kg·m²]
    least: float  # smallest inertia over the travel with the other joints free, without a rotor
    hold: float  # largest effort against gravity [N or N·m]
    rated: float  # effort at the acceleration limit, gravity included [N or N·m]
    speed: float  # speed limit
    travel: float  # span of the travel [m or rad]


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


def scales(
    cad: pin.Model, joints: Mapping[str, int], axes: Mapping[str, AxisTruth], travels: Floats
) -> dict[str, Scale]:
    """Return the reference sizes of every axis over random postures in the ``travels`` [m or rad], (nv, 2)."""
    rng = np.random.default_rng(0)
    postures = [travels.mean(axis=1), *rng.uniform(travels[:, 0], travels[:, 1], (40, len(travels)))]
    masses = [inertia_at(cad, q) for q in postures]
    inertia = np.max([np.diag(M) for M in masses], axis=0)
    least = np.min([1.0 / np.diag(np.linalg.inv(M)) for M in masses], axis=0)
    hold = np.max([np.abs(gravity_at(cad, q)) for q in postures], axis=0)
    out, (rotary, _) = {}, axes_of(cad)
    for name, j in joints.items():
        limits = axes[name].limits
        total = float(inertia[j]) + (axes[name].drive.rotor or 0.0)
        rated = total * (limits.acceleration or 0.0) + float(hold[j])
        sizes = (total, float(least[j]), float(hold[j]), rated, limits.speed or 0.0)
        out[name] = Scale(bool(rotary[j]), *sizes, float(np.ptp(travels[j])))
    return out


def resolved_axis(axis: AxisTruth, scale: Scale) -> AxisTruth:
    """Return the truth of an axis without gaps."""
    friction = filled(
        axis.friction,
        coulomb=0.06 * scale.rated,
        viscous=0.08 * scale.rated / scale.speed,
        stribeck_speed=0.015 * scale.speed,
        presliding=2e-5 if scale.rotary else 5e-6,
    )
    limit = axis.controller.effort_limit or 3.0 * scale.rated + 2.0 * scale.hold
    noises = {"white": 0.004 * scale.rated, "coloured": 0.002 * scale.rated}
    effort = filled(axis.effort, **noises, resolution=2.0 * limit / 2**14)
    encoder = filled(axis.encoder, resolution=5e-7 if scale.rotary else 2e-8)
    encoder = filled(encoder, noise=0.5 * (encoder.resolution or 0.0))
    controller = _controller(axis.controller, scale, friction, limit)
    drive = axis.drive
    if drive.backlash > 0.0 and drive.frequency == 0.0:
        drive = replace(drive, frequency=CONTACT)
    rotor = drive.rotor or (drive.motor_share * scale.inertia if drive.frequency > 0.0 else 0.0)
    drive = replace(drive, rotor=rotor)
    return replace(
        axis, friction=friction, controller=controller, drive=drive, effort=effort, encoder=encoder
    )


def _controller(given: Controller, scale: Scale, friction: Friction, limit: float) -> Controller:
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
        filled(given, kp=kp, kv=kv * scale.inertia, ki=ki * scale.inertia),
        velocity_feedforward=forward,
        effort_limit=limit,
        integral_limit=given.integral_limit or limit + carried,
    )


def filled(part: Part, **usual: Any) -> Part:
    """Return a part of the truth with these values where it has none."""
    return replace(part, **{k: x for k, x in usual.items() if getattr(part, k) is None})  # type: ignore[type-var]
