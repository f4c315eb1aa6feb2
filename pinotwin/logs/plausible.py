"""Whether the efforts of a log can be those of the machine: sign, axis, instant, unit.

Friction takes power out of a motion, an effort acts at once, on its own axis, and about as large as the URDF's masses
ask for. An axis without a finding is spoiled once more, to see what the same tests could not have named in this log.
Exchanged efforts fit the motion of the other axis; wrong positions spoil all efforts: the machine is tried anew.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.columns import unsized
from pinotwin.log import Log
from pinotwin.logs import effort_alone as effort
from pinotwin.logs.effort_alone import Examined
from pinotwin.logs.explained import Course, Explained, course, explained
from pinotwin.logs.quality.results import Finding, finding
from pinotwin.logs.settings import USUAL, Settings
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.system.threads import one_blas_thread

_Shares = Mapping[str, float]  # axis -> share of the power of its effort that nothing accounts for
_WRONG = {  # what is wrong -> signal, code of its finding, and its words
    "effort": ("u", "effort_exchanged", "exchanged efforts of {0}"),
    "position": ("q", "position_exchanged", "exchanged positions of {0}"),
    "sign": ("q", "position_sign", "a position that runs the other way of {0}"),
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
    nonsense = {x.name: effort.alone(x, log.channels.get(f"{x.name}.u", x.u), fits[x.name]) for x in axes}
    clear = [axis for axis in axes if nonsense[axis.name] is None]
    out = [one for one in nonsense.values() if one is not None]
    swapped = list(exchanged(machine, motion.u, at, clear))
    rest = [axis for axis in clear if axis.name not in effort.named(swapped)]
    open_ = {*unsized(log), *(name for name, column in machine.columns.items() if column.found)}
    wrong_sign = list(effort.turned_round(rest, fits))
    light = [] if wrong_sign else list(effort.weightless([x for x in rest if f"{x.name}.u" not in open_]))
    out += [*swapped, *effort.late(rest, fits, motion.step), *wrong_sign, *light, *effort.frictionless(rest)]
    out += [finding("effort_strange", f"{x.name}.u") for x in rest if effort.is_strange(x, fits[x.name])]
    for axis in rest:
        if axis.name not in effort.named(wrong_sign) and f"{axis.name}.u" not in open_:
            out += effort.scaled(axis, fits[axis.name])
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
        if effort.untold(motion, axis.index, efforts.at.settings):
            of.setdefault("a command of {0} that is 20 ms late", []).append(axis.name)
    for what, *who in not_told(machine, motion.u, at, sound):
        of.setdefault(_WRONG[what][2], []).append(" and ".join(who))
    said = "; ".join(words.format(", ".join(who)) for words, who in of.items())
    return [finding("not_told", what=said)] if of else []


def _of_effort(axis: Explained, step: float, lag: float = 0.02, unit: float = 9.0) -> Iterator[str]:
    """Yield what would go unnamed of one effort: so late [s], so many times too large, or without its sign."""
    behind = replace(axis, u=np.roll(axis.u, round(lag / step)))
    if not list(effort.late([behind], {axis.name: behind.lag()}, step)):
        yield "an effort of {0} that is 20 ms late"
    fit = axis.lag()
    if not all(list(effort.scaled(replace(axis, u=f * axis.u), fit)) for f in (unit, 1.0 / unit)):
        yield "a wrong effort unit on {0}"
    if not effort.is_reversed(replace(axis, u=-axis.u), fit):
        yield "a wrong effort sign on {0}"
    low, high = np.percentile(axis.u[axis.rows], (0.5, 99.5))
    hangs = low > 0.1 * high or high < 0.1 * low
    if not hangs and not effort.is_unsigned(replace(axis, u=np.abs(axis.u)), np.abs(axis.u)):
        yield "a missing effort sign on {0}"


def exchanged(machine: Machine, u: Floats, at: Course, axes: Sequence[Explained]) -> Iterator[Finding]:
    """Name axes with each other's effort (``u``, (n, nv)) or position, or the other way round; ``axes`` are sound."""
    limit, of = at.settings, {axis.name: axis for axis in axes}
    own = {name: axis.left for name, axis in of.items()}
    doubted = max(own.values(), default=0.0) > limit.clear

    def put_back(other: Course, *who: str) -> float:
        now = _left(machine, u, other)
        return _of_positions(own, now, who, limit) if set(own) <= set(now) else 1.0

    ratios: dict[tuple[str, ...], float] = {}
    for a, b in combinations(own, 2):
        crossed = [of[b].left_of(of[a].u), of[a].left_of(of[b].u)]
        ratios["effort", a, b] = _ratio([own[a], own[b]], crossed, limit)
        if max(own[a], own[b]) > limit.clear:
            ratios["position", a, b] = put_back(at.exchanged(of[a].index, of[b].index), a, b)
    for a in own if doubted else ():
        ratios["sign", a] = put_back(at.turned(of[a].index), a)
    done: set[str] = set()
    for (what, *names), ratio in sorted(ratios.items(), key=lambda item: item[1]):
        if ratio < limit.closer and not done & set(names):
            done |= set(names)
            signal, code, _ = _WRONG[what]
            yield finding(code, ", ".join(f"{n}.{signal}" for n in names), a=names[0], b=names[-1])


def not_told(machine: Machine, u: Floats, at: Course, sound: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Yield what would go unnamed if it were so: ("effort" or "position", two axes), ("sign", an axis).

    The log is spoiled on ``sound`` axes: twice exchanged is as it was. ``u``: of a whole motion, shape (n, nv).
    """
    limit, of = at.settings, {axis.name: axis for axis in explained(machine, u, at)}
    own = {name: axis.left for name, axis in of.items()}
    tried = [name for name in own if name in sound]
    for a, b in combinations(tried, 2):
        i, j = of[a].index, of[b].index
        other = at.exchanged(i, j)
        crossed = [of[a].left_of(of[b].u), of[b].left_of(of[a].u)]
        if _ratio(crossed, [own[b], own[a]], limit) >= limit.closer:
            swapped = u.copy()
            swapped[:, [i, j]] = u[:, [j, i]]
            if not _is_seen(_left(machine, swapped, at), _left(machine, swapped, other), (a, b), limit):
                yield "effort", a, b
        if not _is_seen(_left(machine, u, other), own, (a, b), limit):
            yield "position", a, b
    for a in tried:
        turned = list(explained(machine, u, at.turned(of[a].index)))
        seen = _is_seen({x.name: x.left for x in turned}, own, (a,), limit)
        if not seen and not any(map(effort.is_reversed, turned)):
            yield "sign", a


def _left(machine: Machine, u: Floats, at: Course) -> dict[str, float]:
    return {axis.name: axis.left for axis in explained(machine, u, at)}


def _is_seen(spoiled: _Shares, own: _Shares, who: Sequence[str], limit: Settings) -> bool:
    """Whether positions that leave ``spoiled`` of the efforts would be named, as those that are leave ``own``."""
    if not set(own) <= set(spoiled):
        return False
    doubted = max(spoiled[n] for n in (who if len(who) > 1 else own)) > limit.clear
    return doubted and _of_positions(spoiled, own, who, limit) < limit.closer


def _of_positions(own: _Shares, now: _Shares, who: Sequence[str], limit: Settings) -> float:
    """Return what is left of all efforts with other positions of ``who`` over what is left as they are."""
    every = float(np.prod([now[n] / own[n] for n in own]))
    if len(who) == 1:
        closer = any(own[n] - now[n] > limit.clear and now[n] < 0.5 * own[n] for n in own)
        return every if closer else 1.0
    return max(every, _ratio([own[n] for n in who], [now[n] for n in who], limit))


def _ratio(own: Sequence[float], other: Sequence[float], limit: Settings) -> float:
    """Return the product of two shares over that of what they are now; 1 where either is not clearly smaller."""
    pairs = zip(own, other, strict=True)
    closer = all(o - x > limit.plain and x < limit.neither * o for o, x in pairs)
    return float(np.prod(other) / np.prod(own)) if closer else 1.0
