"""What each effect adds to the truth, and how much of it a relative size means.

For an effort, ``size`` is a share of the rated effort of the axis; the tables say what it is
elsewhere. :data:`OUTSIDE` holds effects that the catalogue of diagnosis does not know, or knows in
another form.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.virtual.axis_truth import CONTACT, AxisTruth, Bend, Cable, Drive, Harmonic
from pinotwin.virtual.defaults import Scale
from pinotwin.virtual.truth import Payload, Pulse, Truth


@dataclass(frozen=True)
class Body:
    """What an axis moves.

    Attributes:
        joint: URDF joint.
        link: link behind it.
        direction: joint axis in the joint frame.
        world: joint axis in the world, at home.
        mass: mass of the body [kg].
    """

    joint: str
    link: str
    direction: tuple[float, float, float]
    world: tuple[float, float, float]
    mass: float


Bodies = Mapping[str, Body]


@dataclass(frozen=True)
class Dose:
    """How much of an effect, where, and with what scale of the axis.

    Attributes:
        axis: axis name.
        size: relative size [-].
        value: SI quantity in place of the size, or None.
        scale: reference sizes of the axis.
        rng: for what is left to chance (phases, periods, times).
        body: what the axis moves.
    """

    axis: str
    size: float
    value: float | None
    scale: Scale
    rng: np.random.Generator
    body: Body

    def of(self, reference: float) -> float:
        """Return the SI quantity: the value if given, else size times the reference."""
        return self.value if self.value is not None else self.size * reference


def _add_friction(truth: AxisTruth, **more: float) -> AxisTruth:
    f = truth.friction
    changes = {k: (getattr(f, k) or 0.0) + x for k, x in more.items()}
    return replace(truth, friction=replace(f, **changes))  # type: ignore[arg-type]


def _coulomb_of(a: AxisTruth, d: Dose) -> float:
    return max(a.friction.coulomb or 0.0, 1e-3 * d.scale.rated)


def _harmonic(d: Dose, **more: float) -> Harmonic:
    period = d.scale.travel / d.rng.uniform(8.0, 30.0)
    if d.scale.rotary:
        period = 2.0 * np.pi / int(d.rng.integers(8, 40))
    phase = float(d.rng.uniform(0.0, 2.0 * np.pi))
    return Harmonic(d.of(d.scale.rated), float(period), phase, **more)


def _rippled(a: AxisTruth, r: Harmonic) -> AxisTruth:
    return replace(a, ripple=(*a.ripple, r))


def _mode(d: Dose) -> float:
    return d.value if d.value is not None else 20.0 / float(np.sqrt(d.size))


def _drive(a: AxisTruth, d: Dose) -> AxisTruth:
    return replace(a, drive=replace(_with_rotor(a.drive, d), frequency=_mode(d)))


def _with_rotor(drive: Drive, d: Dose) -> Drive:
    """Return the drive with a rotor: its own, or a part of the axis' inertia."""
    if drive.rotor:
        return drive
    return replace(drive, rotor=drive.motor_share * d.scale.least, inside=True)


def _backlash(a: AxisTruth, d: Dose) -> AxisTruth:
    gap = d.of(1e-3 if d.scale.rotary else 1e-4)
    stiff = a.drive.frequency or CONTACT
    return replace(a, drive=replace(_with_rotor(a.drive, d), backlash=gap, frequency=stiff))


def _encoder(a: AxisTruth, d: Dose) -> AxisTruth:
    period = 2.0 * np.pi if d.scale.rotary else d.scale.travel / 8.0
    error = d.of(1e-3 if d.scale.rotary else 1e-4)
    phase = float(d.rng.uniform(0.0, 2.0 * np.pi))
    return replace(a, encoder=replace(a.encoder, error=error, period=period, phase=phase))


def _cable(a: AxisTruth, d: Dose) -> AxisTruth:
    size, seed = d.of(d.scale.rated), int(d.rng.integers(1 << 30))
    return replace(a, cable=Cable(size, d.scale.travel / 25.0, 2.0 * size, seed))


def _tilt(a: AxisTruth, d: Dose) -> AxisTruth:
    angle = d.of(0.1)
    side = np.cross(d.body.direction, d.rng.standard_normal(3))
    x, y, z = (float(v) for v in angle * side / np.linalg.norm(side))
    return replace(a, tilt=(x, y, z))


def _gms(a: AxisTruth, d: Dose) -> AxisTruth:
    wider = (a.friction.presliding or 1e-5) * (1.0 + 10.0 * d.size)
    return replace(a, friction=replace(a.friction, kind="gms", presliding=wider))


def _limit(a: AxisTruth, d: Dose) -> AxisTruth:
    # What gravity asks for stays within reach: an axis that falls is no fault of a drive's limit.
    hold, rest = d.scale.hold, d.scale.rated - d.scale.hold
    limit = d.value if d.value is not None else hold + (1.3 - d.size) * rest
    return replace(a, controller=replace(a.controller, effort_limit=limit, integral_limit=limit))


def _triangle(a: AxisTruth, d: Dose) -> AxisTruth:
    """Add a ripple of straight flanks: a triangle's first three harmonics (1, 1/9, 1/25)."""
    first = _harmonic(d)
    for n, sign in ((1, 1.0), (3, -1.0), (5, 1.0)):
        size, period = sign * first.amplitude / n**2, first.period / n
        a = _rippled(a, replace(first, amplitude=size, period=period, phase=n * first.phase))
    return a


def _feedforward(a: AxisTruth, d: Dose) -> AxisTruth:
    share = a.controller.acceleration_feedforward * (1.0 - d.of(1.0))
    return replace(a, controller=replace(a.controller, acceleration_feedforward=share))


def _drag(a: AxisTruth, d: Dose) -> AxisTruth:
    distance = 0.03 * d.scale.travel
    return replace(a, friction=replace(a.friction, drag=d.of(d.scale.rated), drag_distance=distance))


def _warming(a: AxisTruth, d: Dose) -> AxisTruth:
    thinner = -min(d.of(1.0), 0.95)
    return replace(a, friction=replace(a.friction, warming=thinner, warming_time=8.0))


def _loop_delay(a: AxisTruth, d: Dose) -> AxisTruth:
    return replace(a, controller=replace(a.controller, delay=max(1, round(d.of(40.0)))))


INJECT: Mapping[str, Callable[[AxisTruth, Dose], AxisTruth]] = {
    # size: share of rated effort at the speed limit
    "viscous": lambda a, d: _add_friction(a, viscous=d.of(d.scale.rated / d.scale.speed)),
    "quadratic_drag": lambda a, d: _add_friction(a, quadratic=d.of(d.scale.rated / d.scale.speed**2)),
    # size: share of rated effort
    "coulomb": lambda a, d: _add_friction(a, coulomb=d.of(d.scale.rated)),
    "hysteresis": _drag,
    "coulomb_asymmetric": lambda a, d: _add_friction(a, asymmetry=d.of(d.scale.rated) / _coulomb_of(a, d)),
    "stribeck": lambda a, d: _add_friction(a, static=d.of(d.scale.rated) / _coulomb_of(a, d)),
    "ripple": lambda a, d: _rippled(a, _harmonic(d)),
    "ripple_modulated": lambda a, d: _rippled(a, _harmonic(d, modulation=1.5, modulation_phase=0.7)),
    "position_table": _cable,
    # size: level per transmitted effort; relative change; relative scale; share lost
    "load_friction": lambda a, d: _add_friction(a, load=d.of(1.0)),
    "viscous_thermal": _warming,
    "effort_scale": lambda a, d: replace(a, effort=replace(a.effort, scale=1.0 + d.of(1.0))),
    "feedforward": _feedforward,
    "saturation": _limit,
    # size 0.1: presliding 6 times wider, mode at 63 Hz, 10 um or 0.1 mrad, 1 ms, 10 mrad
    "presliding": lambda a, d: _add_friction(a, presliding=d.of(50.0 * (a.friction.presliding or 1e-5))),
    "drive_flexibility": _drive,
    "joint_flexibility": lambda a, d: replace(a, bend=Bend(_mode(d))),
    "backlash": _backlash,
    "encoder_error": _encoder,
    "delay": lambda a, d: replace(a, effort=replace(a.effort, lag=a.effort.lag + d.of(1e-2))),
    "geometric_error": _tilt,
}
"""Effects of one axis that can be added; sizes as the comments say."""

OUTSIDE: Mapping[str, Callable[[AxisTruth, Dose], AxisTruth]] = {
    "ripple_speed": lambda a, d: _rippled(a, _harmonic(d, speed=d.scale.speed)),
    "coulomb_position": lambda a, d: _add_friction(
        replace(a, friction=replace(a.friction, wander_period=d.scale.travel / 3.0)),
        wander=min(d.of(d.scale.rated) / _coulomb_of(a, d), 0.95),
    ),
    "mains": lambda a, d: _rippled(a, Harmonic(d.of(d.scale.rated), rate=float(d.rng.uniform(8, 40)))),
    "chatter": lambda a, d: _add_friction(a, chatter=d.of(d.scale.rated) / _coulomb_of(a, d)),
    "gms": _gms,
    "loop_delay": _loop_delay,
    "ripple_triangle": _triangle,
}
"""Effects that the catalogue of diagnosis does not hold, or holds in another form."""


def _payload(truth: Truth, d: Dose, *, lever: float) -> Truth:
    across = np.cross(d.body.direction, (0.3, 0.5, 0.8))
    centre = lever * across / np.linalg.norm(across)
    x, y, z = (float(v) for v in centre)
    load = Payload(d.body.joint, d.of(d.body.mass), (x, y, z))
    return replace(truth, payload=(*truth.payload, load))


def _pulses(truth: Truth, d: Dose) -> Truth:
    push, pulses = d.of(d.scale.rated), []
    for time in np.cumsum(d.rng.uniform(0.8, 3.0, 4)):
        x, y, z = (float(v) for v in push * np.asarray(d.body.world))
        force, moment = ((0.0, 0.0, 0.0), (x, y, z)) if d.scale.rotary else ((x, y, z), (0.0,) * 3)
        pulses.append(Pulse(d.body.link, float(time), 0.05, force, moment, logged=False))
    return replace(truth, external=(*truth.external, *pulses))


INJECT_MACHINE: Mapping[str, Callable[[Truth, Dose], Truth]] = {
    "payload": lambda t, d: _payload(t, d, lever=0.03),
    "inertial_coupling": lambda t, d: _payload(t, d, lever=0.12),
    "external_force": _pulses,
}
"""Effects of the whole machine; sizes: share of the body's mass, share of rated effort."""
