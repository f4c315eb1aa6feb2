"""What `check` would not see on this motion if it were so: its own limits, said of the log at hand.

Each axis of which nothing was found is spoiled once more, and the same tests are asked. What they do not name they
could not have named in the log itself either: two axes that move alike, an effort that is nearly all friction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pinotwin.logs.effort_alone import Examined, is_reversed, is_unsigned, late, scaled
from pinotwin.logs.exchanged import not_told
from pinotwin.logs.explained import Explained, explained
from pinotwin.logs.quality import Finding
from pinotwin.logs.quality.phrases import finding
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.system.threads import one_blas_thread

_WORDS = {
    "effort": "exchanged efforts of {0}",
    "position": "exchanged positions of {0}",
    "sign": "a position that runs the other way of {0}",
}


@one_blas_thread
def unseen(machine: Machine, motion: Motion, efforts: Examined) -> list[Finding]:
    """Say in one line what would go unnamed on this motion, tried on a thousand of its rows.

    Args:
        machine: the machine.
        motion: the log, prepared.
        efforts: what was found of its efforts.
    """
    at, sound = efforts.at.thinned(1000), [axis.name for axis in efforts.sound]
    of: dict[str, list[str]] = {}
    for axis in explained(machine, motion.u, at):
        for what in _of_effort(axis, motion.step) if axis.name in sound else ():
            of.setdefault(what, []).append(axis.name)
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
