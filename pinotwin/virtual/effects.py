"""Switch effects of the truth off (withhold) and on (inject), by the names of the catalogue.

A request is ``"name"``, ``"name:axis"`` or ``"name:axis=size"``, or a mapping with the keys ``effect``,
``axis``, ``size``, ``value``, ``seed``. ``size`` is relative (see :data:`INJECT`): for an effort it is
a share of the axis' rated effort. ``value`` sets the SI quantity instead. Names outside the catalogue of
diagnosis exist too (:data:`OUTSIDE`): they test that an answer can be "unknown".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.errors import InputError, nearest
from pinotwin.virtual.defaults import Scale
from pinotwin.virtual.truth import (
    AxisTruth,
    Bend,
    Cable,
    Harmonic,
    Payload,
    Pulse,
    Truth,
)

Request = Mapping[str, object] | str
AxisChange = Callable[[AxisTruth], AxisTruth]


def _friction(**changes: float) -> AxisChange:
    return lambda a: replace(a, friction=replace(a.friction, **changes))  # type: ignore[arg-type]


def _controller(**changes: float) -> AxisChange:
    return lambda a: replace(a, controller=replace(a.controller, **changes))  # type: ignore[arg-type]


def _no_presliding(a: AxisTruth) -> AxisTruth:
    return replace(
        a, friction=replace(a.friction, presliding=(a.friction.presliding or 0.0) / 20.0)
    )


def _no_modulation(a: AxisTruth) -> AxisTruth:
    return replace(a, ripple=tuple(replace(r, modulation=0.0) for r in a.ripple))


def _no_delay(a: AxisTruth) -> AxisTruth:
    prompt = replace(a.controller, delay=0)
    return replace(a, controller=prompt, effort=replace(a.effort, lag=0.0))


def _no_limit(a: AxisTruth) -> AxisTruth:
    limit = 100.0 * (a.controller.effort_limit or 1.0)
    return replace(a, controller=replace(a.controller, effort_limit=limit, integral_limit=limit))


WITHHOLD: Mapping[str, AxisChange] = {
    "viscous": _friction(viscous=0.0),
    "coulomb": _friction(coulomb=0.0),
    "coulomb_asymmetric": _friction(asymmetry=0.0),
    "stribeck": _friction(static=1.0),
    "load_friction": _friction(load=0.0),
    "presliding": _no_presliding,
    "ripple": lambda a: replace(a, ripple=()),
    "ripple_modulated": _no_modulation,
    "position_table": lambda a: replace(a, cable=Cable()),
    "drive_flexibility": lambda a: replace(a, drive=replace(a.drive, frequency=0.0)),
    "joint_flexibility": lambda a: replace(a, bend=None),
    "backlash": lambda a: replace(a, drive=replace(a.drive, backlash=0.0)),
    "delay": _no_delay,
    "effort_scale": lambda a: replace(a, effort=replace(a.effort, scale=1.0)),
    "encoder_error": lambda a: replace(a, encoder=replace(a.encoder, error=0.0, pitch=0.0)),
    "viscous_thermal": _friction(warming=0.0),
    "feedforward": _controller(acceleration_feedforward=1.0),
    "saturation": _no_limit,
    "geometric_error": lambda a: replace(a, tilt=(0.0, 0.0, 0.0)),
    "quadratic_drag": _friction(quadratic=0.0),
    "coulomb_position": _friction(wander=0.0),
    "chatter": _friction(chatter=0.0),
}
"""Effects of one axis that can be left out."""

WITHHOLD_MACHINE: Mapping[str, Callable[[Truth], Truth]] = {
    "payload": lambda t: replace(t, payload=()),
    "inertial_coupling": lambda t: replace(t, coupled=False),
    "external_force": lambda t: replace(t, external=()),
}
"""Effects of the whole machine that can be left out."""


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
    rotor = a.drive.rotor or a.drive.motor_share * d.scale.inertia
    return replace(a, drive=replace(a.drive, frequency=_mode(d), rotor=rotor))


def _backlash(a: AxisTruth, d: Dose) -> AxisTruth:
    rotor = a.drive.rotor or a.drive.motor_share * d.scale.inertia
    gap = d.of(1e-3 if d.scale.rotary else 1e-4)
    stiff = a.drive.frequency or 90.0
    return replace(a, drive=replace(a.drive, backlash=gap, frequency=stiff, rotor=rotor))


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
    limit = d.value if d.value is not None else (1.0 - d.size) * d.scale.rated
    return replace(a, controller=replace(a.controller, effort_limit=limit, integral_limit=limit))


def _feedforward(a: AxisTruth, d: Dose) -> AxisTruth:
    share = a.controller.acceleration_feedforward * (1.0 - d.of(1.0))
    return replace(a, controller=replace(a.controller, acceleration_feedforward=share))


def _loop_delay(a: AxisTruth, d: Dose) -> AxisTruth:
    return replace(a, controller=replace(a.controller, delay=max(1, round(d.of(40.0)))))


INJECT: Mapping[str, Callable[[AxisTruth, Dose], AxisTruth]] = {
    # size: share of rated effort at the speed limit
    "viscous": lambda a, d: _add_friction(a, viscous=d.of(d.scale.rated / d.scale.speed)),
    "quadratic_drag": lambda a, d: _add_friction(
        a, quadratic=d.of(d.scale.rated / d.scale.speed**2)
    ),
    # size: share of rated effort
    "coulomb": lambda a, d: _add_friction(a, coulomb=d.of(d.scale.rated)),
    "coulomb_asymmetric": lambda a, d: _add_friction(
        a, asymmetry=d.of(d.scale.rated) / _coulomb_of(a, d)
    ),
    "stribeck": lambda a, d: _add_friction(a, static=d.of(d.scale.rated) / _coulomb_of(a, d)),
    "ripple": lambda a, d: _rippled(a, _harmonic(d)),
    "ripple_modulated": lambda a, d: _rippled(
        a, _harmonic(d, modulation=1.5, modulation_phase=0.7)
    ),
    "position_table": _cable,
    # size: level per transmitted effort; relative change; relative scale; share of feed-forward lost
    "load_friction": lambda a, d: _add_friction(a, load=d.of(1.0)),
    "viscous_thermal": lambda a, d: _add_friction(a, warming=-min(d.of(1.0), 0.95)),
    "effort_scale": lambda a, d: replace(a, effort=replace(a.effort, scale=1.0 + d.of(1.0))),
    "feedforward": _feedforward,
    "saturation": _limit,
    # size 0.1: presliding 6 times wider, mode at 63 Hz, 10 um or 0.1 mrad, 1 ms, 10 mrad
    "presliding": lambda a, d: _add_friction(
        a, presliding=d.of(50.0 * (a.friction.presliding or 1e-5))
    ),
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
    "mains": lambda a, d: _rippled(
        a, Harmonic(d.of(d.scale.rated), rate=float(d.rng.uniform(8, 40)))
    ),
    "chatter": lambda a, d: _add_friction(a, chatter=d.of(d.scale.rated) / _coulomb_of(a, d)),
    "gms": _gms,
    "loop_delay": _loop_delay,
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
    for time in np.sort(d.rng.uniform(1.0, 10.0, 3)):
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


def parse(request: Request) -> dict[str, object]:
    """Return a request as a mapping with the keys effect, axis, size, value and seed."""
    if isinstance(request, str):
        name, _, size = request.partition("=")
        effect, _, axis = name.partition(":")
        out: dict[str, object] = {"effect": effect.strip()}
        if axis.strip():
            out["axis"] = axis.strip()
        if size:
            try:
                out["size"] = float(size)
            except ValueError:
                raise InputError(f"effect {request!r}: the size must be a number") from None
        return out
    for key in request:
        if key not in ("effect", "axis", "size", "value", "seed"):
            raise InputError(
                f"effect {dict(request)!r}: unknown key {key!r}; known: axis, effect, seed, size, value"
            )
    return dict(request)


def _axes_of(axis: object, truth: Truth) -> list[str]:
    if axis is None:
        return list(truth.axes)
    if axis not in truth.axes:
        raise InputError(f"no axis {axis!r}; {nearest(str(axis), truth.axes)}")
    return [str(axis)]


def withhold_all(truth: Truth, requests: Sequence[str]) -> Truth:
    """Return the truth without the named effects (on one axis, or on all)."""
    for request in requests:
        item = parse(request)
        name = str(item["effect"])
        if name in WITHHOLD_MACHINE:
            truth = WITHHOLD_MACHINE[name](truth)
        elif name in WITHHOLD:
            axes = dict(truth.axes)
            for axis in _axes_of(item.get("axis"), truth):
                axes[axis] = WITHHOLD[name](axes[axis])
            truth = replace(truth, axes=axes)
        else:
            known = [*WITHHOLD, *WITHHOLD_MACHINE]
            raise InputError(f"cannot withhold {name!r}; {nearest(name, known)}")
    return truth


def inject_all(
    truth: Truth, requests: Sequence[Request], scales: Mapping[str, Scale], bodies: Bodies
) -> Truth:
    """Return the truth with the effects added.

    Args:
        truth: resolved truth.
        requests: what to add.
        scales: reference sizes of the axes.
        bodies: what each axis moves.
    """
    for request in requests:
        item = parse(request)
        name = str(item["effect"])
        known = {**INJECT, **OUTSIDE}
        if name not in known and name not in INJECT_MACHINE:
            raise InputError(f"cannot inject {name!r}; {nearest(name, [*known, *INJECT_MACHINE])}")
        for axis in _axes_of(item.get("axis"), truth):
            dose = _dose(item, axis, scales[axis], bodies[axis])
            if name in INJECT_MACHINE:
                truth = INJECT_MACHINE[name](truth, dose)
            else:
                truth = replace(
                    truth, axes={**truth.axes, axis: known[name](truth.axes[axis], dose)}
                )
    return truth


def _dose(item: Mapping[str, object], axis: str, scale: Scale, body: Body) -> Dose:
    value = item.get("value")
    seed = int(str(item.get("seed", 0)))
    return Dose(
        axis=axis,
        size=float(str(item.get("size", 0.1))),
        value=None if value is None else float(str(value)),
        scale=scale,
        rng=np.random.default_rng([seed, sum(map(ord, axis))]),
        body=body,
    )
