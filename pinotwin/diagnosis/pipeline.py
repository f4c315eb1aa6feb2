"""``diagnose``: where a log and its model differ, which effect is missing, how far the gap shrinks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.diagnosis.advice import advise, command, resting
from pinotwin.diagnosis.closed_loop import error_gaps
from pinotwin.diagnosis.confirm import beyond_doubt, confirmed
from pinotwin.diagnosis.decide import Decision, decide
from pinotwin.diagnosis.findings import findings
from pinotwin.diagnosis.gaps import Gaps, gaps
from pinotwin.diagnosis.patterns import patterns
from pinotwin.diagnosis.prepare import Ready, at_rest, ready
from pinotwin.diagnosis.result import Diagnosis, Found, Region
from pinotwin.diagnosis.search import Settings
from pinotwin.diagnosis.servo import look_at_servo
from pinotwin.diagnosis.standstill import look_at_rest, restless
from pinotwin.diagnosis.verdict import Left, judge, left_over
from pinotwin.diagnosis.vibration import look_at_vibration, unused
from pinotwin.diagnosis.where import localise
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.threads import one_blas_thread
from pinotwin.twin import Twin

Tell = Callable[[str, float], None]
BROKEN_LAW = "the controller's law leaves {:.3g} times what it left when it was identified"


@one_blas_thread
def diagnose(  # noqa: PLR0913, the public call: every option is a keyword
    subject: Machine | Twin,
    log: Log | Sequence[Log],
    *,
    validate: Log | Sequence[Log] | None = None,
    quick: bool = False,
    report: Tell | None = None,
    seed: int = 0,
    leave_out: Sequence[str] = (),
    closed_loop: bool = True,
) -> Diagnosis:
    """Say where logs and their model differ, which effects cause it, and how far the gap shrinks.

    Args:
        subject: a machine (its model is fitted to these logs and something is missing) or a twin
            (identified earlier, and these logs no longer agree).
        log: servo log(s); those with the same command are repeats and give the noise floor.
        validate: log(s) that nothing is fitted to; the shrink is then stated on them.
        quick: screen only, fewer healthy draws.
        report: called with the stage and the share done.
        seed: of everything random.
        leave_out: effects of the catalogue that are not to be considered.
        closed_loop: also state the gap of the tracking error, before and after (not when quick).

    Raises:
        LogError: a channel is missing or unusable.
        DataError: the logs hold too little.
    """
    tell = report or _silent
    tell("preparing the logs", 0.02)
    start = ready(subject, _list(log), _list(validate), lambda stage: tell(stage, 0.1), quick=quick)
    settings = Settings(
        draws=60 if quick else 160,
        injections=60 if quick else 200,
        most=1 if quick else 3,
        leave_out=frozenset(leave_out),
        seed=seed,
    )
    moving = start
    start, decision, words = _searched(start, settings, tell, quick=quick)
    gap, left, regions = _measured(start, moving, decision, tell, seed, loops=closed_loop and not quick)
    left = left.beside(words) if quick else left.beside(words).following(patterns(moving, decision))
    rows = start.stage.rows
    vibrations = look_at_vibration(
        subject,
        [*_list(log), *_list(validate)],
        rows.validation,
        rows.commands,
        np.random.default_rng([seed, 94]),
    )
    left = replace(left.beside(vibrations.open), stays={**left.stays, **vibrations.stays})
    gap = gap.beside(vibrations.gaps, vibrations.shrinks)
    others = vibrations.effects, [*regions, *vibrations.where]
    found = _diagnosis(subject, start, decision, gap, left, settings, quick, others)
    return replace(found, advice=[*found.advice, *unused(subject, _list(log))])


def _searched(
    start: Ready, settings: Settings, tell: Tell, *, quick: bool
) -> tuple[Ready, Decision, dict[int, str]]:
    """Return the stage, what was found in motion and at rest, and what is odd about joints at rest."""
    seed = settings.seed
    decision = decide(start.context, start.search_stage, start.theta, settings, tell)
    decision = confirmed(start, decision, np.random.default_rng([seed, 96]))
    if quick:
        return start, beyond_doubt(start, decision), {}
    tell("friction at standstill and reversals", 0.82)
    rest = at_rest(start)
    words = restless(start, rest)
    start, decision = look_at_rest(start, rest, decision, settings)
    decision = confirmed(start, decision, np.random.default_rng([seed, 95]))
    return start, beyond_doubt(start, decision), words


def _measured(
    start: Ready, moving: Ready, decision: Decision, tell: Tell, seed: int, *, loops: bool
) -> tuple[Gaps, Left, list[Region]]:
    """Return the gaps before and after, what stays, and where the tracking error has its gap."""
    tell("measuring the gap", 0.85)
    gap = gaps(start, decision, np.random.default_rng([seed, 98]))
    left = left_over(moving, replace(decision, searched=moving.search_stage), gap)
    if not loops:
        return gap, left, []
    errors, shrinks, regions = error_gaps(start, decision, tell, np.random.default_rng([seed, 97]))
    return gap.with_errors(errors, shrinks), left, regions


def _diagnosis(  # noqa: PLR0913, what one call has found out
    subject: Machine | Twin,
    start: Ready,
    decision: Decision,
    gap: Gaps,
    left: Left,
    settings: Settings,
    quick: bool,
    others: tuple[list[Found], list[Region]],
) -> Diagnosis:
    rows, noise = start.stage.rows, start.stage.noise
    rng = np.random.default_rng([settings.seed, 99])
    effects, confusable, pairs = findings(start, decision, gap, left, rng)
    flags = rows.validation
    fitted = [m for m, held in zip(rows.motions, flags, strict=True) if not held]
    unseen = [m for m, held in zip(rows.motions, flags, strict=True) if held]
    servo, broken = look_at_servo(subject, fitted, unseen, effects, settings.leave_out)
    effects += [*servo, *others[0]]
    effects.sort(key=lambda f: f.effect != "saturation")  # a drive at its limit before all else
    left = left.beside({j: BROKEN_LAW.format(x) for j, x in broken.items()})
    verdict = judge(start, decision, gap, left, effects)
    has_command = rows.motions[0].qr is not None
    advice, motions = advise(noise.kind, pairs, has_command=has_command)
    files = {
        f"advice_{kind}_{axis or 'all'}.csv": command(rows.machine, rows.motions[0], kind, axis)
        for kind, axis in motions[:2]
    }
    return Diagnosis(
        verdict=verdict.verdict,
        sentence=verdict.sentence,
        gap=gap.table,
        where=_ranked([*_where(start, verdict.joints, rng), *others[1]]),
        effects=effects,
        confusable=confusable,
        unexplained=verdict.unexplained,
        remains=verdict.remains,
        noise=noise.kind,
        advice=[*advice, *resting(rows.machine, gap.table), *verdict.advice],
        situation="change" if start.stage.base.change else "structure",
        shrink=gap.together,
        quick=quick,
        traces=gap.traces,
        machine=rows.machine.name,
        subject=subject,
        isolability=decision.calibration.predicted,
        commands=files,
    )


def _where(start: Ready, joints: Sequence[int], rng: np.random.Generator) -> list[Region]:
    """Return the regions of the axes whose gap is more than noise."""
    out: list[Region] = []
    for joint in joints:
        if joint in start.stage.rows.joints:
            out += localise(start.stage.rows, list(start.residuals), joint, rng)
    return out


def _ranked(regions: Sequence[Region]) -> list[Region]:
    """Return the regions, the one that holds most beyond its share of the time first."""
    return sorted(regions, key=lambda r: -(r.share - r.time_share))


def _list(logs: Log | Sequence[Log] | None) -> list[Log]:
    if logs is None:
        return []
    return [logs] if isinstance(logs, Log) else list(logs)


def _silent(stage: str, done: float) -> None:
    del stage, done
