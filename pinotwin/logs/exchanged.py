"""Which two axes have each other's effort, or each other's position; whose position is reversed.

Exchanged efforts fit the motion of the other axis; wrong positions spoil all efforts: the machine is tried anew.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.logs.effort_alone import drives
from pinotwin.logs.explained import Course, Explained, explained
from pinotwin.logs.quality.results import Finding, finding
from pinotwin.logs.settings import Settings
from pinotwin.machine import Machine

_CODES = {  # what was found -> signal, code
    "effort": ("u", "effort_exchanged"),
    "position": ("q", "position_exchanged"),
    "sign": ("q", "position_sign"),
}


def exchanged(machine: Machine, u: Floats, at: Course, axes: Sequence[Explained]) -> Iterator[Finding]:
    """Name axes with each other's effort (``u``, (n, nv)) or position, or the other way round; ``axes`` are sound."""
    limit, of = at.settings, {axis.name: axis for axis in axes}
    own = {name: axis.left for name, axis in of.items()}
    place = {name: machine.axes[name].index for name in own}
    doubted = max(own.values(), default=0.0) > limit.clear

    def put_back(other: Course, *who: str) -> float:
        now = _left(machine, u, other)
        return _of_positions(own, now, who, limit) if set(own) <= set(now) else 1.0

    ratios: dict[tuple[str, ...], float] = {}
    for a, b in combinations(own, 2):
        crossed = [of[b].left_of(of[a].u), of[a].left_of(of[b].u)]
        ratios["effort", a, b] = _ratio([own[a], own[b]], crossed, limit)
        if max(own[a], own[b]) > limit.clear:
            ratios["position", a, b] = put_back(at.exchanged(place[a], place[b]), a, b)
    for a in own if doubted else ():
        ratios["sign", a] = put_back(at.turned(place[a]), a)
    done: set[str] = set()
    for (what, *names), ratio in sorted(ratios.items(), key=lambda item: item[1]):
        if ratio < limit.closer and not done & set(names):
            done |= set(names)
            signal, code = _CODES[what]
            yield finding(code, ", ".join(f"{n}.{signal}" for n in names), a=names[0], b=names[-1])


def not_told(machine: Machine, u: Floats, at: Course, sound: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Yield what would go unnamed if it were so: ("effort" or "position", two axes), ("sign", an axis).

    The log is spoiled on ``sound`` axes: twice exchanged is as it was. ``u``: of a whole motion, shape (n, nv).
    """
    limit, of = at.settings, {axis.name: axis for axis in explained(machine, u, at)}
    own = {name: axis.left for name, axis in of.items()}
    place = {name: machine.axes[name].index for name in own}

    tried = [name for name in own if name in sound]
    for a, b in combinations(tried, 2):
        other = at.exchanged(place[a], place[b])
        crossed = [of[a].left_of(of[b].u), of[b].left_of(of[a].u)]
        if _ratio(crossed, [own[b], own[a]], limit) >= limit.closer:
            swapped = u.copy()
            swapped[:, [place[a], place[b]]] = u[:, [place[b], place[a]]]
            if not _is_seen(_left(machine, swapped, at), _left(machine, swapped, other), (a, b), limit):
                yield "effort", a, b
        if not _is_seen(_left(machine, u, other), own, (a, b), limit):
            yield "position", a, b
    for a in tried:
        turned = list(explained(machine, u, at.turned(place[a])))
        if not _is_seen({x.name: x.left for x in turned}, own, (a,), limit) and not any(map(drives, turned)):
            yield "sign", a


def _left(machine: Machine, u: Floats, at: Course) -> dict[str, float]:
    return {axis.name: axis.left for axis in explained(machine, u, at)}


def _is_seen(
    spoiled: Mapping[str, float], own: Mapping[str, float], who: Sequence[str], limit: Settings
) -> bool:
    """Whether positions that leave ``spoiled`` of the efforts would be named, as those that are leave ``own``."""
    if not set(own) <= set(spoiled):
        return False
    doubted = max(spoiled[n] for n in (who if len(who) > 1 else own)) > limit.clear
    return doubted and _of_positions(spoiled, own, who, limit) < limit.closer


def _of_positions(
    own: Mapping[str, float], now: Mapping[str, float], who: Sequence[str], limit: Settings
) -> float:
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
