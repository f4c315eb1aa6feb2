"""Whether the efforts of a log can be those of the machine: sign, axis, instant, unit.

Friction takes power out of a motion, an effort acts at once, on its own axis, and about as large as the URDF's masses
ask for. An axis without a finding is spoiled once more, to see what the same tests could not have named in this log.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pinotwin.columns import unsized
from pinotwin.log import Log
from pinotwin.logs.command import untold
from pinotwin.logs.effort_alone import (
    Examined,
    alone,
    frictionless,
    is_reversed,
    is_strange,
    is_unsigned,
    late,
    named,
    scaled,
    turned_round,
    weightless,
)
from pinotwin.logs.exchanged import exchanged, not_told
from pinotwin.logs.explained import Explained, course, explained
from pinotwin.logs.quality.results import Finding, finding
from pinotwin.logs.settings import USUAL, Settings
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.system.threads import one_blas_thread

_WORDS = {
    "effort": "exchanged efforts of {0}",
    "position": "exchanged positions of {0}",
    "sign": "a position that runs the other way of {0}",
}


@one_blas_thread
def examined(machine: Machine, motion: Motion, log: Log, settings: Settings = USUAL) -> Examined | None:
    """Say which efforts of a bound log cannot be those of its axes, and why; None where too little moves to say it."""
    if motion.step > 1.0 / settings.slow_rate:
        return None  # accelerations, and when a motion turns, fall between the samples
    at = course(motion, settings)
    if at is None:
        return None
    axes = tuple(explained(machine, motion.u, at))
    fits = {axis.name: axis.lag() for axis in axes}
    nonsense = {x.name: alone(x, log.channels.get(f"{x.name}.u", x.u), fits[x.name]) for x in axes}
    clear = [axis for axis in axes if nonsense[axis.name] is None]
    out = [one for one in nonsense.values() if one is not None]
    swapped = list(exchanged(machine, motion.u, at, clear))
    rest = [axis for axis in clear if axis.name not in named(swapped)]
    open_ = {*unsized(log), *(name for name, column in machine.columns.items() if column.found)}
    wrong_sign = list(turned_round(rest, fits))
    light = [] if wrong_sign else list(weightless([x for x in rest if f"{x.name}.u" not in open_]))
    out += [*swapped, *late(rest, fits, motion.step), *wrong_sign, *light, *frictionless(rest)]
    out += [finding("effort_strange", f"{x.name}.u") for x in rest if is_strange(x, fits[x.name])]
    for axis in rest:
        if axis.name not in named(wrong_sign) and f"{axis.name}.u" not in open_:
            out += scaled(axis, fits[axis.name])
    return Examined(tuple(out), at, axes)


def unit_findings(log: Log) -> list[Finding]:
    """Say which efforts of a bound log are in units of a drive, whose size in N or N·m `identify` finds."""
    of: dict[str, list[str]] = {}
    for name, unit in unsized(log).items():
        of.setdefault(unit, []).append(name)
    return [finding("effort_unit", ", ".join(names), unit=unit) for unit, names in of.items()]


@one_blas_thread
def unseen(machine: Machine, motion: Motion, efforts: Examined, most: int = 12) -> list[Finding]:
    """Say in one line what would go unnamed, tried on 1000 rows; of ``most`` axes, as pairs of 100 would take a day."""
    if len(efforts.sound) > most:
        return [finding("not_tried", most=most)]
    at, sound = efforts.at.thinned(1000), [axis.name for axis in efforts.sound]
    of: dict[str, list[str]] = {}
    for axis in explained(machine, motion.u, at):
        for what in _of_effort(axis, motion.step) if axis.name in sound else ():
            of.setdefault(what, []).append(axis.name)
        if untold(motion, machine.axes[axis.name].index, efforts.at.settings):
            of.setdefault("a command of {0} that is 20 ms late", []).append(axis.name)
    for what, *who in not_told(machine, motion.u, at, sound):
        of.setdefault(_WORDS[what], []).append(" and ".join(who))
    said = "; ".join(words.format(", ".join(who)) for words, who in of.items())
    return [finding("not_told", what=said)] if of else []


def _of_effort(axis: Explained, step: float, lag: float = 0.02, unit: float = 9.0) -> Iterator[str]:
    """Yield what would go unnamed of one effort: so late [s], so many times too large, or without its sign."""
    behind = replace(axis, u=np.roll(axis.u, round(lag / step)))
    if not list(late([behind], {axis.name: behind.lag()}, step)):
        yield "an effort of {0} that is 20 ms late"
    fit = axis.lag()
    if not all(list(scaled(replace(axis, u=f * axis.u), fit)) for f in (unit, 1.0 / unit)):
        yield "a wrong effort unit on {0}"
    if not is_reversed(replace(axis, u=-axis.u), fit):
        yield "a wrong effort sign on {0}"
    low, high = np.percentile(axis.u[axis.rows], (0.5, 99.5))
    hangs = low > 0.1 * high or high < 0.1 * low
    if not hangs and not is_unsigned(replace(axis, u=np.abs(axis.u)), np.abs(axis.u)):
        yield "a missing effort sign on {0}"
