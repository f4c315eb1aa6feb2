"""Healthy recordings that no script asks about: halves of one log, and runs of one machine, each held against another.

A robot's log in halves (TX40), two cogging maps and three slow turns of one motor (ODrive), and a mill at ten samples a
second, one part after the other (those of its logs that are long enough to identify a twin). Nothing has changed in any
of them but what a day changes; parts of the mill differ in feed, clamp and wear of the tool.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import pinotwin as pt
from pinotwin.bench import real_tasks
from pinotwin.diagnosis import Diagnosis
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.machine import Machine

MILL = Path(__file__).resolve().parents[2] / "examples" / "machines" / "cnc_mill"
MILLED = range(1, 13)


@dataclass(frozen=True)
class Asked:
    """One question: the twin of some log, and another log of the same machine.

    Attributes:
        name: such as ``TX40 first half -> second half``.
        machine: whose.
        own: log of the twin.
        other: log in question.
    """

    name: str
    machine: Machine
    own: Log
    other: Log

    def answer(self) -> Diagnosis:
        """Return what is said of the other log."""
        return pt.diagnose(pt.identify(self.machine, self.own, loop=False), self.other)


def questions(data: Path) -> Iterator[Asked]:
    """Yield all questions that recordings allow.

    Args:
        data: folder of the recordings.
    """
    for name, robot in (
        ("TX40", real_tasks._tx40(real_tasks._same, complete=False, folder=data)),
        ("KR300", real_tasks._kr300(data)),
    ):
        yield from _all(robot.machine, f"{name} half", _halves(robot.logs[0]))
    for name, given in (
        ("ODrive map", real_tasks._cogging_maps(data)),
        ("ODrive slow turn", real_tasks._cogging_runs(data)),
    ):
        yield from _all(given.machine, name, [*given.logs, *given.validation])
    mill = pt.Machine.load(MILL)
    parts = list(_identified(mill, data))
    for (a, own), (b, other) in zip(parts, [*parts[1:], parts[0]], strict=True):
        yield Asked(f"mill {a} -> {b}", mill, own, other)


def _halves(log: Log) -> list[Log]:
    return [log.rows(slice(0, len(log) // 2)), log.rows(slice(len(log) // 2, None))]


def _all(machine: Machine, name: str, logs: Sequence[Log]) -> Iterator[Asked]:
    for a, b in permutations(range(len(logs)), 2):
        yield Asked(f"{name} {a + 1} -> {b + 1}", machine, logs[a], logs[b])


def _identified(mill: Machine, data: Path) -> Iterator[tuple[int, Log]]:
    """Yield the mill's logs of which a twin can be identified, with their numbers."""
    for k in MILLED:
        log = pt.read(data / "cnc_mill_smart" / f"experiment_{k:02d}.csv")
        try:
            pt.identify(mill, log, loop=False)
        except DataError:
            continue
        yield k, log


def main() -> None:
    """Print every answer: ``python -m benchmarks.evidence.recordings``."""
    from pinotwin.bench.real import data_folder

    folder = data_folder(None)
    for asked in questions(Path(folder)):
        found = asked.answer()
        named = [(e.effect, e.axis, round(e.confidence, 2)) for e in found.effects]
        print(f"{asked.name}: {found.verdict} {named}", flush=True)


if __name__ == "__main__":
    main()
