"""Healthy recordings that no script asks about: halves of one log, and runs of one machine, each held against another.

The logs of three robots and a drive in halves (TX40, KR300, Panda, EMPS), single runs of LWR4, two cogging maps and
three slow turns of one motor (ODrive), and a mill at ten samples a second, one part after the other (those of its logs
that are long enough to identify a twin). Nothing has changed in any of them but what a day changes; the runs of LWR4
differ in their friction by half of it and one is twice as fast, the parts of the mill in feed, clamp and wear.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import pinotwin as pt
from benchmarks.evidence.store import Figure
from pinotwin.bench import real_tasks
from pinotwin.bench.real import data_folder
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
    for name, machine, file in (
        ("Panda", pt.Machine.load(data / "franka_panda"), "franka_panda/exciting_traj.csv"),
        ("EMPS", pt.Machine.load("emps"), "emps/DATA_EMPS.mat"),
    ):
        yield from _all(machine, f"{name} half", _halves(pt.read(data / file)))
    runs = [pt.read(data / "kuka_lwr4" / f"measurements_{k}.csv") for k in (1, 2, 3)]
    yield from _all(pt.Machine.load(data / "kuka_lwr4"), "LWR4 run", runs)
    for name, given in (
        ("ODrive map", real_tasks._cogging_maps(data)),
        ("ODrive slow turn", real_tasks._cogging_runs(data)),
    ):
        yield from _all(given.machine, name, [*given.logs, *given.validation])
    mill = pt.Machine.load(MILL)
    parts = list(_identified(mill, data))
    for (a, own), (b, other) in zip(parts, [*parts[1:], parts[0]], strict=True):
        yield Asked(f"mill {a} -> {b}", mill, own, other)


def _data() -> Path:
    root = data_folder(None)
    if root is None:
        raise FileNotFoundError("no recordings at hand; set PINOTWIN_DATA")
    return root


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


SEEDS = "none: every question that these recordings allow"
SLOW = False


def figures() -> list[Figure]:
    """Ask, print every answer, and count."""
    answers = [(asked.name, asked.answer()) for asked in questions(_data())]
    for name, found in answers:
        named = [(e.effect, e.axis, round(e.confidence, 2)) for e in found.effects]
        print(f"{name}: {found.verdict} {named}", flush=True)
    named = sum(bool(found.effects) for _, found in answers)
    silent = sum(found.verdict == "none" for _, found in answers)
    what = "healthy recordings beside those of real.py"
    note = "looked at since; as they were first asked, a cause was named in 8 of them"
    return [
        Figure(
            "named", f"{what}: a cause named", named, unit="", kind="development", of=len(answers), note=note
        ),
        Figure("none", f"{what}: `none`", silent, unit="", kind="development", of=len(answers), note=note),
    ]
