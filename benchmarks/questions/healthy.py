"""Healthy machines of several kinds: pinotwin's own virtual ones, another simulator's, and real ones.

A question is a subject (machine or twin) with logs in which nothing is missing and nothing has changed.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.questions.other_machines import Elsewhere
from pinotwin.bench.cases import Case
from pinotwin.bench.fingerprint import fingerprint
from pinotwin.bench.produce import healthy_twin, produce
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.logs.files import read
from pinotwin.logs.prepared import Prepared
from pinotwin.machine import Machine
from pinotwin.twin import Twin


@dataclass(frozen=True)
class Question:
    """A question about a healthy machine.

    Attributes:
        kind: ``own``, ``foreign`` or ``real``.
        machine: name; of a real one the set of recordings.
        situation: ``structure`` or ``change``.
        seed: of what is drawn. run: of a real twin: its ``own`` log, an ``other`` one, or ``both``.
    """

    kind: str
    machine: str
    situation: str
    seed: int = 0
    run: str = ""

    def __str__(self) -> str:
        rest = self.run or f"{self.situation} {self.seed}"
        return f"{self.kind} {self.machine} {rest}"


@dataclass(frozen=True)
class Asked:
    """What a diagnosis is given.

    Attributes:
        subject: machine, or the twin that a change is seen against.
        logs: in question.
        validation: of another command; may be none.
    """

    subject: Machine | Twin
    logs: tuple[Log, ...]
    validation: tuple[Log, ...] = ()


def asked(question: Question, work: Path, elsewhere: Elsewhere | None) -> Asked:
    """Return the subject and the logs of a question.

    Args:
        question: which.
        work: folder for the twins of own machines.
        elsewhere: the other simulator and the recordings.

    Raises:
        DataError: the machine that was drawn is not healthy.
    """
    if question.kind == "own":
        case = Case(0, question.machine, question.situation, "healthy", (), question.seed)
        sealed = produce(case).sealed
        for log in sealed.logs:
            for finding in Prepared(sealed.machine, log).quality.findings:
                if finding.code == "loop_unstable":
                    raise DataError(f"{finding.channel}: {finding.message}")
        change = question.situation == "change"
        return Asked(
            healthy_twin(work / f"twins-{fingerprint()}", question.machine, 0) if change else sealed.machine,
            sealed.logs,
            sealed.validation,
        )
    assert elsewhere is not None
    if question.kind == "foreign":
        return foreign_case(elsewhere.case(question.machine, "none", question.seed), question.situation)
    machine, own, test = elsewhere.real(question.machine)
    paths = {"own": [own[0]], "other": [test], "both": [own[-1], test]}[question.run]
    return Asked(twin_of(machine, tuple(own)), read_logs(paths))


def foreign_case(folder: Path, situation: str) -> Asked:
    """Return a case of the other simulator: its machine, or the twin of its healthy log."""
    subject: Machine | Twin
    if situation == "change":
        subject = twin_of(folder / "machine", (folder / "healthy.csv",))
    else:
        subject = Machine.load(folder / "machine")
    logs = read_logs([folder / "train.csv", folder / "repeat.csv"])
    return Asked(subject, logs, read_logs([folder / "valid.csv"]))


@functools.lru_cache(maxsize=4)
def twin_of(machine: Path, logs: tuple[Path, ...], *, loop: bool = False) -> Twin:
    """Return the twin of some logs, with or without closed loops: several questions share it."""
    from pinotwin.identification import identify

    return identify(Machine.load(machine), read_logs(logs), loop=loop)


def read_logs(paths: Sequence[Path]) -> tuple[Log, ...]:
    """Return the logs of some files."""
    return tuple(read(path) for path in paths)
