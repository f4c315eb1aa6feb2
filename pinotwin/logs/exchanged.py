"""Which two axes have each other's effort, or each other's position; whose position is reversed.

An effort that was logged under another name fits the motion of that other axis. Positions under each other's
names, and one that runs the other way, spoil the efforts of all axes: the whole machine is tried with them put back.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.logs.explained import Course, Explained, basis_of, explained, left_of
from pinotwin.logs.quality import Finding
from pinotwin.machine import Machine

_CLOSER = 0.2  # what is left of two efforts, the product of both shares, relative to what it is now
_NEITHER = 0.9  # the same of each of them alone: neither may be spoiled for the other's sake
_PLAIN = 0.005  # share of an effort's power below which a better fit is not worth a word
_CLEAR = 0.05  # the same from which it is one
_POOR = 0.2  # share of an effort's power left from which positions are doubted
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
        if max(own[a], own[b]) > _POOR:
            ratios["position", a, b] = _put_back(machine, u, at.exchanged(place[a], place[b]), own, (a, b))
    for a in own if max(own.values(), default=0.0) > _POOR else ():
        ratios["sign", a] = _put_back(machine, u, at.turned(place[a]), own, (a,))
    done: set[str] = set()
    for (what, *names), ratio in sorted(ratios.items(), key=lambda item: item[1]):
        if ratio < _CLOSER and not done & set(names):
            done |= set(names)
            signal, text, code = _FINDINGS[what]
            yield Finding("warning", ", ".join(f"{n}.{signal}" for n in names), text.format(*names), code)


def _put_back(machine: Machine, u: Floats, at: Course, own: Mapping[str, float], who: Sequence[str]) -> float:
    """Return the ratio of what is left of all efforts with other positions of some axes, 1 where it is no better.

    Two that were exchanged must both be closer; where one was reversed it may be another that is.
    """
    now = {x.name: left_of(x.u[x.rows], basis_of(x.columns)) for x in explained(machine, u, at)}
    if not set(own) <= set(now):
        return 1.0
    every = float(np.prod([now[n] / own[n] for n in own]))
    if len(who) == 1:
        return every if any(own[n] - now[n] > _CLEAR and now[n] < 0.5 * own[n] for n in own) else 1.0
    return max(every, _ratio([own[n] for n in who], [now[n] for n in who]))


def _ratio(own: Sequence[float], other: Sequence[float]) -> float:
    """Return the product of two shares over that of what they are now; 1 where either is not clearly smaller."""
    closer = all(o - x > _PLAIN and x < _NEITHER * o for o, x in zip(own, other, strict=True))
    return float(np.prod(other) / np.prod(own)) if closer else 1.0
