"""Run a bench: cases over the cores, each produced, sealed, diagnosed and written down at once.

Every answer is one line of ``cases.jsonl``; a bench that was interrupted goes on where it stopped, and
its result does not depend on how often that was, nor on how many processes it had. Answers of other code
(:mod:`pinotwin.bench.fingerprint`) stay in the file and are not used.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pinotwin.arrays import plain
from pinotwin.bench.answers import Answer, failed, noted, read_answer
from pinotwin.bench.cases import Case
from pinotwin.bench.fingerprint import fingerprint
from pinotwin.bench.floors import floors
from pinotwin.bench.oracle import evidence
from pinotwin.bench.produce import SECONDS, Sealed, produce
from pinotwin.bench.twins import healthy_twin, make_twin
from pinotwin.diagnosis import Diagnosis, diagnose
from pinotwin.threads import one_blas_thread
from pinotwin.twin import Twin

Report = Callable[[str, float], None]


@dataclass(frozen=True)
class Plan:
    """How a bench is run.

    Attributes:
        folder: for ``cases.jsonl`` and the healthy twins.
        seconds: length of every log [s].
        workers: processes.
        minutes: no case is begun after so long; None for no limit.
        quick: screen only.
    """

    folder: Path
    seconds: float = SECONDS
    workers: int = 2
    minutes: float | None = None
    quick: bool = False

    @property
    def file(self) -> Path:
        """Where the answers are."""
        return self.folder / "cases.jsonl"

    @property
    def twins(self) -> Path:
        """Where the healthy twins of this code are."""
        return self.folder / f"twins-{fingerprint()}"

    def key(self, case: Case) -> str:
        """Return the name of a case's answer: other code, other logs, another answer."""
        return case.key(self.seconds, self.quick, fingerprint())


@one_blas_thread
def answer(case: Case, plan: Plan) -> Answer:
    """Produce a case, diagnose what may be seen of it, and note what was said."""
    start = time.perf_counter()
    made = produce(case, seconds=plan.seconds)
    twin = None
    if case.situation == "change":
        twin = healthy_twin(plan.twins, case.machine, case.twin)
    ready = time.perf_counter()
    found = blindly(made.sealed, twin, case, plan.quick)
    said = time.perf_counter()
    peers = floors(case, made.sealed, twin)
    scored = time.perf_counter()
    best = evidence(made, twin)
    end = time.perf_counter()
    spent = {
        "produce": ready - start,
        "diagnose": said - ready,
        "floors": scored - said,
        "oracle": end - scored,
    }
    return noted(case, found, made, spent, peers, best)


def blindly(sealed: Sealed, twin: Twin | None, case: Case, quick: bool) -> Diagnosis:
    """Return the diagnosis from what is not sealed: logs, and a machine or twin without its truth."""
    return diagnose(
        twin or sealed.machine,
        sealed.logs,
        validate=sealed.validation,
        quick=quick,
        leave_out=case.leave_out,
        seed=case.seed % 7919,
        closed_loop=False,
    )


def run_bench(cases: Sequence[Case], plan: Plan, report: Report | None = None) -> list[Answer]:
    """Return the answers of the cases that were reached, in their order.

    Args:
        cases: what to run; those that the folder knows are not run again.
        plan: how.
        report: called with the stage and the share done.
    """
    plan.folder.mkdir(parents=True, exist_ok=True)
    keys = {plan.key(case): case for case in cases}
    done = {k: a for k, a in written(plan.file).items() if k in keys}
    left = [case for key, case in keys.items() if key not in done]
    tell = report or _silent
    for count, (case, said) in enumerate(_answers(left, plan, tell), 1 + len(done)):
        key = plan.key(case)
        with plan.file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps({"key": key, **plain(dataclasses.asdict(said))}) + "\n")
        done[key] = said
        tell(f"{count} of {len(cases)} cases", count / len(cases))
    return sorted(done.values(), key=lambda a: a.number)


def written(file: Path) -> dict[str, Answer]:
    """Return the answers that a file holds, by key; a line that broke off is passed over."""
    out: dict[str, Answer] = {}
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
        if line.endswith("}") and line.startswith("{"):
            raw: Mapping[str, Any] = json.loads(line)
            out[str(raw["key"])] = read_answer(raw)
    return out


def _answers(cases: Sequence[Case], plan: Plan, tell: Report) -> Iterator[tuple[Case, Answer]]:
    end = None if plan.minutes is None else time.monotonic() + 60.0 * plan.minutes
    if plan.workers <= 1:
        for case in cases:
            if end is not None and time.monotonic() > end:
                return
            yield case, answer(case, plan)
        return
    with ProcessPoolExecutor(plan.workers) as pool:
        _make_twins(cases, plan, pool, tell)
        running: dict[Future[Answer], Case] = {}
        waiting = list(cases)[::-1]
        while running or waiting:
            late = end is not None and time.monotonic() > end
            while waiting and not late and len(running) < plan.workers + 1:
                case = waiting.pop()
                running[pool.submit(answer, case, plan)] = case
            if not running:
                return
            for job in wait(running, return_when=FIRST_COMPLETED).done:
                case = running.pop(job)
                error = job.exception()
                yield case, job.result() if error is None else failed(case, error)


def _make_twins(cases: Sequence[Case], plan: Plan, pool: ProcessPoolExecutor, tell: Report) -> None:
    """Identify the healthy twins before the cases, so that two processes never make the same one."""
    wanted = sorted({(c.machine, c.twin) for c in cases if c.situation == "change"})
    jobs = [pool.submit(make_twin, plan.twins, *pair) for pair in wanted]
    for count, job in enumerate(jobs, 1):
        tell(f"healthy twin {count} of {len(jobs)}", 0.0)
        job.exception()  # waits; a twin that cannot be made is an error of each of its cases


def _silent(stage: str, done: float) -> None:
    del stage, done
