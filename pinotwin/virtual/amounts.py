"""Switch effects of the truth off (withhold) and on (inject), by the names of the catalogue.

``"name"``, ``"name:axis"``, ``"name:axis=size"``, or a mapping of ``effect``, ``axis``, ``size``, ``value``, ``seed``;
``value`` is the SI quantity, ``size`` relative: of an effort a share of the rated one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import InputError, require
from pinotwin.virtual.axis_truth import CONTACT, AxisTruth, Bend, Cable, Harmonic
from pinotwin.virtual.defaults import Scale
from pinotwin.virtual.truth import Payload, Pulse, Truth
from pinotwin.virtual.withholding import WITHHOLD, WITHHOLD_MACHINE, changed, limited


@dataclass(frozen=True)
class Body:
    """What an axis moves."""

    joint: str  # URDF joint
    link: str  # link behind it
    direction: tuple[float, ...]  # joint axis in the joint frame
    world: tuple[float, ...]  # joint axis in the world, at home
    mass: float  # mass of the body [kg]


Bodies = Mapping[str, Body]


@dataclass(frozen=True)
class Dose:
    """How much of an effect, where, and with what scale of the axis."""

    size: float  # relative size [-]
    value: float | None  # SI quantity in place of the size, or None
    scale: Scale  # reference sizes of the axis
    rng: np.random.Generator  # for what is left to chance (phases, periods, times)
    body: Body  # what the axis moves

    def of(self, reference: float) -> float:
        """Return the SI quantity: the value if given, else size times the reference."""
        return self.value if self.value is not None else self.size * reference


def _more(a: AxisTruth, **added: float) -> AxisTruth:
    return changed(a, "friction", **{k: (getattr(a.friction, k) or 0.0) + x for k, x in added.items()})


def _per_coulomb(a: AxisTruth, d: Dose) -> float:
    """Return an effort as a share of the axis' Coulomb level [-]."""
    return d.of(d.scale.rated) / max(a.friction.coulomb or 0.0, 1e-3 * d.scale.rated)


def _harmonic(d: Dose, **more: float) -> Harmonic:
    period = d.scale.travel / d.rng.uniform(8.0, 30.0)
    if d.scale.rotary:
        period = 2.0 * np.pi / int(d.rng.integers(8, 40))
    phase = float(d.rng.uniform(0.0, 2.0 * np.pi))
    return Harmonic(d.of(d.scale.rated), float(period), phase, **more)


def _rippled(a: AxisTruth, *more: Harmonic) -> AxisTruth:
    return replace(a, ripple=(*a.ripple, *more))


def _mode(d: Dose) -> float:
    return d.value if d.value is not None else 20.0 / float(np.sqrt(d.size))


def _length(d: Dose) -> float:
    """Return a clearance or an error of position [m or rad]."""
    return d.of(1e-3 if d.scale.rotary else 1e-4)


def _elastic(a: AxisTruth, d: Dose, **drive: float) -> AxisTruth:
    """Return the axis with an elastic drive; its rotor, if it had none, is a part of the axis' inertia."""
    if not a.drive.rotor:
        a = changed(a, "drive", rotor=a.drive.motor_share * d.scale.least, inside=True)
    return changed(a, "drive", **drive)


def _encoder(a: AxisTruth, d: Dose) -> AxisTruth:
    period = 2.0 * np.pi if d.scale.rotary else d.scale.travel / 8.0
    phase = float(d.rng.uniform(0.0, 2.0 * np.pi))
    return changed(a, "encoder", error=_length(d), period=period, phase=phase)


def _cable(a: AxisTruth, d: Dose) -> AxisTruth:
    size, seed = d.of(d.scale.rated), int(d.rng.integers(1 << 30))
    return replace(a, cable=Cable(size, d.scale.travel / 25.0, 2.0 * size, seed))


def _tilt(a: AxisTruth, d: Dose) -> AxisTruth:
    angle = d.of(0.1)
    side = np.cross(d.body.direction, d.rng.standard_normal(3))
    return replace(a, tilt=_triple(angle * side / np.linalg.norm(side)))


def _limit(a: AxisTruth, d: Dose) -> AxisTruth:
    # What gravity asks for stays within reach: an axis that falls is no fault of a drive's limit.
    hold, rest = d.scale.hold, d.scale.rated - d.scale.hold
    return limited(a, d.value if d.value is not None else hold + (1.3 - d.size) * rest)


def _triangle(a: AxisTruth, d: Dose) -> AxisTruth:
    """Add a ripple of straight flanks: a triangle's first three harmonics (1, 1/9, 1/25)."""
    first = _harmonic(d)
    waves = [
        replace(first, amplitude=s * first.amplitude / n**2, period=first.period / n, phase=n * first.phase)
        for n, s in ((1, 1.0), (3, -1.0), (5, 1.0))
    ]
    return _rippled(a, *waves)


INJECT: Mapping[str, Callable[[AxisTruth, Dose], AxisTruth]] = {
    # size: share of rated effort at the speed limit
    "viscous": lambda a, d: _more(a, viscous=d.of(d.scale.rated / d.scale.speed)),
    "quadratic_drag": lambda a, d: _more(a, quadratic=d.of(d.scale.rated / d.scale.speed**2)),
    # size: share of rated effort
    "coulomb": lambda a, d: _more(a, coulomb=d.of(d.scale.rated)),
    "hysteresis": lambda a, d: changed(
        a, "friction", drag=d.of(d.scale.rated), drag_distance=0.03 * d.scale.travel
    ),
    "coulomb_asymmetric": lambda a, d: _more(a, asymmetry=_per_coulomb(a, d)),
    "stribeck": lambda a, d: _more(a, static=_per_coulomb(a, d)),
    "ripple": lambda a, d: _rippled(a, _harmonic(d)),
    "ripple_modulated": lambda a, d: _rippled(a, _harmonic(d, modulation=1.5, modulation_phase=0.7)),
    "position_table": _cable,
    # size: level per transmitted effort; relative change; relative scale; share lost
    "load_friction": lambda a, d: _more(a, load=d.of(1.0)),
    "viscous_thermal": lambda a, d: changed(a, "friction", warming=-min(d.of(1.0), 0.95), warming_time=8.0),
    "effort_scale": lambda a, d: changed(a, "effort", scale=1.0 + d.of(1.0)),
    "feedforward": lambda a, d: changed(
        a, "controller", acceleration_feedforward=a.controller.acceleration_feedforward * (1.0 - d.of(1.0))
    ),
    "saturation": _limit,
    # size 0.1: presliding 6 times wider, mode at 63 Hz, 10 um or 0.1 mrad, 1 ms, 10 mrad
    "presliding": lambda a, d: _more(a, presliding=d.of(50.0 * (a.friction.presliding or 1e-5))),
    "drive_flexibility": lambda a, d: _elastic(a, d, frequency=_mode(d)),
    "joint_flexibility": lambda a, d: replace(a, bend=Bend(_mode(d))),
    "backlash": lambda a, d: _elastic(a, d, backlash=_length(d), frequency=a.drive.frequency or CONTACT),
    "encoder_error": _encoder,
    "delay": lambda a, d: changed(a, "effort", lag=a.effort.lag + d.of(1e-2)),
    "geometric_error": _tilt,
}
"""Effects of one axis that can be added; sizes as the comments say."""

OUTSIDE: Mapping[str, Callable[[AxisTruth, Dose], AxisTruth]] = {
    "ripple_speed": lambda a, d: _rippled(a, _harmonic(d, speed=d.scale.speed)),
    "coulomb_position": lambda a, d: _more(
        changed(a, "friction", wander_period=d.scale.travel / 3.0), wander=min(_per_coulomb(a, d), 0.95)
    ),
    "mains": lambda a, d: _rippled(a, Harmonic(d.of(d.scale.rated), rate=float(d.rng.uniform(8, 40)))),
    "chatter": lambda a, d: _more(a, chatter=_per_coulomb(a, d)),
    "gms": lambda a, d: changed(
        a, "friction", kind="gms", presliding=(a.friction.presliding or 1e-5) * (1.0 + 10.0 * d.size)
    ),
    "loop_delay": lambda a, d: changed(a, "controller", delay=max(1, round(d.of(40.0)))),
    "ripple_triangle": _triangle,
}
"""Effects that the catalogue of diagnosis does not hold, or holds in another form."""


def _triple(x: Floats) -> tuple[float, float, float]:
    return float(x[0]), float(x[1]), float(x[2])


def _payload(truth: Truth, d: Dose, *, lever: float) -> Truth:
    across = np.cross(d.body.direction, (0.3, 0.5, 0.8))
    load = Payload(d.body.joint, d.of(d.body.mass), _triple(lever * across / np.linalg.norm(across)))
    return replace(truth, payload=(*truth.payload, load))


def _pulses(truth: Truth, d: Dose) -> Truth:
    none, peak = (0.0, 0.0, 0.0), _triple(d.of(d.scale.rated) * np.asarray(d.body.world))
    load = (none, peak) if d.scale.rotary else (peak, none)
    times = np.cumsum(d.rng.uniform(0.8, 3.0, 4)).tolist()
    pulses = [Pulse(d.body.link, t, 0.05, *load, logged=False) for t in times]
    return replace(truth, external=(*truth.external, *pulses))


INJECT_MACHINE: Mapping[str, Callable[[Truth, Dose], Truth]] = {
    "payload": lambda t, d: _payload(t, d, lever=0.03),
    "inertial_coupling": lambda t, d: _payload(t, d, lever=0.12),
    "external_force": _pulses,
}
"""Effects of the whole machine; sizes: share of the body's mass, share of rated effort."""


Request = Mapping[str, object] | str
KEYS = ("axis", "effect", "seed", "size", "value")


def parse(request: Request) -> dict[str, object]:
    """Return a request as a mapping with some of :data:`KEYS`."""
    if not isinstance(request, str):
        for key in request:
            require(key, KEYS, f"effect {dict(request)!r}: unknown key", InputError)
        return dict(request)
    name, _, size = request.partition("=")
    effect, _, axis = (x.strip() for x in name.partition(":"))
    out: dict[str, object] = {"effect": effect, **({"axis": axis} if axis else {})}
    try:
        return {**out, "size": float(size)} if size else out
    except ValueError:
        raise InputError(f"effect {request!r}: the size must be a number") from None


def _axes_of(axis: object, truth: Truth) -> list[str]:
    if axis is None:
        return list(truth.axes)
    require(str(axis), truth.axes, "no axis", InputError)
    return [str(axis)]


def withhold_all(truth: Truth, requests: Sequence[str]) -> Truth:
    """Return the truth without the named effects (on one axis, or on all)."""
    for request in requests:
        item = parse(request)
        name = str(item["effect"])
        require(name, [*WITHHOLD, *WITHHOLD_MACHINE], "cannot withhold", InputError)
        if name in WITHHOLD_MACHINE:
            truth = WITHHOLD_MACHINE[name](truth)
        else:
            less = {a: WITHHOLD[name](truth.axes[a]) for a in _axes_of(item.get("axis"), truth)}
            truth = replace(truth, axes={**truth.axes, **less})
    return truth


def inject_all(
    truth: Truth, requests: Sequence[Request], scales: Mapping[str, Scale], bodies: Bodies
) -> Truth:
    """Return the truth with effects added, sized by the scales of the axes and the bodies that they move."""
    known = {**INJECT, **OUTSIDE}
    for request in requests:
        item = parse(request)
        name, value = str(item["effect"]), item.get("value")
        require(name, [*known, *INJECT_MACHINE], "cannot inject", InputError)
        size, si = float(str(item.get("size", 0.1))), None if value is None else float(str(value))
        for axis in _axes_of(item.get("axis"), truth):
            rng = np.random.default_rng([int(str(item.get("seed", 0))), sum(map(ord, axis))])
            dose = Dose(size, si, scales[axis], rng, bodies[axis])
            if name in INJECT_MACHINE:
                truth = INJECT_MACHINE[name](truth, dose)
            else:
                truth = replace(truth, axes={**truth.axes, axis: known[name](truth.axes[axis], dose)})
    return truth
