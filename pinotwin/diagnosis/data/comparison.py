"""What is compared with what: the twin, its own logs, the logs in question, the validation logs.

Of a machine, the base is the twin that ``identify`` makes of these logs, and its coefficients stay free beside a
candidate, for it has already taken up what it could of the cause.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pinotwin.analysis.deflection import bent
from pinotwin.arrays import Floats, Mask
from pinotwin.columns import bind
from pinotwin.diagnosis.data.gate import Gate, confirmed, gate, off_command, run_away
from pinotwin.diagnosis.data.noise import residual_noise
from pinotwin.diagnosis.data.runs import Apart, apart
from pinotwin.diagnosis.data.samples import Sample, left_of, sample
from pinotwin.diagnosis.result import Traces
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.effects import Effect
from pinotwin.effects.family import FRICTION
from pinotwin.effects.scene import with_model_effort
from pinotwin.errors import DataError
from pinotwin.identification import identify
from pinotwin.identification.bending import bend_all, find_bending
from pinotwin.identification.misfit import own_residual
from pinotwin.log import Log
from pinotwin.logs.prepared import Prepared
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.signals import joined, rms
from pinotwin.twin import Twin


@dataclass(frozen=True, eq=False)
class Comparison:
    """Everything that a search for causes looks at."""

    twin: Twin  # the base
    change: bool  # whether a twin is compared with later logs; else a machine with its own
    logs: Sequence[Prepared]  # the logs in question
    validation: Sequence[Prepared]  # logs that nothing is fitted to
    new: Sample  # rows of the logs in question
    own: Sample | None  # rows of the twin's own logs, with its cross-validated residual; None of a machine
    unseen: Sample | None  # rows of the validation logs, or None
    # joint -> what a good model of the axis leaves, by which its rows are divided [N or N·m]
    floor: Mapping[int, float]
    gate: Gate = field(default_factory=Gate)  # what the logs can be asked
    # of every log in question and then of every validation log, on the rows that are judged
    motions: Sequence[Motion] = ()
    kept: tuple[int, ...] = ()  # place of every log in question among those that were given
    # runs of one command that are not those of one machine, one side of which was left out
    apart: Apart | None = None
    # joint -> RMS of the noise of what is left, which no cause closes [N or N·m]; empty if no repeats tell it
    noise: Mapping[int, float] = field(default_factory=dict)
    worth: float = SETTINGS.share  # of the effort: the smallest cause worth a word [1]

    @property
    def machine(self) -> Machine:
        """The machine of the twin."""
        return self.twin.machine

    def among(self, given: Sequence[Log]) -> list[Prepared]:
        """Return every log that was given made ready, those that were left out as well."""
        ready = dict(zip(self.kept, self.logs, strict=True))
        left_out = {k: log for k, log in enumerate(given) if k not in ready}
        ready |= {k: Prepared(self.machine, log, self.twin.settings) for k, log in left_out.items()}
        return [ready[k] for k in range(len(given))]

    def only(self, joints: Collection[int]) -> Comparison:
        """Return the comparison of some joints of the logs in question; other rows that have none of them are gone."""
        own, unseen = (
            None if s is None or set(joints).isdisjoint(s.joints) else s.only(joints)
            for s in (self.own, self.unseen)
        )
        return replace(self, new=self.new.only(joints), own=own, unseen=unseen)

    @cached_property
    def rubs(self) -> Mapping[int, Floats]:
        """Joint -> course of every friction that the twin knows of it, on the rows in question [N or N·m], (m, k)."""
        out: dict[int, list[Floats]] = {j: [] for j in self.new.residual}
        for effect, theta in self.twin.pairs:
            if effect.family is FRICTION:
                for j, x in self.new.columns(effect).items():
                    out[j].append(x @ theta)
        return {j: np.array(x).reshape(len(x), len(self.new.residual[j])).T for j, x in out.items()}

    def traces(self, axis: str, t: Floats, before: Floats, after: Floats) -> list[Traces]:
        """Return the residual of an axis before and after its causes, (m,) [N or N·m], log by log, for plots."""
        logs, parts = dict(enumerate(self.kept)), enumerate(joined(t))
        return [Traces(axis, logs.get(k, k), t[rows], before[rows], after[rows]) for k, rows in parts]


def compare(
    subject: Machine | Twin,
    logs: Sequence[Log],
    validation: Sequence[Log],
    *,
    pooled: bool = False,
    worth: float = SETTINGS.share,
) -> Comparison:
    """Return a subject and logs made ready for the search; LogError for channels, DataError where logs hold little.

    ``pooled``: runs that differ are kept together where their command is logged: the judgement tells them apart.
    ``worth``: of the effort, the smallest cause worth a word [1].
    """
    change = isinstance(subject, Twin)
    twin, ready, (motions, sealed) = _ready(subject, logs, validation)
    own = None
    if change and twin.misfit is not None:
        motion = with_model_effort(twin.misfit.motion, twin.effects, twin.theta)
        own = sample(motion, own_residual(twin))
    own_errors = {} if own is None else _errors(twin, own)
    differ, kept = None, tuple(range(len(logs)))
    if len(logs) > 1 and not (pooled and all(m.qr is not None for m in motions)):
        differ = apart(logs, [sample(*left_of(twin, m)) for m in motions], own)
    if differ is not None:
        kept = differ.kept(len(logs), change=change)
        ready, motions = ([ready[0][k] for k in kept], ready[1]), [motions[k] for k in kept]
        if not change:  # the twin is that of the logs which are kept
            twin, ready, (motions, sealed) = _ready(subject, [logs[k] for k in kept], validation)
    lost = list[str]()
    if change:
        motions, sealed, strange, lost = _known(twin, motions, sealed, own, own_errors)
    whole, left = left_of(twin, Motion.join(motions))
    new = sample(whole, left)
    noise = residual_noise(new, left, motions)
    unseen = within(sample(*left_of(twin, Motion.join(sealed))), new, twin) if sealed else None
    sized = [] if own is None else off_command(own.motion, new.motion)
    asked = gate(twin.machine, [x for part in ready for x in part], sized)
    if change:
        asked = replace(asked, doubts=(*asked.doubts, *strange))
    if change and asked.silent:
        m = new.motion
        asked = confirmed(asked, twin.machine, m.u, twin.effort(m), m.use)
    if own is not None:
        asked = run_away(asked, own.motion)
        new, strangers = _met(new, own)
        asked = replace(asked, unknown=strangers)
    judged = [j for j in new.joints if twin.machine.names[j] not in asked.silent] or list(new.joints)
    data = (twin, change, *ready, new, own, unseen, _floor(twin, new, own, own_errors))
    c = Comparison(*data, asked, (*motions, *sealed), kept, differ, noise, worth).only(judged)
    return _without_lost(c, lost) if change else c


UNSURE = (
    "its twin is off, or unsure, by more than its effort varies here; identify it on logs that move it more"
)
"""Why an axis is not judged that its twin does not predict."""


def _without_lost(c: Comparison, lost: Collection[str]) -> Comparison:
    """Return the comparison of joints whose effort the twin knows; if none, of those with two encoders, or all."""
    never = "it moves outside the twin's data; identify it on the whole travel"
    why = {j: never if c.machine.names[j] in lost else UNSURE for j in c.new.joints}
    # An effort that is measured too small moves the axis as ever: what the twin expects counts as well.
    varies = {j: max(c.new.size(j), c.new.foretold(j)) for j in c.new.joints}
    judged = [j for j in c.new.joints if why[j] is UNSURE and c.floor[j] <= varies[j] and foretells(c, j)]
    ql = c.new.motion.ql
    scaled = [j for j in why if why[j] is UNSURE and ql is not None and np.isfinite(ql[:, j]).all()]
    asked = judged or scaled
    if not asked or len(judged) == len(c.new.joints):
        return c
    left = {c.machine.names[j]: word for j, word in why.items() if j not in judged}
    return replace(c.only(asked), gate=replace(c.gate, unknown={**c.gate.unknown, **left}))


def foretells(c: Comparison, joint: int) -> bool:
    """Whether the twin explains anything of an axis' effort in its own logs."""
    if c.own is None or joint not in c.own.joints:
        return True
    return c.own.level(joint) <= RULES.knows * c.own.size(joint)


def _met(new: Sample, own: Sample) -> tuple[Sample, dict[str, str]]:
    """Return new logs with the joints that moved in the twin's, and why not others; DataError where none did."""
    names = new.motion.names
    strange = [names[j] for j in new.joints if j not in own.joints]
    if len(strange) == len(new.joints):
        raise DataError(
            f"{', '.join(strange)}: moved in no log of the twin, so their change is unknown; identify the twin "
            "again on logs that move them"
        )
    why = "it moved in no log of its twin; identify one that knows it"
    return new.only([j for j in new.joints if j in own.joints]), dict.fromkeys(strange, why)


def _ready(
    subject: Machine | Twin, logs: Sequence[Log], validation: Sequence[Log]
) -> tuple[Twin, tuple[list[Prepared], list[Prepared]], tuple[list[Motion], list[Motion]]]:
    """Return the twin to compare with, of a machine that of the logs in question; logs and motions as it makes them.

    Those of validation come second. Passive joints, whose springs only the twin knows, bend in every motion.
    """
    bending = None
    if isinstance(subject, Machine):
        logs = [bind(log, subject.columns) for log in logs]
        bending = find_bending(subject, logs)
        bent_logs = bend_all(bending, logs)
        # Springs by which the logs were bent are not found again.
        measured = all(a is b for a, b in zip(logs, bent_logs, strict=True))
        # No lead where it states none: a lag is a finding.
        axes = {k: replace(a, lead=0.0 if a.lead is None else a.lead) for k, a in subject.axes.items()}
        twin = identify(replace(subject, axes=axes), bent_logs, loop=False, springs=measured)
    else:
        twin = subject

    def motion(one: Prepared) -> Motion:
        if not twin.machine.passive:
            return one.motion
        plain = one.motion if bending is None else twin.motion(bending.bend(one.log))
        return bent(twin, plain, plain)

    asked, unseen = ([Prepared(twin.machine, x, twin.settings) for x in part] for part in (logs, validation))
    return twin, (asked, unseen), ([motion(x) for x in asked], [motion(x) for x in unseen])


LEAST = 0.1  # Of an axis' rows, that must be left
WORTH = 0.01  # Of them, that are worth a word if they are left out


def _known(
    twin: Twin,
    motions: Sequence[Motion],
    sealed: Sequence[Motion],
    own: Sample | None,
    own_errors: Mapping[int, Floats],
) -> tuple[list[Motion], list[Motion], list[str], list[str]]:
    """Return motions without rows at which the twin does not know its effects, what to say, and axes without others."""
    floor = {} if own is None else {j: own.level(j) for j in own.joints}
    parts = [[(m, _foretold(twin, m, floor, own_errors)) for m in part] for part in (motions, sealed)]
    whole = np.sum([m.use.sum(axis=0) for m in motions], axis=0)
    left = np.sum([(m.use & known).sum(axis=0) for m, known in parts[0]], axis=0)
    cut, gone = (LEAST * whole <= left) & (left < whole), (whole - left) / np.maximum(whole, 1)
    at = {name: axis.index for name, axis in twin.machine.axes.items()}
    words = [
        f"{name} moves outside the twin's data: {gone[j]:.0%} of its rows, at "
        "which the twin is a guess, are not judged; identify it on logs that go there"
        for name, j in at.items()
        if cut[j] and gone[j] >= WORTH
    ]
    lost = [name for name, j in at.items() if left[j] < LEAST * whole[j]]
    asked, judged = ([replace(m, use=m.use & (known | ~cut)) for m, known in part] for part in parts)
    return asked, judged, words, lost


def _foretold(twin: Twin, motion: Motion, floor: Mapping[int, float], own: Mapping[int, Floats]) -> Mask:
    """Return where a twin tells an effort well enough to judge it, as surely as in its own logs or misfit, (n, nv)."""
    out = np.ones(motion.q.shape, dtype=bool)
    error = twin.effort_error(motion) if floor else np.zeros(motion.q.shape)
    for j, least in floor.items():
        most = RULES.guessed * np.max(own[j], initial=0.0)
        out[:, j] = error[:, j] <= max(most, RULES.guessed_size * least)
    for effect in (e for e in twin.effects if e.local and e.axis in twin.machine.axes):
        j = twin.machine.axes[str(effect.axis)].index
        # all knots of a table share an error, as of gravity, that is no place's own
        shared = np.hypot(floor[j], np.median(own[j])) if j in floor else np.inf
        out[:, j] &= error[:, j] <= shared
        if twin.misfit is not None and not getattr(effect, "endless", False):
            out[:, j] &= _visited(motion.q[:, j], twin.misfit.motion.q[:, j])
    return out


def _visited(q: Floats, seen: Floats) -> Mask:
    """Return which positions (n,) lie on the travel of others, by a hundredth of it."""
    margin = 0.01 * float(np.ptp(seen))
    return np.asarray((q >= seen.min() - margin) & (q <= seen.max() + margin))


def _floor(twin: Twin, new: Sample, own: Sample | None, own_errors: Mapping[int, Floats]) -> dict[int, float]:
    """Return the size by which the rows of each joint are divided."""
    out = {}
    here = {} if own is None else _errors(twin, new)
    for j in new.joints:
        least = RULES.good_model * max(new.size(j), 1e-12)
        if own is not None and j in own.joints:
            more = RULES.unsure * np.sqrt(max(rms(here[j]) ** 2 - rms(own_errors[j]) ** 2, 0.0))
            least = max(float(np.hypot(own.level(j), more)), 0.1 * least)
        out[j] = least
    return out


def _errors(twin: Twin, s: Sample) -> dict[int, Floats]:
    """Return joint -> standard error of the twin's effort on the rows of a sample [N or N·m], each of shape (m,)."""
    error = twin.effort_error(s.motion)
    return {j: error[s.samples(j), j] for j in s.joints}


def thinned_model(samples: Sequence[Sample], effects: Sequence[Effect]) -> list[dict[int, Floats]]:
    """Return, for each sample, joint -> all columns of some effects side by side, shape (m, b)."""
    out = []
    for s in samples:
        found = [(len(e.coefficients()), s.columns(e)) for e in effects]
        rows = {j: len(s.residual[j]) for j in s.joints}
        parts = {j: [x.get(j, np.zeros((n, p))) for p, x in found] for j, n in rows.items()}
        out.append({j: np.hstack([np.zeros((n, 0)), *parts[j]]) for j, n in rows.items()})
    return out


def within(unseen: Sample, new: Sample, twin: Twin | None = None) -> Sample:
    """Return validation rows at positions that the logs in question visit too, or all of a joint that has none.

    What depends on the place along the travel is known only there, where the twin is as sure as of those logs.
    """
    kept, inside = [], {}
    errors, own = ({}, {}) if twin is None else (_errors(twin, unseen), _errors(twin, new))
    for j, mask in zip(unseen.rows.joints, unseen.rows.kept, strict=True):
        inside[j] = np.ones(len(unseen.residual[j]), dtype=bool)
        if j in new.joints:
            seen, q = (s.motion.q[s.samples(j), j] for s in (new, unseen))
            shared = _visited(q, seen)
            if j in own:
                shared &= errors[j] <= np.hypot(new.level(j), np.median(own[j]))
            inside[j] = shared if shared.any() else inside[j]
        kept.append(mask.copy())
        kept[-1][mask] = inside[j]
    residual, effort = (
        {j: x[inside[j]] for j, x in each.items()} for each in (unseen.residual, unseen.effort)
    )
    return replace(unseen, rows=replace(unseen.rows, kept=tuple(kept)), residual=residual, effort=effort)


def by_days(c: Comparison, joint: int) -> float:
    """Return the share of an axis' friction by which logs of one machine may differ [1]: at least the usual one."""
    days = c.twin.quality.get("days", {}) if c.change else {}
    return max([RULES.scatter, *days.get(c.machine.names[joint], {}).values()])


def scatter(c: Comparison, joint: int, usual: float) -> float:
    """Return the RMS by which friction differs from the twin's [N or N·m], as on a healthy day, in every stretch.

    ``usual``: RMS over days, of it [1]. Of what is off by more than some of these (RULES.unsure), less and less.
    """
    left, rows, rubs = c.new.residual[joint], c.new.samples(joint), c.rubs[joint]
    power = 0.0
    for part in c.new.motion.segments:
        here = (rows >= part.start) & (rows < part.stop)
        if rubs[here].any():
            more = rms(rubs[here] @ np.linalg.lstsq(rubs[here], left[here], rcond=None)[0])
            size = usual * rms(rubs[here].sum(axis=1))
            most = max((RULES.unsure * size) ** 2 / max(more, 1e-300), size)
            power += here.sum() * min(more, most) ** 2
    return float(np.sqrt(power / max(len(left), 1)))
