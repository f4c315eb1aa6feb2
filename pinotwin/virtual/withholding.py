"""What each effect is when it is left out of the truth; names as in the catalogue."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from pinotwin.virtual.axis_truth import AxisTruth, Cable
from pinotwin.virtual.truth import Truth

AxisChange = Callable[[AxisTruth], AxisTruth]


def _friction(**changes: float) -> AxisChange:
    return lambda a: replace(a, friction=replace(a.friction, **changes))  # type: ignore[arg-type]


def _controller(**changes: float) -> AxisChange:
    return lambda a: replace(a, controller=replace(a.controller, **changes))  # type: ignore[arg-type]


def _no_presliding(a: AxisTruth) -> AxisTruth:
    return replace(a, friction=replace(a.friction, presliding=(a.friction.presliding or 0.0) / 20.0))


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
    "hysteresis": _friction(drag=0.0),
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
