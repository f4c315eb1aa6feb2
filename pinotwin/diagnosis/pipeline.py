"""``diagnose``: where a log and its model differ, which effect is missing, how far the residual falls."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pinotwin.diagnosis.candidates.catalogue import candidates
from pinotwin.diagnosis.candidates.catalogue import named as named_of
from pinotwin.diagnosis.candidates.episodes import Episodes
from pinotwin.diagnosis.candidates.patterns import Pattern, patterns
from pinotwin.diagnosis.conclusion.advice import advise, command, of_one_run, of_other_state, resting
from pinotwin.diagnosis.conclusion.explained import Account, at_one_gap, stated_of
from pinotwin.diagnosis.conclusion.findings import effects_named, pushes_named
from pinotwin.diagnosis.conclusion.open_signals import with_open_signals
from pinotwin.diagnosis.conclusion.provenance import provenance
from pinotwin.diagnosis.conclusion.residuals import gap_table, noise_levels, traces
from pinotwin.diagnosis.conclusion.verdict import judge
from pinotwin.diagnosis.conclusion.where import localise
from pinotwin.diagnosis.data.comparison import Comparison, compare, without_pushes
from pinotwin.diagnosis.days.answer import diagnosed
from pinotwin.diagnosis.evidence.bodies import undetermined
from pinotwin.diagnosis.result import Diagnosis, Found, Gap, Region
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.diagnosis.search.forward import Found as Search
from pinotwin.diagnosis.search.forward import search
from pinotwin.diagnosis.search.injections import confidences, pairs_alike
from pinotwin.diagnosis.search.pushes import only_sure, push_confidence, pushes
from pinotwin.diagnosis.search.scan import Searcher
from pinotwin.diagnosis.signals.encoders import Seen, admitted, second_encoders, with_encoders
from pinotwin.diagnosis.signals.servo import limits
from pinotwin.diagnosis.signals.vibration import Vibrations, look_at_vibration, unused
from pinotwin.effects import Effect
from pinotwin.effects.known import EffectLike, kind_of, with_given
from pinotwin.errors import DataError, InputError
from pinotwin.logs.files.given import LogLike, as_logs
from pinotwin.logs.repeats import labels
from pinotwin.machine import Machine
from pinotwin.system.threads import one_blas_thread
from pinotwin.twin import Twin
from pinotwin.twin.twin import as_subject

Tell = Callable[[str, float], None]
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
    rules: Rules = RULES,
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
        rules: thresholds.

    Raises:
        LogError: a channel is missing or unusable.
        DataError: the logs hold too little.
    """
    tell, seed, subject = report or (lambda *_: None), _seed(seed, random_state), as_subject(subject)
    tell("preparing the logs", 0.02)
    logs, unseen = as_logs(log), [] if validate is None else as_logs(validate, "validate")
    if not logs:
        raise DataError("no log given; give at least one")
    c = compare(subject, logs, unseen, pooled=isinstance(subject, Twin))
    own = {"effects": [kind_of(e).name for e in effects]} if effects else {}
    options = {"quick": quick, "seed": seed, "leave_out": list(leave_out), "closed_loop": closed_loop, **own}
    shaken = _shaken(subject, c, np.random.default_rng([seed, 3]))
    more = at_one_gap(shaken.effects, {x: {"v": g} for x, g in shaken.gaps.items()})
    found = diagnosed(c, more, {**options, "false_alarm": false_alarm})
    if found is None:
        if c.change and len(logs) > 1 and c.new.motion.qr is not None:
            c = compare(subject, logs, unseen)  # no law of a controller tells the runs apart
        found = _by_search(c, subject, leave_out, rules, tell, options)
    else:
        found = with_open_signals(_with_vibration(found, shaken, unused(subject, c.logs)))
    return replace(found, prepared=c.among(logs), sealed=c.validation)


def _by_search(
    c: Comparison,
    subject: Machine | Twin,
    leave_out: Sequence[str],
    rules: Rules,
    tell: Tell,
    options: Mapping[str, Any],
) -> Diagnosis:
    """Return the diagnosis by a search forward through the catalogue, its confidence by trials."""
    seed, quick = int(options["seed"]), bool(options["quick"])
    tell("candidates", 0.15)
    measured = second_encoders(c, np.random.default_rng([seed, 4]))
    shown = [e for e in tried(c, leave_out) if admitted(measured, named_of(e).name, e.axis)]
    s = _searched(c, shown, leave_out, rules, tell, quick=quick)
    tell("how sure", 0.8)
    s, sure = _confirmed(s, shown, seed, rules, quick=quick)
    rng = np.random.default_rng([seed, 5])
    pushes = [push_confidence(c, s.whole, p, rng, rules) for p in s.pushed]
    account = Account(s.whole.first, s.found, sure, list(zip(s.pushed, pushes, strict=True)), rules)
    noise, kind = noise_levels(s.rest, rules)
    gaps = gap_table(s.rest, account.together, noise)
    levels = {j: gaps[s.rest.machine.names[j]]["u"].rms for j in s.rest.new.joints}
    named = [*effects_named(account, levels), *pushes_named(account, levels)]
    named = with_encoders(named, measured, leave_out)
    limited = limits(s.rest, leave_out) if options["closed_loop"] else []
    shaken = _shaken(subject, s.rest, np.random.default_rng([seed, 3]))
    others = {axis: {"ql": seen.gap} for axis, seen in measured.items()}
    others |= {x: {"v": g} for x, g in shaken.gaps.items()}
    named = at_one_gap([*named, *limited, *shaken.effects], others)
    result = _concluded(subject, account, gaps, kind, named, seed, quick)
    result = _with_encoders(result, measured)
    result = with_open_signals(_with_vibration(result, shaken, unused(subject, s.rest.logs)))
    made = provenance(subject, s.rest.logs, s.rest.validation, **options)
    return replace(result, provenance=made)


def _shaken(subject: Machine | Twin, c: Comparison, rng: np.random.Generator) -> Vibrations:
    """Return what the logs say of the vibration of passive joints."""
    sealed = [*(False for _ in c.logs), *(True for _ in c.validation)]
    return look_at_vibration(subject, [*c.logs, *c.validation], sealed, labels(c.motions), rng)


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
    shrink = {**d.shrink, **{x: {"v": stated_of(v.gaps[x].rms, s)} for x, s in v.shrinks.items()}}
    return replace(d, gap=gap, shrink=shrink, where=[*d.where, *v.where], advice=[*d.advice, *advice])


@dataclass(frozen=True, eq=False)
class _Searched:
    """What was found."""

    whole: Search  # the search on all rows
    found: Search  # that beside the pushes
    pushed: Sequence[Episodes]  # pushes from outside
    compared: Comparison  # what the first search compared
    rest: Comparison  # what the second did
    asks_pushes: bool  # whether pushes are looked for


def _searched(
    c: Comparison, every: Sequence[Effect], leave_out: Sequence[str], rules: Rules, tell: Tell, *, quick: bool
) -> _Searched:
    """Return the causes that come with the motion and the pushes from outside."""
    most = 1 if quick else None
    found = search(c, every, rules=rules, most=most, tell=lambda s, x: tell(s, 0.2 + 0.5 * x))
    asks = "external_force" not in leave_out
    s = _Searched(found, found, (), c, c, asks)
    return _beside_pushes(s, found, every, rules, quick=quick) if asks else s


def _beside_pushes(
    s: _Searched, whole: Search, every: Sequence[Effect], rules: Rules, *, quick: bool
) -> _Searched:
    """Return what was found with the pushes that a search on all rows leaves, and the causes beside them."""
    c = s.compared
    pushed = pushes(c, whole, rules)
    if not pushed:
        return s
    rest = without_pushes(c, {p.joint: p.rows for p in pushed})
    beside = search(rest, every, rules=rules, most=1 if quick else None)
    return replace(s, whole=whole, found=beside, pushed=pushed, rest=rest)


def _confirmed(
    s: _Searched, every: Sequence[Effect], seed: int, rules: Rules, *, quick: bool
) -> tuple[_Searched, list[float]]:
    """Return how sure each cause is, and what was found; a cause that trials do not confirm hides no push."""
    sure = _sure(s, seed, rules, quick=quick)
    if not s.asks_pushes or s.pushed or min(sure, default=1.0) >= rules.named:
        return s, sure
    again = _beside_pushes(s, only_sure(s.compared, s.found, sure, rules), every, rules, quick=quick)
    return again, _sure(again, seed, rules, quick=quick) if again.pushed else sure


def _sure(s: _Searched, seed: int, rules: Rules, *, quick: bool) -> list[float]:
    """Return the confidence of every cause that comes with the motion."""
    if quick:
        return [rules.quick_confidence] * len(s.found.steps)
    return confidences(s.rest, s.found, np.random.default_rng([seed, 1]), rules=rules)


def tried(c: Comparison, leave_out: Sequence[str] = ()) -> list[Effect]:
    """Return what a search tries on these logs: effects that they can show, and patterns without a name."""
    every = (*candidates(c, leave_out), *patterns(c))
    return [e for e in every if c.gate.admits(named_of(e).name, e.axis)]


def _concluded(
    subject: Machine | Twin,
    account: Account,
    gaps: Mapping[str, Mapping[str, Gap]],
    kind: str,
    every: Sequence[Found],
    seed: int,
    quick: bool,
) -> Diagnosis:
    c, found, rules = account.comparison, account.found, account.rules
    pushed = [p for p, _ in account.pushed]
    # by the share of the squared residual that they explain, most first
    ordered = sorted(every, key=lambda e: -next((x.share for x in e.shrink.values()), float("inf")))
    named = [e for e in ordered if e.confidence >= rules.named]
    possible = [e for e in ordered if e.confidence < rules.named]
    verdict = judge(c, found, gaps, named, possible, rules)
    pairs = pairs_alike(found.steps)
    has_command = c.new.motion.qr is not None
    advice, motions = advise(kind, pairs, has_command=has_command)
    axes = {p[0]: next((str(e.axis) for e in named if e.effect == p[0]), None) for p in pairs}
    files = {
        f"advice_{k}.csv": command(c.machine, c.new.motion, k, next(iter(axes.values()), None))
        for k in motions[:2]
    }
    return Diagnosis(
        verdict=verdict.verdict,
        sentence=verdict.sentence,
        gap=gaps,
        where=_where(c, found, pushed, np.random.default_rng([seed, 2])),
        effects=named,
        confusable=[list(p) for p in pairs],
        unexplained=verdict.unexplained,
        remains=verdict.remains,
        noise=kind,
        advice=[
            *of_one_run(c, named),
            *of_other_state(c, {*verdict.unexplained, *(c.machine.names[p.joint] for p in pushed)}, rules),
            *advice,
            *_untold(named),
            *resting(c.machine, {*gaps, *c.gate.unknown}),
            *verdict.notes,
        ],
        warnings=[*c.gate.warnings, *([] if c.apart is None else [c.apart.words(change=c.change)])],
        differs=[] if c.apart is None else c.apart.names,
        situation="change" if c.change else "structure",
        shrink={
            axis: {"u": account.together[j].shrink(gaps[axis]["u"].rms, axis)}
            for j, axis in enumerate(c.machine.names)
            if j in account.together
        },
        quick=quick,
        traces=traces(c, account.named),
        machine=c.machine.name,
        subject=subject,
        commands=files,
        missing=missing_before(c, found),
        possible=possible,
    )


def _untold(named: Sequence[Found]) -> list[str]:
    """Return what to do where these logs do not determine a payload's mass or centre."""
    out = []
    for e in named:
        open_ones = undetermined(e.size) if e.effect == "payload" else []
        if open_ones:
            out.append(
                f"these logs do not determine the {' and the '.join(open_ones)} of the payload on {e.axis}; turn "
                "its link under gravity, or accelerate it along other axes"
            )
    return out


def missing_before(c: Comparison, found: Search) -> list[dict[str, Any]]:
    """Return what the twin already lacked on its own logs: no change, but worth identifying."""
    if c.own is None:
        return []
    alone = replace(c, new=c.own, own=None, unseen=None)
    searcher = Searcher(alone)
    best: dict[tuple[str, str | None], float] = {}
    seen = [s.chosen for s in found.steps] + [r for s in found.steps for r in s.rivals[:6]]
    seen += [found.last[0]] if found.last else []
    for one in seen:
        again = None if isinstance(one.effect, Pattern) else searcher.score(one.effect)
        if again is not None and again.share > RULES.share_structure and again.judged.strength > 12.0:
            key = (one.effect.name, one.effect.axis)
            best[key] = max(best.get(key, 0.0), again.share)
    rows = [{"effect": e, "axis": a, "share": x} for (e, a), x in best.items()]
    return sorted(rows, key=lambda r: -float(str(r["share"])))


def _where(
    c: Comparison, found: Search, pushed: Sequence[Episodes], rng: np.random.Generator
) -> list[Region]:
    """Return the regions of the axes that something is said of, the times of pushes first."""
    out = [r for p in pushed for r in _times(p, c.machine.names[p.joint])]
    joints = list(dict.fromkeys(s.chosen.joint for s in found.steps))
    level = {j: c.new.level(j) / c.floor[j] for j in c.new.joints}
    joints = joints or sorted(level, key=lambda j: -level[j])[:1]
    rest: list[Region] = []
    for j in joints:
        rest += localise(c.new, c.new.residual[j], j, rng)
    return [*out, *sorted(rest, key=lambda r: -(r.share - r.time_share))]


def _times(p: Episodes, axis: str) -> list[Region]:
    """Return when an axis was pushed, what closes most first."""
    power = p.share * p.course**2 / max(float(p.course @ p.course), 1e-300)
    found = []
    for start, end in p.spans():
        inside = (p.t >= start) & (p.t < end)
        share, time_share = float(power[inside].sum()), float(inside.mean())
        found.append(Region(axis, "u", "time", (start, end), "s", share, time_share, None))
    return sorted(found, key=lambda r: -r.share)[:MOST_TIMES]


def _seed(seed: int, random_state: int | None) -> int:
    """Return the one seed that was given."""
    if random_state is None:
        return seed
    if seed:
        raise InputError("diagnose: seed and random_state are two names of one thing; give one of them")
    return random_state
