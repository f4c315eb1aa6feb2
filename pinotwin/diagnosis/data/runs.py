"""Runs of one command held against each other: a faulty log beside a healthy one is no repeat of it.

Runs that differ by more than the model's own misfit, most of which comes back with the motion, are not pooled: their
difference would be taken for noise. Of a twin, those that lie farther from it are diagnosed; of a machine, those that
agree with most of the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.data.samples import Sample
from pinotwin.diagnosis.rules import RULES
from pinotwin.log import Log
from pinotwin.logs.repeats import labels, shift_between
from pinotwin.signals import rms


@dataclass(frozen=True)
class Apart:
    """Runs of one command that are not those of one machine."""

    odd: tuple[int, ...]  # number of each log that differs from the runs it should repeat
    alike: tuple[int, ...]  # number of each log that these differ from
    # odd log -> axis -> RMS of the difference over what the model leaves
    axes: Mapping[int, Mapping[str, float]]
    sources: tuple[str, ...]  # name of every log

    def kept(self, count: int, *, change: bool) -> tuple[int, ...]:
        """Return the logs that are diagnosed, of so many."""
        out = self.alike if change else self.odd
        return tuple(k for k in range(count) if k not in out)

    @property
    def names(self) -> list[str]:
        """Files that differ."""
        return [self.sources[k] for k in self.odd]

    def words(self, *, change: bool) -> str:
        """Return which files differ from which, where and how far, and which of them are diagnosed."""
        parts = []
        for k in self.odd:
            most = sorted(self.axes[k].items(), key=lambda p: -p[1])[:3]
            where = ", ".join(f"{axis} by {x:.1f} times" for axis, x in most)
            parts.append(f"{self.sources[k]} ({where} the validation error)")
        against = ", ".join(self.sources[k] for k in self.alike)
        differ = "differs" if len(self.odd) == 1 else "differ"
        text = f"{'; '.join(parts)} {differ} from {against}, the same command"
        if change:
            return f"{text}: only {', '.join(self.names)} {'is' if len(self.odd) == 1 else 'are'} diagnosed"
        return f"{text}: left out here; identify a twin from {against} and diagnose {', '.join(self.names)}"


def apart(logs: Sequence[Log], runs: Sequence[Sample], own: Sample | None) -> Apart | None:
    """Return which runs of one command differ from the others, None where they are repeats."""
    known = labels([r.motion for r in runs])
    odd: list[int] = []
    alike: list[int] = []
    axes: dict[int, dict[str, float]] = {}
    for label in dict.fromkeys(known):
        group = [k for k, x in enumerate(known) if x == label]
        if len(group) < 2:
            continue
        off = {(a, b): _off(runs[a], runs[b], own) for a in group for b in group if a < b}
        off |= {(b, a): row for (a, b), row in off.items()}
        least = RULES.runs_change if own is not None else RULES.runs_structure
        # The others are held against the run that is nearest to all of them, or to the twin where they differ.
        if own is None:
            first = min(
                group, key=lambda k: sum(max(off[k, b].values(), default=0.0) for b in group if b != k)
            )
        else:
            joints = {j for row in off.values() for j, x in row.items() if x > least and j in own.joints}
            first = min(
                group, key=lambda k: sum(runs[k].level(j) / max(own.level(j), 1e-300) for j in joints)
            )
        differ = {k: off[k, first] for k in group if k != first}
        far = [k for k, row in differ.items() if max(row.values(), default=0.0) > least]
        if far:
            odd += far
            alike += [k for k in group if k not in far]
            names = runs[first].motion.names
            axes |= {k: {names[j]: x for j, x in differ[k].items() if x > least} for k in far}
    if not odd:
        return None
    sources = tuple(Path(log.source).name or f"log {k + 1}" for k, log in enumerate(logs))
    return Apart(tuple(odd), tuple(alike), axes, sources)


def _off(a: Sample, b: Sample, own: Sample | None) -> dict[int, float]:
    """Return joint -> RMS by which two runs' residuals differ (over sqrt 2), over what the model leaves."""
    late = round(shift_between(a.motion, b.motion) / a.motion.decimation)
    out = {}
    for j in a.joints:
        if j not in b.joints:
            continue
        x, y = _course(a, j), _course(b, j)
        x, y = (x[late:], y) if late >= 0 else (x, y[-late:])
        n = min(len(x), len(y))
        d = x[:n] - y[:n]
        d = d[np.isfinite(d)]
        level = np.sqrt(0.5 * (a.level(j) ** 2 + b.level(j) ** 2))
        if own is not None and j in own.joints:
            level = own.level(j)
        level = max(float(level), RULES.good_model * a.size(j))
        if len(d) > 3 and level > 0.0:
            out[j] = rms(d) / np.sqrt(2.0) / level
    return out


def _course(s: Sample, joint: int) -> Floats:
    """Return the residual of a joint along the thinned log, NaN where its rows are not used."""
    kept = s.rows.kept[s.rows.joints.index(joint)]
    out = np.full(len(kept), np.nan)
    out[kept] = s.residual[joint]
    return out
