"""``diagnose``: where a log and its model differ, which effect is missing, how far the residual falls."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinotwin.diagnosis.conclusion.advice import advise, command
from pinotwin.diagnosis.conclusion.provenance import provenance
from pinotwin.diagnosis.conclusion.residuals import gap_table, noise_levels
from pinotwin.diagnosis.conclusion.verdict import judge, with_open_signals
from pinotwin.diagnosis.conclusion.where import localise
from pinotwin.diagnosis.data.comparison import Comparison, compare
from pinotwin.diagnosis.days.account import Account, alike
from pinotwin.diagnosis.days.answer import diagnosed
from pinotwin.diagnosis.days.recording import doubted, proven
from pinotwin.diagnosis.days.structure import lacking
from pinotwin.diagnosis.phrases import recording_words
from pinotwin.diagnosis.result import Diagnosis, Found, Gap, Region
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.diagnosis.signals.encoders import Seen, admitted, second_encoders, with_encoders
from pinotwin.diagnosis.signals.servo import limits
from pinotwin.diagnosis.signals.vibration import Vibrations, look_at_vibration, unused
from pinotwin.effects.known import EffectLike, kind_of, with_given
from pinotwin.errors import DataError, InputError
from pinotwin.logs.files import LogLike, as_logs
from pinotwin.logs.repeats import labels
from pinotwin.machine import Machine
from pinotwin.system.phrases import JUDGED
from pinotwin.system.threads import one_blas_thread
from pinotwin.twin import Twin
from pinotwin.twin.twin import as_subject

Tell = Callable[[str, float], None]
MOST = 5  # Causes of one question that the model's own effects are held against
MOST_TIMES = 12  # Pushes on one axis whose times are listed


@with_given
@one_blas_thread
def diagnose(  # noqa: PLR0913, the public call: every option is a keyword
    subject: Machine | Twin | str | Path,
    log: LogLike | Sequence[LogLike],
    *,
    validate: LogLike | Sequence[LogLike] | None = None,
    quick: bool = False,
    report: Tell | None = None,
    seed: int = 0,
    random_state: int | None = None,
    leave_out: Sequence[str] = (),
    effects: Sequence[EffectLike] = (),
    closed_loop: bool = True,
    false_alarm: float = 0.02,
    worth: float = SETTINGS.share,
) -> Diagnosis:
    """Say where logs and their model differ, which effects cause it, and how far the residual falls.

    Args:
        subject: a machine (what does its model lack?), a twin (what has changed since?), or the folder of one.
        log: servo log(s) or their files; those with the same command are repeats and give the noise.
        validate: log(s) that nothing is fitted to; the shrink is then stated on them.
        quick: one cause at most, and no trials for its confidence.
        report: called with the stage and the share done.
        seed: of everything random.
        random_state: another name of ``seed``.
        leave_out: effects of the catalogue that are not to be considered.
        effects: own effects to consider beside the catalogue: classes, or ``module:Class``.
        closed_loop: also look at the servo.
        false_alarm: share of healthy logs of which something may be said [1], of logs with commands or a twin of three.
        worth: smallest cause worth a word, over the effort of its axis [1].

    Raises:
        LogError: a channel is missing or unusable.
        DataError: the logs hold too little.
    """
    shares = {"false_alarm": false_alarm, "worth": worth}
    tell, seed, subject = report or (lambda *_: None), _seed(seed, random_state, shares), as_subject(subject)
    tell("preparing the logs", 0.02)
    logs, unseen = as_logs(log), [] if validate is None else as_logs(validate, "validate")
    if not logs:
        raise DataError("no log given; give at least one")
    c = compare(subject, logs, unseen, pooled=isinstance(subject, Twin), worth=worth)
    own = shares | ({"effects": [kind_of(e).name for e in effects]} if effects else {})
    options = {"quick": quick, "seed": seed, "leave_out": list(leave_out), "closed_loop": closed_loop, **own}
    sealed = [*(False for _ in c.logs), *(True for _ in c.validation)]
    rng, every = np.random.default_rng([seed, 3]), [*c.logs, *c.validation]
    shaken = look_at_vibration(subject, every, sealed, labels(c.motions), rng)
    found = diagnosed(c, shaken.effects, options)
    if found is None:
        if c.change and len(logs) > 1 and c.new.motion.qr is not None:
            # no law of a controller tells the runs apart
            c = compare(subject, logs, unseen, worth=worth)
        found = _by_structure(c, shaken, tell, options)
    found = with_open_signals(_with_vibration(found, shaken, unused(subject, c.logs)))
    made = provenance(subject, c.logs, c.validation, **options)
    return replace(
        found, subject=subject, quick=quick, provenance=made, prepared=c.among(logs), sealed=c.validation
    )


def _by_structure(c: Comparison, shaken: Vibrations, tell: Tell, options: Mapping[str, Any]) -> Diagnosis:
    """Return the diagnosis by the effects of the catalogue, each held against what the twin's own may take up."""
    leave_out, faults = options["leave_out"], proven(c)
    tell("candidates", 0.15)
    measured = {} if faults else second_encoders(c, np.random.default_rng([options["seed"], 4]))
    most = 0 if faults else 1 if options["quick"] else MOST
    found = lacking(c, leave_out, partial(admitted, measured), most)
    tell("how sure", 0.8)
    account = Account(found)
    noise, kind = noise_levels(c)
    gaps = gap_table(c, account.together, noise)
    named = with_encoders(account.found(gaps), measured, leave_out)
    limited = limits(c, leave_out) if options["closed_loop"] and not faults else []
    every = [*named, *limited, *shaken.effects]
    told = _with_encoders(_concluded(c, account, gaps, kind, every), measured)
    if not faults:
        return told
    sentence = JUDGED["recording"].format(faults=recording_words(faults))  # nothing is said of the machine
    open_ = {k: {"u": 1.0} for k in doubted(faults, told.gap)}
    return replace(told, sentence=sentence, recording=faults, unexplained=open_)


def _with_encoders(d: Diagnosis, measured: Mapping[str, Seen]) -> Diagnosis:
    """Return the diagnosis with the residual between motor and load where both are measured."""
    gap = {axis: dict(row) for axis, row in d.gap.items()}
    for axis, seen in measured.items():
        gone = sum(e.shrink["ql"].share for e in d.effects if e.axis == axis and "ql" in e.shrink)
        after = seen.gap.rms * float(np.sqrt(max(1.0 - gone, 0.0)))  # the named parts alone
        gap.setdefault(axis, {})["ql"] = replace(seen.gap, after=after)
    where = [r for seen in measured.values() for r in seen.where]
    notes = [n for seen in measured.values() for n in seen.notes]
    return replace(d, gap=gap, where=[*d.where, *where], advice=[*d.advice, *notes])


def _with_vibration(d: Diagnosis, v: Vibrations, advice: Sequence[str]) -> Diagnosis:
    """Return the diagnosis with what the measured vibration of passive joints says."""
    gap = {**d.gap, **{joint: {"v": g} for joint, g in v.gaps.items()}}
    shrink = {**d.shrink, **{str(e.axis): e.shrink for e in v.effects}}
    return replace(d, gap=gap, shrink=shrink, where=[*d.where, *v.where], advice=[*d.advice, *advice])


def _concluded(
    c: Comparison,
    account: Account,
    gaps: Mapping[str, Mapping[str, Gap]],
    kind: str,
    every: Sequence[Found],
) -> Diagnosis:
    # by the share of the squared residual that they explain, most first
    ordered = sorted(every, key=lambda e: -next((x.share for x in e.shrink.values()), float("inf")))
    named = [e for e in ordered if e.confidence >= SETTINGS.likely]
    possible = [e for e in ordered if e.confidence < SETTINGS.likely]
    sentence, unexplained, notes = judge(c, account.patterns, gaps, named, possible)
    groups = [g for x in account.causes for g in alike(x.turn)]
    names = [[x.partition(".")[2] for x in g] for g in groups]
    pairs = [(g[0], x) for g in names for x in dict.fromkeys(g[1:]) if x != g[0]]
    axis = next((g[0].partition(".")[0] for g in groups), None)
    opened = {*unexplained, *(r.axis for r in account.pushed())}
    advice, motions = advise(c, kind, named, opened, {*gaps, *c.gate.unknown}, pairs)
    return Diagnosis(
        sentence=sentence,
        gap=gaps,
        where=_where(c, account),
        effects=named,
        confusable=groups,
        unexplained=unexplained,
        remains={**account.patterns, **c.gate.remains},
        noise=kind,
        advice=[*advice, *notes],
        warnings=[*c.gate.warnings, *([] if c.apart is None else [c.apart.words(change=c.change)])],
        differs=[] if c.apart is None else c.apart.names,
        situation="change" if c.change else "structure",
        shrink={x: {"u": y.shrink(gaps[x]["u"].rms, x)} for x, y in account.together.items()},
        traces=account.traces(),
        machine=c.machine.name,
        commands={f"advice_{k}.csv": command(c.machine, c.new.motion, k, axis) for k in motions[:2]},
        possible=possible,
        evidence=account.evidence()[:20],
    )


def _where(c: Comparison, account: Account) -> list[Region]:
    """Return the regions of the axes that something is said of, the times of pushes first."""
    rng = np.random.default_rng(0)
    joints = list(dict.fromkeys(x.one.joint for x in account.causes))
    level = {j: c.new.level(j) / c.floor[j] for j in c.new.joints}
    joints = joints or sorted(level, key=lambda j: -level[j])[:1]
    rest = [r for j in joints for r in localise(c.new, c.new.residual[j], j, rng)]
    return [*account.pushed()[:MOST_TIMES], *sorted(rest, key=lambda r: -(r.share - r.time_share))]


def _seed(seed: int, random_state: int | None, shares: Mapping[str, float]) -> int:
    """Return the one seed that was given; refuse shares that cannot be."""
    for name, x in shares.items():
        if not 0.0 < x < 1.0:
            raise InputError(f"diagnose: {name}={x:g}: give a share between 0 and 1, such as 0.02")
    if random_state is None:
        return seed
    if seed:
        raise InputError("diagnose: seed and random_state are two names of one thing; give one of them")
    return random_state
