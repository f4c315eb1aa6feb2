"""Run a bench: cases over the cores, each produced, sealed, diagnosed and written down (``cases.jsonl``) at once.

One that was interrupted goes on where it stopped, with the same result; answers of other code are not used.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from pinotwin.arrays import plain
from pinotwin.bench.answers import Answer, failed, noted
from pinotwin.bench.cases import Case
from pinotwin.bench.engine import engine
from pinotwin.bench.fingerprint import fingerprint
from pinotwin.bench.oracle import evidence
from pinotwin.bench.produce import healthy_twin, make_twin, produce
from pinotwin.diagnosis import diagnose
from pinotwin.system.threads import one_blas_thread
from pinotwin.system.writing import held

Report = Callable[[str, float], None]


@dataclass(frozen=True)
class Plan:
    """How a bench is run."""

    folder: Path  # for cases.jsonl and the healthy twins
    seconds: float = 8.0  # length of every log [s]
    workers: int = 2  # processes
    minutes: float | None = None  # no case is begun after so long; None for no limit
    quick: bool = False  # screen only

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
    twin = healthy_twin(plan.twins, case.machine, case.twin) if case.situation == "change" else None
    ready = time.perf_counter()
    found = diagnose(  # from what is not sealed: logs, and a machine or twin without its truth
        twin or made.sealed.machine,
        made.sealed.logs,
        validate=made.sealed.validation,
        quick=plan.quick,
        leave_out=case.leave_out,
        seed=case.seed % 7919,
    )
    said = time.perf_counter()
    best = evidence(made, twin)
    spent = {"produce": ready - start, "diagnose": said - ready, "oracle": time.perf_counter() - said}
    return noted(case, found, made, spent, best)


def run_bench(cases: Sequence[Case], plan: Plan, report: Report | None = None) -> list[Answer]:
    """Return the answers of the cases reached, in order, those in the folder as they are; tell ``report`` the share."""
    plan.folder.mkdir(parents=True, exist_ok=True)
    keys = {plan.key(case): case for case in cases}
    done = {k: a for k, a in written(plan.file).items() if k in keys}
    left = [case for key, case in keys.items() if key not in done]
    tell = report or (lambda stage, done: None)
    for count, (case, said) in enumerate(_answers(left, plan, tell), 1 + len(done)):
        key = plan.key(case)
        append(plan.file, key, said)
        done[key] = said
        tell(f"{count} of {len(cases)} cases", count / len(cases))
    return sorted(done.values(), key=lambda a: a.number)


def written(file: Path) -> dict[str, Answer]:
    """Return the answers that a file holds, by key; broken lines and errors are passed over, to be run again."""
    out: dict[str, Answer] = {}
    for line in file.read_text(encoding="utf-8", errors="replace").splitlines() if file.is_file() else ():
        with contextlib.suppress(ValueError, LookupError, TypeError, AttributeError):
            raw: Mapping[str, Any] = json.loads(line)
            said = msgspec.convert(raw, Answer)
            if said.verdict != "error":
                out[str(raw["key"])] = said
    return out


def append(file: Path, key: str, said: Answer) -> None:
    """Add a line to the answers; one that broke off before it, or another process, does not spoil it."""
    line = json.dumps({"key": key, **plain(dataclasses.asdict(said))}) + "\n"
    with file.open("a+b") as stream, held(file):
        end = stream.seek(0, os.SEEK_END)
        if end:
            stream.seek(end - 1)
            if stream.read(1) != b"\n":
                line = "\n" + line
        stream.write(line.encode())


def _answers(cases: Sequence[Case], plan: Plan, tell: Report) -> Iterator[tuple[Case, Answer]]:
    if not cases:
        return
    end = None if plan.minutes is None else time.monotonic() + 60.0 * plan.minutes
    with engine(plan.workers) as each:
        # The healthy twins come first, so that two processes never make the same one.
        twins = sorted({(c.machine, c.twin) for c in cases if c.situation == "change"})
        for count, _ in enumerate(each(functools.partial(make_twin, plan.twins), twins, None), 1):
            tell(f"healthy twin {count} of {len(twins)}", 0.0)  # one that fails is an error of its cases
        for case, said in each(functools.partial(answer, plan=plan), cases, end):
            yield case, failed(case, said) if isinstance(said, BaseException) else said
