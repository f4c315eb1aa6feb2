"""The gate: a fixed list of questions with known answers that the diagnosis must not get wrong.

Healthy machines of every kind must stay silent; a few faults, plain ones, must be named first and on the
right axis. It guards what was reached; how good the diagnosis is, the bench says, on cases never seen.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.questions.healthy import Asked, Question, asked, foreign_case, read_logs, twin_of
from benchmarks.questions.other_machines import Elsewhere
from pinotwin.bench.answers import Key, same_class
from pinotwin.bench.cases import Case
from pinotwin.bench.engine import engine
from pinotwin.bench.fingerprint import fingerprint
from pinotwin.bench.produce import healthy_twin, produce
from pinotwin.diagnosis import diagnose

SECONDS = 6.0
"""Length of the logs of own machines [s]."""


@dataclass(frozen=True)
class Check:
    """A question with its answer.

    Attributes:
        question: machine, situation and kind of it.
        fault: what is put in, and how large; empty for a healthy machine.
        axis: where. size: of it, in the units of whoever puts it in.
        quick: whether it is part of the quick gate, too.
    """

    question: Question
    fault: str = ""
    axis: str = ""
    size: float = 0.0
    quick: bool = True

    def __str__(self) -> str:
        return f"{self.question}: " + (f"{self.fault} on {self.axis}" if self.fault else "healthy")

    def holds(self, verdict: str, named: Sequence[Key]) -> bool:
        """Whether a verdict, with the effects and axes that it names, is the right answer."""
        if not self.fault:
            return verdict == "none" and not named
        return bool(named) and same_class(named[0], (self.fault, self.axis))


CHECKS = (
    Check(Question("own", "emps", "structure", 3)),
    Check(Question("own", "emps", "change", 3)),
    Check(Question("own", "trunnion", "structure", 4)),
    Check(Question("own", "random:30", "change", 5)),
    Check(Question("own", "emps", "change", 6), "viscous", "X", 0.2),  # beyond a day's scatter
    Check(Question("own", "emps", "structure", 8), "ripple", "X", 0.02),
    Check(Question("own", "emps", "structure", 9), "position_table", "X", 0.03),
    Check(Question("foreign", "random:205", "structure", 205)),
    Check(Question("foreign", "random:206", "change", 206)),
    Check(Question("foreign", "random:206", "change", 206), "viscous"),
    Check(Question("foreign", "random:206", "structure", 206), "ripple", quick=False),
    Check(Question("real", "emps", "change", run="own")),
    Check(Question("real", "emps", "change", run="other")),
    Check(Question("real", "lwr4", "change", run="other")),
    Check(Question("real", "panda", "change", run="other")),
    Check(Question("real", "emps", "change"), "viscous", "X", 0.12),
    Check(Question("real", "lwr4", "change"), "coulomb", "lwr_2", 0.25, quick=False),
    Check(Question("real", "panda", "change"), "ripple", "panda_joint3", 0.12, quick=False),
)
"""All of them on machines and seeds that the rules were developed on. The quick gate has every healthy machine, and
of the faults those that take less than 15 s."""


def checks(quick: bool) -> list[Check]:
    """Return the checks of the gate, or of the quick one."""
    return [c for c in CHECKS if c.quick or not quick]


@dataclass(frozen=True)
class Result:
    """What came of a check.

    Attributes:
        check: which.
        holds: whether it was answered right.
        said: verdict and names, or what went wrong.
        seconds: it took [s].
    """

    check: Check
    holds: bool
    said: str
    seconds: float


def run_gate(
    every: Sequence[Check],
    work: Path,
    elsewhere: Elsewhere | None,
    workers: int = 2,
    tell: Callable[[Result], None] | None = None,
) -> list[Result]:
    """Return the results of checks; of those that need what is not at hand, none.

    Args:
        every: checks, see :func:`checks`.
        work: folder for twins and cases.
        elsewhere: the other simulator and the recordings.
        workers: processes.
        tell: called with each result as it comes.
    """
    possible = [c for c in every if c.question.kind == "own" or elsewhere is not None]
    if elsewhere is not None:
        elsewhere.real("emps")  # written once, before the processes read it
    groups = _together(possible)
    out = []
    with engine(workers) as each:
        for group, results in each(functools.partial(_answers, work=work, elsewhere=elsewhere), groups, None):
            if isinstance(results, BaseException):
                results = [Result(c, False, f"{type(results).__name__}: {results}", 0.0) for c in group]
            for result in results:
                out.append(result)
                if tell:
                    tell(result)
    return out


def _together(checks: Sequence[Check]) -> list[tuple[Check, ...]]:
    """Return the checks by machine: those of one share a twin, and a process."""
    out: dict[tuple[str, str], list[Check]] = {}
    for check in checks:
        out.setdefault((check.question.kind, check.question.machine), []).append(check)
    return sorted((tuple(group) for group in out.values()), key=lambda g: -len(g))


def _answers(group: Sequence[Check], work: Path, elsewhere: Elsewhere | None) -> list[Result]:
    return [_answer(check, work, elsewhere) for check in group]


def _answer(check: Check, work: Path, elsewhere: Elsewhere | None) -> Result:
    start = time.perf_counter()
    given, check = _given(check, work, elsewhere)
    found = diagnose(given.subject, given.logs, validate=given.validation or None)
    named = [(e.effect, e.axis) for e in found.effects]
    said = ": ".join(filter(None, (found.verdict, ", ".join(f"{e} on {a}" for e, a in named))))
    return Result(check, check.holds(found.verdict, named), said, time.perf_counter() - start)


def _given(check: Check, work: Path, elsewhere: Elsewhere | None) -> tuple[Asked, Check]:
    """Return what is asked, and the check with the axis that a foreign case puts its fault on."""
    q = check.question
    if not check.fault:
        return asked(q, work, elsewhere), check
    if q.kind == "own":
        put_in = ((check.fault, check.axis, check.size),)
        sealed = produce(Case(0, q.machine, q.situation, "single", put_in, q.seed), seconds=SECONDS).sealed
        change = q.situation == "change"
        twin = healthy_twin(work / f"twins-{fingerprint()}", q.machine, 0) if change else sealed.machine
        return Asked(twin, sealed.logs, sealed.validation), check
    assert elsewhere is not None
    if q.kind == "foreign":
        case = elsewhere.case(q.machine, check.fault, q.seed)
        axis = elsewhere.answer(case)["axis"]
        return foreign_case(case, q.situation), Check(q, check.fault, axis)
    machine, own, _ = elsewhere.real(q.machine)
    log = elsewhere.faulty(q.machine, check.fault, check.axis, check.size, q.seed)
    return Asked(twin_of(machine, tuple(own)), read_logs([log])), check
