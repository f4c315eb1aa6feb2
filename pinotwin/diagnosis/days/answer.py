"""From what was judged to the answer of the contract: gaps, named causes with their numbers, verdict, sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import named
from pinotwin.diagnosis.conclusion.advice import advise
from pinotwin.diagnosis.conclusion.explained import Closed, rival
from pinotwin.diagnosis.conclusion.residuals import gap_table, noise_levels, unjudged_gaps
from pinotwin.diagnosis.conclusion.verdict import said, unjudged, unsure_words
from pinotwin.diagnosis.data.comparison import UNSURE, Comparison, compare
from pinotwin.diagnosis.data.samples import judged_rows, left_of
from pinotwin.diagnosis.days.causes import Place, axis_of, effect_of, plain_row, regions, sizes, unit_of, when
from pinotwin.diagnosis.days.changed import changed
from pinotwin.diagnosis.days.courses import spells
from pinotwin.diagnosis.days.decision import trained
from pinotwin.diagnosis.days.judge import Judged, Named, judge
from pinotwin.diagnosis.days.recording import doubted, entry, proven
from pinotwin.diagnosis.days.reference import SEVERAL, Reference, reference
from pinotwin.diagnosis.days.row import ALL, Question, Row
from pinotwin.diagnosis.days.stretch import Stretch, stretches
from pinotwin.diagnosis.payload import plain_body
from pinotwin.diagnosis.phrases import described, effect_words, follows, recording_words, seen_words
from pinotwin.diagnosis.result import Diagnosis, Found, Gap, Region, Shrink, Traces, shrunk
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.diagnosis.signals.tracking import Tracked, tracked
from pinotwin.dynamics.parameters import BODY_NAMES
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.system.phrases import JUDGED

SHOWN = {"plant": "u", "law": "e", "encoders": "ql"}
"""Equation -> signal in which its residual is stated."""
BEGINS = ("friction_since", "friction_at_start", "zero_since", "")
"""Rows that act for a while, and (without a name) what is open: when is measured by their own columns."""


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows on which gaps are stated: the logs in question, or those of validation.

    Attributes:
        motion: all logs joined. left: measured effort less the twin's, (n, nv). starts: first row of every log.
        stretches: of these logs.
    """

    motion: Motion
    left: Floats
    starts: Sequence[int]
    stretches: Sequence[Stretch]

    @classmethod
    def of(cls, r: Reference, motions: Sequence[Motion]) -> _Rows:
        """Return the rows of some logs."""
        pairs = [left_of(r.twin, m) for m in motions]
        found = [s for k, (m, x) in enumerate(pairs) for s in stretches(r.twin, m, x, k, r.axes, r.top)]
        starts = [0, *accumulate(len(m) for m in motions)]
        return cls(Motion.join([m for m, _ in pairs]), np.concatenate([x for _, x in pairs]), starts, found)

    def course(self, row: Row, axis: str, *, unseen: bool = False) -> Floats:
        """Return what a cause adds to the effort of an axis on every row, shape (n,) [N or N·m]."""
        out = np.zeros(len(self.motion))
        for s, y in zip(self.stretches, row.courses(axis, "plant", unseen=unseen), strict=False):
            at = self.starts[s.log] + s.start + np.arange(len(s.motion))
            out[at] = np.interp(s.motion.t - s.motion.t[0], s.t, y)
        return out


class Answer:
    """The answer to one question."""

    def __init__(self, c: Comparison, r: Reference, judged: Judged, new: _Rows, valid: _Rows | None) -> None:
        self.c, self.r, self.judged, self.new, self.valid = c, r, judged, new, valid
        self.recorded = [x for x in judged.named if x.row.group == "recording"]
        self.named = [x for x in judged.named if x.row.group != "recording"]
        self.closed = {k: self._closed(k) for k in r.axes}
        self.together = {k: reduce(Closed.beside, [x for _, x in y]) for k, y in self.closed.items() if y}
        self.noise, self.kind = noise_levels(c)
        unsure = [axis for axis, why in c.gate.unknown.items() if why is UNSURE]
        self.unjudged = unjudged_gaps(new.motion, new.left, unsure)
        self.gaps = {**gap_table(c, self.together, self.noise), **self.unjudged}

    @cached_property
    def track(self) -> Tracked:
        """The gap of the tracking error, simulated from the command before and after the causes."""
        rows = [(x.row, axis_of(x.row, self.r)) for x in self.named]
        return tracked(self.c, lambda: changed(self.c.twin, rows, self.r.laws) if rows else (None, set()))

    @property
    def gap(self) -> dict[str, dict[str, Gap]]:
        """The gaps of effort, tracking error, and motor against load."""
        out = {axis: dict(row) for axis, row in self.gaps.items()}
        for axis, gap in self.track.gaps.items():
            if axis in out:
                out[axis]["e"] = gap
        for axis, (between, _) in self.between.items():
            out.setdefault(axis, {})["ql"] = between
        return out

    @cached_property
    def possible(self) -> list[Named]:
        """The best cause that is not named, where something unknown has changed or a signal that it acts on is open."""
        opened = {(a, s) for a, row in self.gap.items() for s, g in row.items() if g.is_open(s)}
        acts = [{(axis_of(x.row, self.r), SHOWN.get(e, "")) for e in x.row.by} for x in self.judged.possible]
        pairs = zip(self.judged.possible, acts, strict=True)
        return [x for x, signals in pairs if self.judged.unknown or signals & opened]

    def _closed(self, axis: str) -> list[tuple[Named, Closed]]:
        """Return what each cause closes of the effort of an axis beside those before it.

        The logs in question promise it, and those of validation tell it.
        """
        acting = [x for x in self.named if x.row.courses(axis, "plant")]
        whole, gained = self._gained(acting, axis, self.new)
        promised, on = [float(x.sum() / max(float(whole.sum()), 1e-300)) for x in gained], "fitted logs"
        if self.valid is not None and all(x.row.unseen is not None for x in acting):
            (whole, gained), on = self._gained(acting, axis, self.valid), "validation"
        each = zip(acting, gained, promised, strict=True)
        return [(x, Closed(whole, less, share, on)) for x, less, share in each]

    def _gained(self, acting: Sequence[Named], axis: str, rows: _Rows) -> tuple[Floats, list[Floats]]:
        """Return the squared residual of every second, (k,) [N² or N²·m²], and what each cause takes off of it."""
        j, gained = self.c.machine.names.index(axis), list[Floats]()
        at = judged_rows(rows.motion, j)
        left = rows.left[at, j]
        second = np.floor(rows.motion.t[at]).astype(int) + 100_000 * np.searchsorted(
            rows.starts, np.flatnonzero(at), "right"
        )
        _, block = np.unique(second, return_inverse=True)
        whole = np.asarray(np.bincount(block, left**2), dtype=float)
        for x in acting:
            less = left - rows.course(x.row, axis, unseen=rows is self.valid)[at]
            gained.append(np.asarray(np.bincount(block, left**2 - less**2), dtype=float))
            left = less
        return whole, gained

    def found(self) -> list[Found]:
        """Return the named causes in the form of the contract, largest first; of several equations one."""
        parts, e = dict[tuple[str, str], list[Named]](), dict[str | None, Shrink](self.track.shrinks)
        for x in self.named:
            parts.setdefault((effect_of(x.row.name), axis_of(x.row, self.r)), []).append(x)
        told = [self.told(*each) for each in parts.values()]
        out = [replace(x, shrink={**x.shrink, "e": e[x.axis]}) if x.axis in e else x for x in told]
        return sorted(out, key=lambda x: -max([s.share for s in x.shrink.values()], default=0.0))

    def told(self, *parts: Named) -> Found:
        """Return a cause in the form of the contract; of several parts what they close together."""
        x, row, axis = parts[0], parts[0].row, axis_of(parts[0].row, self.r)
        at = Place(self.r, axis, self.new.stretches)
        shrink, acts = dict[str, Shrink](), dict[str, Shrink]()
        for name, each in self.closed.items():
            mine = [closed for who, closed in each if who in parts]
            together = reduce(Closed.beside, mine) if mine and name in self.gaps else None
            if together and (name == axis or together.share > 0.0):
                acts[name] = together.shrink(self.gaps[name]["u"].rms, name)
        if axis in acts:
            shrink["u"] = acts[axis]
        if row.group == "law" or row.name == "limit":
            shrink["law"] = self._law([y.row for y in parts], axis)
        gap, shares = self.between.get(axis, (None, {}))
        if gap and shares.keys() & set(map(id, parts)):
            share = sum(shares.get(id(y), 0.0) for y in parts)
            shrink["ql"] = shrunk(gap.rms, share, (share, share), share, "fitted logs", None)
        told = [size for y in parts for size in sizes(y.row, at)]
        theta = {s.name.partition(".")[2] or s.name: s.after for s in reversed(told)}
        if row.name == "payload":
            theta = dict(zip(BODY_NAMES, plain_body(row.numbers).tolist(), strict=True))
        shape = {"limit": row.theta} if row.name == "limit" else {}
        if row.form is not None:
            names = [x.name for x in row.form.shapes()]
            shape = dict(zip(names, row.form.shape_values(), strict=True))
        near = [(y, axis_of(y, self.r), p, max([0.0, *y.closed.values()])) for y, p in x.rivals if p > 0.005]
        rivals = [rival(effect_of(y.name), where, p, share, y.score) for y, where, p, share in near]
        return Found(
            effect=effect_of(row.name),
            axis=axis,
            confidence=x.probability,
            shape=shape,
            theta=theta,
            shrink=shrink,
            alternatives=rivals,
            gain=sum(y.row.score for y in parts),
            size=told,
            acts=acts,
            listed=None if row.form is None else named(row.form),
            course=when(row, at),
        )

    def adds(self, x: Named) -> bool:
        """Whether a cause closes more of any effort or twist than the form of another leaves, or some of a law.

        What closes nearly all that those before it leave is no rest of their form.
        """
        efforts = [{id(who): c.share for who, c in each} for each in self.closed.values()]
        acts = [y for y in (*efforts, *(each for _, each in self.between.values())) if id(x) in y]
        before = [id(y) for y in self.named[: self.named.index(x)]]
        left = [max(1.0 - sum(y.get(k, 0.0) for k in before), 1e-300) for y in acts]
        rest = [max(y.values()) * (1.0 - y[id(x)] / z) for y, z in zip(acts, left, strict=True)]
        form = SETTINGS.trace**2
        large = [y[id(x)] > max(self.c.worth, form * z) for y, z in zip(acts, rest, strict=True)]
        return any(large) or not acts or x.row.closed.get("law", 0.0) > self.c.worth

    def _law(self, rows: Sequence[Row], axis: str) -> Shrink:
        """Return how far the residual of the controller's law shrinks: each row closes some of what others leave."""
        before = rms(np.concatenate(self.r.left(self.new.stretches, axis, "law")))
        share = 1.0 - float(np.prod([1.0 - np.clip(x.closed.get("law", 0.0), 0.0, 1.0) for x in rows]))
        return shrunk(before, share, (max(2.0 * share - 1.0, 0.0), 1.0), share, "held-out blocks", None)

    @cached_property
    def between(self) -> dict[str, tuple[Gap, dict[int, float]]]:
        """Return axis -> gap of motor against load, and the share of it that each cause closes."""
        out = {}
        for name in self.r.axes:
            if (name, "encoders") not in self.r.whitenings:
                continue
            left = self.r.left(self.new.stretches, name, "encoders")
            gaps = [s.axes[name]["gap"] for s in self.new.stretches]
            size = rms(np.concatenate([x - x.mean() for x in gaps]))
            usual = rms(np.concatenate(self.r.left(self.r.logs, name, "encoders")))
            now = level = rms(np.concatenate(left))
            shares = dict[int, float]()
            for x in self.named:
                gone = x.row.courses(name, "encoders")
                if not gone:
                    continue
                left = [y - z for y, z in zip(left, gone, strict=True)]
                after = rms(np.concatenate([self.r.centred(name, y) for y in left]))
                shares[id(x)] = float(np.clip((now**2 - after**2) / max(level**2, 1e-300), 0.0, 1.0))
                now = min(now, after)
            after = level * float(np.sqrt(max(1.0 - sum(shares.values()), 0.0)))
            out[name] = Gap(level, level / max(size, 1e-300), 0.0, after, usual), shares
        return out

    def against(self) -> set[int]:
        """Return the logs in which a cause that was named explains less than nothing, if others speak for it."""
        logs = [s.log for s in self.new.stretches]
        gains = [(np.bincount(logs, x.row.logs), x.row.price) for x in self.named]
        return {int(k) for gain, price in gains if gain.max() > price for k in np.flatnonzero(gain < -price)}

    def traces(self) -> list[Traces]:
        """Return arrays for plots: the residual before and after the causes, by axis and log."""
        out = []
        for name in self.r.axes:
            j = self.c.machine.names.index(name)
            after = self.new.left[:, j] - sum((self.new.course(x.row, name) for x in self.named), np.zeros(1))
            at = judged_rows(self.new.motion, j)
            out += self.c.traces(name, self.new.motion.t[at], self.new.left[at, j], after[at])
        return out

    def remains(self) -> dict[str, str]:
        """Return axis -> what is left follows, in words."""
        row = self.judged.described
        shown = {} if row is None else {row.axis: described(row.what)}
        faults = {axis_of(x.row, self.r): f"the recording: {effect_words(x.row.name)}" for x in self.recorded}
        return {**shown, **faults, **self.c.gate.remains}

    def where(self) -> list[Region]:
        """Return where and when each cause acts; without a sure name the possible one, else what is open."""
        rows, out = [x.row for x in self.named or self.possible], list[Region]()
        if not rows and self.judged.unknown:
            axis, equation, row = self._worst()
            rows = [row or Row("", axis, {"encoders": "encoder"}.get(equation, equation), what=equation)]
        for row in rows:
            at = Place(self.r, axis_of(row, self.r), self.new.stretches)
            if row.name in BEGINS or row.what in ("time", "dry time"):
                key = (at.axis, "plant" if row.name else row.what)
                spans = spells(self.r, at.logs, key, row, [x.row for x in self.named if x.row is not row])
                out += regions(replace(row, name="", spans=spans, since=(), place=None), at)
                row = replace(row, since=() if spans else row.since)
            out += regions(row, at)
        return out

    def _worst(self) -> tuple[str, str, Row | None]:
        """Return axis and equation of what no cause explains, and its description where it has one."""
        row, worst = self.judged.described, max(self.judged.open, key=lambda k: self.judged.open[k])
        return (row.axis, "plant", row) if row is not None and worst[1] == "plant" else (*worst, None)

    def recording(self) -> list[dict[str, Any]]:
        """Return the faults of the recording, what `check` proves first: from when to when [s], and how large."""
        out = list(self.judged.proofs)
        for row, p in ((x.row, x.probability) for x in self.recorded):
            at = Place(self.r, axis_of(row, self.r), self.new.stretches)
            one = entry(self.c, row.name, row.axis if row.axis != ALL else None, p)
            for k, a, b in row.spans[:1]:
                one |= {"from": float(at.logs[k].motion.t[0] + a), "to": float(at.logs[k].motion.t[0] + b)}
            if np.isfinite(row.theta):
                one |= {"size": row.theta, "unit": unit_of(row.name, at)[3]}
            out.append(one)
        return out

    def open(self) -> dict[str, dict[str, float]]:
        """Return axis -> signal -> share that stays [1], of what no cause explains though something has changed."""
        out: dict[str, dict[str, float]] = {}
        if self.judged.unknown:
            axis, equation, _ = self._worst()
            e = self.track.gaps.get(axis)
            kept = equation == "law" and e is not None and e.rms <= e.expected  # then its effort is off
            out[axis] = {"u" if kept else SHOWN[equation]: 1.0}
        for x in self.recorded:
            law = x.row.by.get("law", 0.0) > x.row.by.get("plant", 0.0)
            out.setdefault(axis_of(x.row, self.r), {})["e" if law else "u"] = 1.0
        silent = [x for x in self.c.gate.silent if x in self.gaps]
        for name in [*doubted(self.judged.proofs, self.r.axes), *self.unjudged, *silent]:
            out.setdefault(name, {})["u"] = 1.0
        return out

    def sentence(self, effects: Sequence[Found]) -> list[str]:
        """Return what a person reads first."""
        if self.recorded or self.judged.proofs:
            return [JUDGED["recording"].format(faults=recording_words(self.recording()))]
        if effects:
            places = [(x.row, Place(self.r, axis_of(x.row, self.r), self.new.stretches)) for x in self.named]
            courses = [(at.axis, follows(row.name, row.what, when(row, at))) for row, at in places]
            told = [JUDGED["course"].format(axis=axis, words=words) for axis, words in courses if words]
            return [JUDGED["changed"].format(causes="; ".join(map(said, effects))), *dict.fromkeys(told)]
        if self.judged.unknown:
            row = self.judged.described
            words = "" if row is None else f": {row.axis} {described(row.what)}"
            return [JUDGED["unknown"].format(words=words)]
        seen = seen_words(self.judged.detectable)
        return [JUDGED["none"], *([seen] if seen else [])]


def _judged(
    c: Comparison, r: Reference, new: _Rows, valid: _Rows | None, options: Mapping[str, Any]
) -> Judged:
    """Return what has changed; nothing where the rows themselves are in doubt."""

    def admits(row: Row) -> bool:
        axes = r.axes if row.axis == ALL else (row.axis,)
        effect, limit = effect_of(row.name), row.group == "limit"
        told = limit or all(x not in c.gate.nameless and c.gate.admits(effect, x) for x in axes)
        servo = limit or row.group == "law" or row.name.startswith("command_")
        asked = options["closed_loop"] and all(c.gate.asks("servo", x) for x in axes)
        shown = told and effect not in options["leave_out"] and (asked or not servo)
        return row.group == "describe" or shown

    if proofs := proven(c):
        return Judged(proofs=proofs)
    q = replace(Question.of(r, new.stretches, valid.stretches if valid else ()), worth=c.worth)
    return judge(q, trained(), options["false_alarm"], admits, 1 if options["quick"] else 4)


def _answer(c: Comparison, options: Mapping[str, Any]) -> Answer | None:
    """Return the answer; None of a twin that keeps no rows, or knows no law of a controller."""
    r = reference(c.twin, [c.machine.names[j] for j in c.new.joints]) if c.change else None
    if r is None:
        return None
    for key in [(k, "plant") for k in r.axes if k in c.gate.unknown]:
        deaf = replace(r.whitenings[key], sigma=1e6 * r.whitenings[key].sigma)
        r = replace(
            r, whitenings={**r.whitenings, key: deaf}
        )  # what the twin does not foretell tells nothing
    many = len(c.logs)
    new, valid = _Rows.of(r, c.motions[:many]), _Rows.of(r, c.motions[many:]) if c.validation else None
    lawful = bool(r.laws) and all("e" in s.axes[k] for s in new.stretches for k in r.laws)
    if not new.stretches or not (lawful or r.days >= SEVERAL or set(r.twists) == set(r.axes)):
        return None  # without the controller's law, other days or a second encoder a recording and a machine look alike
    if not lawful:  # such logs hold no command: nothing tells of a controller
        plain = {k: w for k, w in r.whitenings.items() if k[1] != "law"}
        r = replace(r, laws={}, law_widths={}, whitenings=plain)
    valid = valid if valid is not None and valid.stretches else None
    a = Answer(c, r, _judged(c, r, new, valid, options), new, valid)
    shown = [x for x in a.named if a.adds(x)]
    if len(shown) < len(a.named):  # what others close, or nothing does, needs no name
        beside = [x for x in a.named if x not in shown]
        told = replace(a.judged, named=[*a.recorded, *shown], possible=[*beside, *a.judged.possible][:1])
        a = Answer(c, r, replace(told, unknown=told.unknown or not shown), new, valid)
    return a


def diagnosed(c: Comparison, more: Sequence[Found], options: Mapping[str, Any]) -> Diagnosis | None:
    """Return what has changed since a twin was identified, with ``more`` of other signals; None where nothing tells."""
    a = _answer(c, options)
    if a is None:
        return None
    odd, differ = a.against(), list[str]()
    if odd:
        names = [Path(x.log.source).name or f"log {k + 1}" for k, x in enumerate(c.logs)]
        kept = [k for k in range(len(names)) if k not in odd]
        logs, unseen = [c.logs[k].log for k in kept], [x.log for x in c.validation]
        left = compare(c.twin, logs, unseen, pooled=True, worth=c.worth)
        c, differ = replace(left, kept=tuple(kept)), [names[k] for k in kept]
        a = _answer(c, options) or a
    return _told(a, more, differ)


def _told(a: Answer, more: Sequence[Found], differ: Sequence[str]) -> Diagnosis:
    """Return an answer in the form of the contract; ``differ``: the logs that are judged alone."""
    c, opened, gap, possible = a.c, a.open(), a.gap, [a.told(x) for x in a.possible]
    effects = [*a.found(), *more]
    refuted = {x.axis for x in a.judged.rows[:1] if x.contradicted}
    first = [*a.sentence(effects), *unsure_words(possible)]
    only = [JUDGED["others"].format(logs=", ".join(differ))] if differ else []
    groups = [[f"{axis_of(x.row, a.r)}.{effect_of(y.name)}" for y in (x.row, *x.alike)] for x in a.named]
    other = set[str]() if a.recording() else {*opened, *refuted}
    missing = {"effect": "position_table"}
    lacked = [missing | {"axis": k, "share": x} for k, (size, x) in a.r.lacked.items() if size > c.worth]
    improve = [JUDGED["lacked"].format(**x) for x in lacked]
    return Diagnosis(
        sentence=". ".join([*first, *only, *unjudged(c, {str(e.axis) for e in effects})]),
        differs=list(differ),
        gap=gap,
        where=a.where(),
        effects=effects,
        possible=possible,
        confusable=[list(x) for x in map(dict.fromkeys, groups) if len(x) > 1],
        unexplained=opened,
        remains=a.remains(),
        noise=a.kind,
        advice=[*advise(c, a.kind, effects, other, {*gap, *c.gate.unknown})[0], *improve],
        missing_since_identification=lacked,
        warnings=c.gate.warnings,
        situation="change",
        shrink={n: {"u": x.shrink(a.gaps[n]["u"].rms, n)} for n, x in a.together.items()},
        traces=a.traces(),
        machine=c.machine.name,
        recording=a.recording(),
        detectable=a.judged.detectable,
        evidence=[plain_row(x, axis_of(x, a.r)) for x in a.judged.rows if x.group != "describe"][:20],
    )
