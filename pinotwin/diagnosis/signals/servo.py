"""Drives at their limit where no healthy day tells the law: that of the logs themselves stands for it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.data.samples import left_of
from pinotwin.diagnosis.days.causes import Place, sizes
from pinotwin.diagnosis.days.decision import trained
from pinotwin.diagnosis.days.evidence import cells
from pinotwin.diagnosis.days.judge import case_of
from pinotwin.diagnosis.days.law import Law
from pinotwin.diagnosis.days.limit import Drive, limit_row
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.rows import NONE
from pinotwin.diagnosis.days.score import opened, score
from pinotwin.diagnosis.days.stretch import Stretch, stretches
from pinotwin.diagnosis.days.whitening import Whitening
from pinotwin.diagnosis.result import Found
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.signals import rms, roughness

LEVELS = 2
"""How many of the commonest efforts are tried as one at which the law says nothing of its noise."""


def limits(c: Comparison, leave_out: Collection[str] = ()) -> list[Found]:
    """Return the drives at their limit by the logs in question alone."""
    if c.new.motion.qr is None or "saturation" in leave_out:
        return []
    axes = [k for k in c.machine.names if k in c.machine.axes and c.gate.asks("servo", k)]
    every = [left_of(c.twin, m) for m in c.motions[: len(c.logs)]]
    logs = [s for k, (m, left) in enumerate(every) for s in stretches(c.twin, m, left, k, axes, {})]
    lawful = [k for k in axes if logs and all("e" in s.axes[k] for s in logs)]
    return [x for k in lawful if (x := _limit(c, logs, k)) is not None]


def _limit(c: Comparison, logs: Sequence[Stretch], name: str) -> Found | None:
    """Return the limit of one drive, with the probability of the decision; None where it has none."""
    columns = [s.axes[name] for s in logs]
    law = Law.fitted(columns, signed=True)
    if not law.stable:
        return None
    left = [y - np.median(y) for y in (x["u"] - law.effort(x) for x in columns)]
    effort = rms(np.concatenate([x["u"] for x in columns]))
    widths = {**SETTINGS.widths, "inertia": 0.0, "snap": 0.0, "effort": effort}
    r = Reference(c.twin, (name,), {}, tuple(logs), {name: law}, {}, days=1)
    r = replace(r, widths={name: widths}, law_widths={name: {}})
    cases = []
    for each in _drives(logs, name, left):
        r = replace(r, whitenings={(name, "law"): each[0].w})
        before = cells(r, logs, [{(name, "law"): d.left} for d in each], name)
        row = limit_row(each, before, r)
        if row is not None:
            open_ = {f"{name} law": opened(before["law"], score([(before["law"], NONE)], 0).left[0])}
            cases.append(case_of(r, [row], open_))
    case = max((x for x in cases if x.causes), key=lambda x: x.causes[0].score, default=None)
    if case is None:
        return None
    row = case.causes[0]
    if c.own is not None:
        u = c.own.motion.u[:, c.machine.names.index(name)]
        if float(np.nanmax(np.abs(u))) < row.theta + 4.0 * roughness([u[np.isfinite(u)]]):
            return None  # the twin's own logs went no further either
    shape, sure = {"limit": row.theta}, float(trained().probabilities(case)[-1])
    size = sizes(row, Place(r, name, logs))
    return Found("saturation", name, sure, shape, shape, {}, [], size=size, gain=row.score)


def _drives(logs: Sequence[Stretch], name: str, left: Sequence[Floats]) -> Iterator[list[Drive]]:
    """Yield an axis in all logs by the noise of its law below one of its commonest efforts."""
    j = logs[0].motion.names.index(name)
    noise = roughness([np.nan_to_num(s.motion.u[:, j]) for s in logs])
    size = np.abs(np.concatenate([np.nan_to_num(s.motion.u[s.rows, j]) for s in logs]))
    wide = max(4.0 * noise, 1e-3 * float(size.max()))
    edges = np.arange(float(size.max()), 0.3 * float(size.max()), -wide)
    for level in edges[np.argsort([-np.sum(np.abs(size - x) < wide) for x in edges])[:LEVELS]]:
        below = [(np.abs(s.axes[name]["u"]) < level - wide).astype(float) for s in logs]
        w = Whitening.measured(left, below)
        for level_noise in (noise, float(np.hypot(noise, w.sigma))):
            yield [Drive(s, name, x, w, level_noise, feedback=False) for s, x in zip(logs, left, strict=True)]
