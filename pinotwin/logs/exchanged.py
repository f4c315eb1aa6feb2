"""Which two axes have each other's effort, or each other's position; whose position is reversed.

An effort that was logged under another name fits the motion of that other axis. Positions under each other's
names, and one that runs the other way, spoil the efforts of all axes: the whole machine is tried with them put back.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.logs.effort_alone import drives
from pinotwin.logs.explained import Course, Explained, basis_of, explained, left_of
from pinotwin.logs.quality import Finding
from pinotwin.machine import Machine

_CLOSER = 0.2  # what is left of two efforts, the product of both shares, relative to what it is now
_NEITHER = 0.9  # the same of each of them alone: neither may be spoiled for the other's sake
_PLAIN = 0.005  # share of an effort's power below which a better fit is not worth a word
_CLEAR = 0.05  # the same from which it is one, and what must be left of an effort for positions to be doubted
_FINDINGS = {  # what was found -> signal, words, code
    "effort": (
        "u",
        "the effort of {0} fits the motion of {1} and the other way round: exchange their columns "
        "in machine.yaml (or those of their positions)",
        "effort_exchanged",
    ),
    "position": (
        "q",
        "with the positions of {0} and {1} exchanged the efforts of the machine fit: exchange the columns of "
        "position and command in machine.yaml",
        "position_exchanged",
    ),
    "sign": (
        "q",
        "with the position of {0} reversed the efforts of the machine fit: give the columns of its position and "
        "command in machine.yaml a negative factor",
        "position_sign",
    ),
}


def exchanged(machine: Machine, u: Floats, at: Course, axes: Sequence[Explained]) -> Iterator[Finding]:
    """Name pairs of axes whose efforts, or positions, have each other's name, and axes that run the other way.

    Args:
        machine: the machine.
        u: efforts of a whole motion, shape (n, nv).
        at: rows of it.
        axes: those whose efforts are no nonsense by themselves.
    """
    bases = [(b.name, b.rows, basis_of(b.columns)) for b in axes]
    left = {(a.name, name): left_of(a.u[rows], basis) for name, rows, basis in bases for a in axes}
    own = {a.name: left[a.name, a.name] for a in axes}
    place = {name: machine.axes[name].index for name in own}
    ratios: dict[tuple[str, ...], float] = {}
    for a, b in combinations(own, 2):
        ratios["effort", a, b] = _ratio([own[a], own[b]], [left[a, b], left[b, a]])
        if max(own[a], own[b]) > _CLEAR:
            ratios["position", a, b] = _put_back(machine, u, at.exchanged(place[a], place[b]), own, (a, b))
    for a in own if max(own.values(), default=0.0) > _CLEAR else ():
        ratios["sign", a] = _put_back(machine, u, at.turned(place[a]), own, (a,))
    done: set[str] = set()
    for (what, *names), ratio in sorted(ratios.items(), key=lambda item: item[1]):
        if ratio < _CLOSER and not done & set(names):
            done |= set(names)
            signal, text, code = _FINDINGS[what]
            yield Finding("warning", ", ".join(f"{n}.{signal}" for n in names), text.format(*names), code)


def not_told(machine: Machine, u: Floats, at: Course, sound: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Yield what would go unnamed if it were so: ("effort" or "position", two axes), ("sign", an axis).

    The log is spoiled, and what :func:`exchanged` would make of that is asked; as twice exchanged is as it was, the
    log itself may be the spoiled one as well.

    Args:
        machine: the machine.
        u: efforts of a whole motion, shape (n, nv).
        at: rows of it.
        sound: axes of which nothing was found.
    """
    axes = list(explained(machine, u, at))
    bases = {b.name: (b.rows, basis_of(b.columns)) for b in axes}
    own = {a.name: left_of(a.u[a.rows], bases[a.name][1]) for a in axes}
    place = {name: machine.axes[name].index for name in own}
    tried = [name for name in own if name in sound]
    for a, b in combinations(tried, 2):
        i, j = place[a], place[b]
        other = at.exchanged(i, j)
        crossed = [left_of(u[bases[x][0], k], bases[x][1]) for x, k in ((a, j), (b, i))]
        if _ratio(crossed, [own[b], own[a]]) >= _CLOSER:
            order = np.arange(u.shape[1])
            order[[i, j]] = j, i
            if not _is_seen(_left(machine, u[:, order], at), _left(machine, u[:, order], other), (a, b)):
                yield "effort", a, b
        if not _is_seen(_left(machine, u, other), own, (a, b)):
            yield "position", a, b
    for a in tried:
        turned = list(explained(machine, u, at.turned(place[a])))
        if not _is_seen(_shares(turned), own, (a,)) and not any(map(drives, turned)):
            yield "sign", a


def _left(machine: Machine, u: Floats, at: Course) -> dict[str, float]:
    return _shares(explained(machine, u, at))


def _shares(axes: Iterable[Explained]) -> dict[str, float]:
    return {x.name: left_of(x.u[x.rows], basis_of(x.columns)) for x in axes}


def _is_seen(spoiled: Mapping[str, float], own: Mapping[str, float], who: Sequence[str]) -> bool:
    """Whether positions that leave ``spoiled`` of the efforts would be named, as those that are leave ``own``."""
    if not set(own) <= set(spoiled):
        return False
    doubted = max(spoiled[n] for n in (who if len(who) > 1 else own)) > _CLEAR
    return doubted and _of_positions(spoiled, own, who) < _CLOSER


def _put_back(machine: Machine, u: Floats, at: Course, own: Mapping[str, float], who: Sequence[str]) -> float:
    """Return the ratio of what is left of all efforts with other positions of some axes, 1 where it is no better.

    Two that were exchanged must both be closer; where one was reversed it may be another that is.
    """
    now = _left(machine, u, at)
    return _of_positions(own, now, who) if set(own) <= set(now) else 1.0


def _of_positions(own: Mapping[str, float], now: Mapping[str, float], who: Sequence[str]) -> float:
    """Return the ratio of what is left of all efforts with other positions of ``who`` to what is left as they are."""
    every = float(np.prod([now[n] / own[n] for n in own]))
    if len(who) == 1:
        return every if any(own[n] - now[n] > _CLEAR and now[n] < 0.5 * own[n] for n in own) else 1.0
    return max(every, _ratio([own[n] for n in who], [now[n] for n in who]))


def _ratio(own: Sequence[float], other: Sequence[float]) -> float:
    """Return the product of two shares over that of what they are now; 1 where either is not clearly smaller."""
    closer = all(o - x > _PLAIN and x < _NEITHER * o for o, x in zip(own, other, strict=True))
    return float(np.prod(other) / np.prod(own)) if closer else 1.0
