"""The flexible plant from servo logs and reconstructed vibrations (thesis Section 7.2), see docs/vibration.md.

The spring's intervals are widened by the reconstruction's own uncertainty of the mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinotwin.errors import DataError
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.reconstruction.combine import at_stamps
from pinotwin.reconstruction.result import Vibration
from pinotwin.twin import Twin
from pinotwin.twin.parameters import Parameter


def with_vibration(log: Log, vibration: Vibration | Log, *, row: bool = False) -> Log:
    """Return the servo log with the channel ``<joint>.v`` of the vibration; DataError where that does not cover it.

    The velocity is all that the motors' equations take (thesis Eq. 7.2); ``row`` adds ``.q`` and ``.a`` as well.
    """
    if isinstance(vibration, Vibration):
        vibration = vibration.to_log()
    name = next((c.removesuffix(".v") for c in vibration.channels if c.endswith(".v")), "")
    channels = dict(log.channels)
    units = dict(log.units)
    kinds = ("q", "v", "a") if row else ("v",)
    for kind in kinds:
        if f"{name}.{kind}" not in vibration:
            raise DataError(
                f"{vibration.source}: no channel {name or '<joint>'}.{kind}; give the file that "
                "`pinotwin vibration` wrote"
            )
        channels[f"{name}.{kind}"] = at_stamps(log.t, vibration.t, vibration[f"{name}.{kind}"], bridged=3.5)
        units.pop(f"{name}.{kind}", None)
    known = np.isfinite(channels[f"{name}.v"]).mean() if len(log) else 0.0
    if known < 0.5:
        raise DataError(
            f"{vibration.source}: covers {known:.0%} of {log.source}; it must be of the same run, "
            "on the same clock"
        )
    scale = {**log.scale, **{f"{name}.{k}": (1.0, 0.0) for k in kinds}} if log.scale else {}
    return replace(log, channels=channels, units=units, scale=scale)


@dataclass(frozen=True)
class Flexible:
    """A flexible plant."""

    twin: Twin  # motors' rows fitted with the vibration; its spring is the one found
    stiffness: Parameter  # of the passive joint [N·m/rad]
    damping: Parameter  # [N·m·s/rad]
    residual: float  # RMS of the joint's own row [N·m]
    load: float  # RMS of the torque it balances [N·m]


def identify_flexible(
    machine: Machine,
    logs: Log | Sequence[Log],
    vibrations: Vibration | Log | Sequence[Vibration | Log],
    **options: Any,
) -> Flexible:
    """Identify with the vibration of the passive joint; options of :func:`pinotwin.identify`, DataError if no pairs."""
    several = [logs] if isinstance(logs, Log) else list(logs)
    given: list[Vibration | Log]
    given = [vibrations] if isinstance(vibrations, Vibration | Log) else list(vibrations)
    if len(several) != len(given):
        raise DataError(f"{len(several)} logs and {len(given)} vibrations; give them in pairs")
    joined = [with_vibration(log, v, row=True) for log, v in zip(several, given, strict=True)]
    twin = identify(machine, joined, **{"loop": False, "consistent": False, **options})
    joint = next(iter(machine.passive))
    k, c = (twin.parameter(f"{joint}.spring.{n}") for n in "kc")
    relative = []  # the reconstruction's own uncertainty of the mode: k ~ wn², c ~ zeta wn
    for v in (v for v in given if isinstance(v, Vibration)):
        (f, f_se), (zeta, zeta_se) = v.frequency, v.damping
        relative.append((2.0 * f_se / f, float(np.hypot(f_se / f, zeta_se / zeta))))
    if relative:
        of_k, of_c = np.sqrt(np.mean(np.square(relative), axis=0) / len(relative))
        k = replace(k, error=float(np.hypot(k.error, k.value * of_k)))
        c = replace(c, error=float(np.hypot(c.error, c.value * of_c)))
    row = twin.quality["springs"][joint]
    return Flexible(twin, k, c, row["residual"], row["load"])
