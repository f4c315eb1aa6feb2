"""Whether the efforts of a log can be those of the machine: sign, axis, instant, unit.

Nothing is fitted for its own sake here. Each effort is explained by the base parameters of the machine, whatever
their values, and by friction of its own axis (both linear), and the tests only use what no machine can break:
friction takes power out of a motion, an effort acts at once, on its own axis, and with the size that the
URDF's masses ask for, give or take a few times. A jackknife over blocks of the log says how sure a sign is.
"""

from __future__ import annotations

import numpy as np

from pinotwin.log import Log
from pinotwin.logs.effort_alone import Examined, Fit, alone, late, names_of, scaled, turned_round
from pinotwin.logs.exchanged import exchanged
from pinotwin.logs.explained import REACH, course, explained
from pinotwin.logs.quality import Finding
from pinotwin.logs.quality.sampling import SLOW
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.system.threads import one_blas_thread
from pinotwin.units import ELECTRICAL, si_factor


@one_blas_thread
def examined(machine: Machine, motion: Motion, log: Log) -> Examined | None:
    """Say which efforts of a log cannot be those of its axes, and why; None where too little moves to say it.

    Args:
        machine: the machine.
        motion: the log, prepared.
        log: the same, bound (SI), as the file has it.
    """
    if motion.step > 1.0 / SLOW:
        return None  # accelerations, and when a motion turns, fall between the samples
    reach = int(np.ceil(REACH / motion.step))
    at = course(motion, reach)
    if at is None:
        return None
    axes = tuple(explained(machine, motion.u, at))
    out = []
    fits: dict[str, Fit] = {}
    for axis in axes:
        raw = log.channels.get(f"{axis.name}.u", axis.u)
        found, fit = alone(axis, raw, reach)
        if found is None:
            fits[axis.name] = fit
        else:
            out.append(found)
    clear = [axis for axis in axes if axis.name in fits]
    swapped = list(exchanged(machine, motion.u, at, clear))
    out += swapped
    named = {name for finding in swapped for name in names_of(finding)}
    rest = [axis for axis in clear if axis.name not in named]
    out += late(rest, fits, motion.step)
    out += turned_round(rest, fits)
    reverse = {name for finding in out if finding.code == "effort_sign" for name in names_of(finding)}
    for axis in rest:
        if axis.name not in reverse:
            out += scaled(axis, fits[axis.name])
    return Examined(tuple(out), at, axes, fits, reach)


def unit_findings(log: Log) -> list[Finding]:
    """Say which efforts are still a drive's current or share: N and N·m are printed for them all the same.

    Args:
        log: bound (SI), with the unit of each channel and what it was scaled by.
    """
    of: dict[str, list[str]] = {}
    for name, unit in log.units.items():
        electrical = name.endswith(".u") and unit in ELECTRICAL
        if electrical and abs(log.scale.get(name, (0.0, 0.0))[0]) == si_factor(unit):
            of.setdefault(ELECTRICAL[unit], []).append(name)
    return [
        Finding(
            "warning",
            ", ".join(names),
            f"in {unit} (no factor under columns): read N and N·m as {unit} below. Coupled axes, gravity and payload "
            "need the factor (torque constant x gear)",
            "effort_unit",
        )
        for unit, names in of.items()
    ]
