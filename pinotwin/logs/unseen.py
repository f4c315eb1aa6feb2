"""What `check` would not see on this motion if it were so: its own limits, said of the log at hand.

Each axis of which nothing was found is spoiled once more, and the same tests are asked. What they do not name they
could not have named in the log itself either: two axes that move alike, an effort that is nearly all friction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.logs.effort_alone import Examined, at_best, is_reversed, is_unsigned, late, scaled
from pinotwin.logs.exchanged import not_told
from pinotwin.logs.explained import Course, Explained, basis_of, explained
from pinotwin.logs.quality import Finding
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.system.threads import one_blas_thread

_LAG = 0.02  # [s]
_UNIT = 9.0  # times
_ROWS = 1000  # on which it is tried
_WORDS = {
    "effort": "exchanged efforts of {0}",
    "position": "exchanged positions of {0}",
    "sign": "a position that runs the other way of {0}",
}


@one_blas_thread
def unseen(machine: Machine, motion: Motion, efforts: Examined) -> list[Finding]:
    """Say in one line what would go unnamed on this motion.

    Args:
        machine: the machine.
        motion: the log, prepared.
        efforts: what was found of its efforts.
    """
    at, sound = _thinned(efforts.at), [axis.name for axis in efforts.sound]
    of: dict[str, list[str]] = {}
    for axis in explained(machine, motion.u, at):
        for what in _of_effort(axis, efforts.reach, motion.step) if axis.name in sound else ():
            of.setdefault(what, []).append(axis.name)
    for what, *who in not_told(machine, motion.u, at, sound):
        of.setdefault(_WORDS[what], []).append(" and ".join(who))
    if not of:
        return []
    said = "; ".join(words.format(", ".join(who)) for words, who in of.items())
    text = f"this motion could not reveal {said}. To check, move these axes faster and alone"
    return [Finding("info", "", text, "not_told")]


def _of_effort(axis: Explained, reach: int, step: float) -> Iterator[str]:
    """Yield what would go unnamed of one effort."""
    basis = basis_of(axis.columns)

    def spoiled(u: Floats) -> Explained:
        return replace(axis, u=u)

    behind = spoiled(np.roll(axis.u, round(_LAG / step)))
    if not list(late([behind], {axis.name: at_best(behind, basis, reach)}, step)):
        yield "an effort of {0} that is 20 ms late"
    fit = at_best(axis, basis, reach)
    if not all(list(scaled(spoiled(f * axis.u), fit)) for f in (_UNIT, 1.0 / _UNIT)):
        yield "a wrong effort unit on {0}"
    if not is_reversed(spoiled(-axis.u), fit):
        yield "a wrong effort sign on {0}"
    low, high = np.percentile(axis.u[axis.rows], (0.5, 99.5))
    hangs = low > 0.1 * high or high < 0.1 * low
    if not hangs and not is_unsigned(spoiled(np.abs(axis.u)), basis, np.abs(axis.u)):
        yield "a missing effort sign on {0}"


def _thinned(at: Course) -> Course:
    few = slice(None, None, max(1, len(at.rows) // _ROWS))
    return Course(at.rows[few], at.use[few], at.q[few], at.v[few], at.a[few])
