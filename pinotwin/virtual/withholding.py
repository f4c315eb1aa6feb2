"""What each effect is when it is left out of the truth; names as in the catalogue."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from pinotwin.virtual.axis_truth import AxisTruth, Cable
from pinotwin.virtual.truth import Truth


def changed(axis: AxisTruth, part: str, **values: Any) -> AxisTruth:
    """Return the truth of an axis with other values in one of its parts."""
    return replace(axis, **{part: replace(getattr(axis, part), **values)})


def limited(axis: AxisTruth, limit: float) -> AxisTruth:
    """Return the truth of an axis with another limit of its effort [N or N·m]."""
    return changed(axis, "controller", effort_limit=limit, integral_limit=limit)


WITHHOLD: Mapping[str, Callable[[AxisTruth], AxisTruth]] = {  # effects of one axis that can be left out
    "viscous": lambda a: changed(a, "friction", viscous=0.0),
    "coulomb": lambda a: changed(a, "friction", coulomb=0.0),
    "coulomb_asymmetric": lambda a: changed(a, "friction", asymmetry=0.0),
    "stribeck": lambda a: changed(a, "friction", static=1.0),
    "load_friction": lambda a: changed(a, "friction", load=0.0),
    "presliding": lambda a: changed(a, "friction", presliding=(a.friction.presliding or 0.0) / 20.0),
    "ripple": lambda a: replace(a, ripple=()),
    "ripple_modulated": lambda a: replace(a, ripple=tuple(replace(r, modulation=0.0) for r in a.ripple)),
    "position_table": lambda a: replace(a, cable=Cable()),
    "drive_flexibility": lambda a: changed(a, "drive", frequency=0.0),
    "joint_flexibility": lambda a: replace(a, bend=None),
    "backlash": lambda a: changed(a, "drive", backlash=0.0),
    "delay": lambda a: changed(changed(a, "controller", delay=0), "effort", lag=0.0),
    "effort_scale": lambda a: changed(a, "effort", scale=1.0),
    "encoder_error": lambda a: changed(a, "encoder", error=0.0, pitch=0.0),
    "viscous_thermal": lambda a: changed(a, "friction", warming=0.0),
    "feedforward": lambda a: changed(a, "controller", acceleration_feedforward=1.0),
    "saturation": lambda a: limited(a, 100.0 * (a.controller.effort_limit or 1.0)),
    "geometric_error": lambda a: replace(a, tilt=(0.0, 0.0, 0.0)),
    "quadratic_drag": lambda a: changed(a, "friction", quadratic=0.0),
    "hysteresis": lambda a: changed(a, "friction", drag=0.0),
    "coulomb_position": lambda a: changed(a, "friction", wander=0.0),
    "chatter": lambda a: changed(a, "friction", chatter=0.0),
}

WITHHOLD_MACHINE: Mapping[str, Callable[[Truth], Truth]] = {
    "payload": lambda t: replace(t, payload=()),
    "inertial_coupling": lambda t: replace(t, coupled=False),
    "external_force": lambda t: replace(t, external=()),
}
"""Effects of the whole machine that can be left out."""
