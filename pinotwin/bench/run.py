"""Run a bench: cases in parallel, each produced, diagnosed, and compared with the floors."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed

from pinotwin.bench.cases import Case
from pinotwin.bench.floors import floors
from pinotwin.bench.produce import SECONDS, healthy_twin, produce
from pinotwin.bench.scoring import Answer
from pinotwin.diagnosis import Diagnosis, diagnose
from pinotwin.machine import Machine


def answer(case: Case, seconds: float = SECONDS, quick: bool = False) -> Answer:
    """Produce the logs of a case, diagnose them, and note what was said."""
    made = produce(case, seconds=seconds)
    subject = (
        healthy_twin(case.machine) if case.situation == "change" else Machine.load(case.machine)
    )
    start = time.perf_counter()
    found = diagnose(
        subject, made.logs, validate=made.validation, quick=quick, seed=case.seed % 7919
    )
    spent = time.perf_counter() - start
    named = tuple((e.effect, e.axis, e.confidence) for e in found.effects)
    return Answer(
        case.number, case.machine, case.situation, case.kind, case.effects, made.rho, found.verdict,
        named, _set(found), _shrink(found), spent, floors(subject, made.logs),
    )  # fmt: skip


def _set(found: Diagnosis) -> tuple[tuple[str, str | None], ...]:
    if not found.effects:
        return ()
    first = found.effects[0]
    others = [(str(a["effect"]), a["axis"]) for a in first.alternatives if a["probability"] > 0.0]
    return ((first.effect, first.axis), *others)


def _shrink(found: Diagnosis) -> tuple[float, float, float, float] | None:
    if not found.effects or "u" not in found.effects[0].shrink:
        return None
    x = found.effects[0].shrink["u"]
    return x.share, x.interval[0], x.interval[1], x.promised


def run_bench(
    cases: Sequence[Case],
    *,
    workers: int = 2,
    seconds: float = SECONDS,
    report: Callable[[str, float], None] | None = None,
) -> list[Answer]:
    """Return the answers of all cases, in their order.

    Args:
        cases: what to run.
        workers: processes.
        seconds: length of each log [s].
        report: called with the stage and the share done.
    """
    if workers <= 1:
        return [answer(case, seconds) for case in cases]
    out: dict[int, Answer] = {}
    with ProcessPoolExecutor(workers) as pool:
        jobs = {pool.submit(answer, case, seconds): case for case in cases}
        for number, job in enumerate(as_completed(jobs)):
            out[jobs[job].number] = job.result()
            if report is not None:
                report(f"{number + 1} of {len(cases)} cases", (number + 1) / len(cases))
    return [out[case.number] for case in cases]
