"""Pushes from outside on the ground of a question: half waves and boxes in time, each with its instant and length."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.days.ground import Ground
from pinotwin.diagnosis.days.lack import Lack, judged
from pinotwin.diagnosis.days.places import LONG, Whitened, pulses
from pinotwin.diagnosis.days.whitening import Whitening
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.settings import SETTINGS

LENGTHS = (*LONG, 1.6, 3.2)  # Of pushes [s]; a twin's misfit comes and goes for as long


def pushes_of(g: Ground, j: int, columns: Sequence[Floats]) -> Lack | None:
    """Return pushes on a joint, each of a course (m,), with what they are worth but for the search."""
    if not columns:
        return None
    none = [{j: np.zeros((len(p.left), len(columns)))} for p in g.parts[j][1:]]
    return judged(g, None, g.c.machine.names[j], [{j: np.column_stack(columns)}, *none])


def chance(g: Ground, j: int, columns: Sequence[Floats]) -> float:
    """Return the log probability that pushes of courses (m,) come where friction turns round by chance [nats]."""
    v = np.abs(g.samples[0].motion.v[g.samples[0].samples(j), j])
    slow = v < RULES.trembling * v.max()
    turns = sum(float(np.mean(slow[x != 0.0])) > 0.5 for x in columns)
    return turns * float(np.log(np.mean(slow))) if turns else 0.0


def pushed(g: Ground, j: int) -> list[Floats]:
    """Return the courses of pushes on a joint, (m,) each, of size one."""
    g = g.fine(j) if g.c.change else g
    p, (sigma, apart), left = g.parts[j][0], g.noise[j], g.left(j)
    v = np.abs(g.samples[0].motion.v[g.samples[0].samples(j), j])
    fast = v > 0.01 * v.max()  # at rest dry friction holds any effort up to its level
    whitening = Whitening(np.zeros(0), sigma, apart)
    logs, rows, counts, rest = list[Any](), list[Ints](), list[Floats](), list[Floats]()
    for k in range(int(p.log[-1]) + 1):
        own = np.flatnonzero(p.log == k)
        at = np.round((p.t[own] - p.t[own[0]]) / g.step).astype(np.intp)
        t = np.arange(at[-1] + 1) * g.step
        x, mask = np.zeros((2, len(t)))
        x[at], mask[at] = left[own] / whitening.weight, fast[own] / whitening.weight
        # an even clock, as the search for pushes reads a stretch
        logs.append(SimpleNamespace(t=t, step=g.step, cell=(t / SETTINGS.cell).astype(np.intp)))
        rows.append(at)
        counts.append(mask)
        rest.append(x)
    view = Whitened(logs, g.c.machine.names[j], whitening, counts, rest, g.samples[0].size(j))
    found = pulses(view, [(k,) for k in range(len(logs))], 8, LONG if g.c.change else LENGTHS)
    return [
        np.concatenate(
            [f.get(k, np.zeros(len(x.t)))[at] for k, (x, at) in enumerate(zip(logs, rows, strict=True))]
        )
        for f in found
    ]
