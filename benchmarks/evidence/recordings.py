"""Further healthy recordings: halves of one log, and runs of one machine, each held against another.

The logs of three robots and a drive in halves (TX40, KR300, Panda, EMPS), single runs of LWR4, two cogging maps and
three slow turns of one motor (ODrive), and a mill at ten samples a second, one part after the other (those of its logs
that are long enough to identify a twin). Nothing has changed in any of them but what a day changes; the runs of LWR4
differ in their friction by half of it and one is twice as fast, the parts of the mill in feed, clamp and wear.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import permutations
from pathlib import Path

import pinotwin as pt
from benchmarks.evidence.real import folder, halves
from benchmarks.evidence.store import Figure
from benchmarks.questions.real_tasks import TASKS
from pinotwin.diagnosis import Diagnosis
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.machine import Machine

MILL = Path(__file__).resolve().parents[2] / "examples" / "machines" / "cnc_mill"
Recorded = tuple[Machine, Sequence[Log]]


def _of_task(recording: str, withheld: str) -> Callable[[Path], Recorded]:
    """Return what reads the machine and all logs of a line of the bench's table of recordings."""
    (task,) = (t for t in TASKS if (t.recording, t.withheld) == (recording, withheld))

    def read(data: Path) -> Recorded:
        given = task.make(data)
        return given.machine, [*given.logs, *given.validation]

    return read


def _in_halves(read: Callable[[Path], Recorded]) -> Callable[[Path], Recorded]:
    def cut(data: Path) -> Recorded:
        machine, (log,) = read(data)
        return machine, halves(log)

    return cut


def _panda(data: Path) -> Recorded:
    return pt.Machine.load(data / "franka_panda"), [pt.read(data / "franka_panda" / "exciting_traj.csv")]


def _emps(data: Path) -> Recorded:
    return pt.Machine.load("emps"), [pt.read(data / "emps" / "DATA_EMPS.mat")]


def _lwr4(data: Path) -> Recorded:
    runs = [pt.read(data / "kuka_lwr4" / f"measurements_{k}.csv") for k in (1, 2, 3)]
    return pt.Machine.load(data / "kuka_lwr4"), runs


def _mill(data: Path) -> Recorded:
    parts = [pt.read(data / "cnc_mill_smart" / f"experiment_{k:02d}.csv") for k in range(1, 13)]
    return pt.Machine.load(MILL), parts


RECORDED: Mapping[str, Callable[[Path], Recorded]] = {
    "TX40 half": _in_halves(_of_task("TX40", "the effort's lead, uncorrected")),
    "KR300 half": _in_halves(_of_task("KR300", "gear ripple")),
    "Panda half": _in_halves(_panda),
    "EMPS half": _in_halves(_emps),
    "LWR4 run": _lwr4,
    "ODrive map": _of_task("ODrive, cogging maps", "cogging"),
    "ODrive slow turn": _of_task("ODrive, slow turns", "cogging"),
    "mill": _mill,
}
"""Recording -> what reads its machine and its logs."""
IN_TURNS = ("mill",)
"""Of these each log is asked about with the twin of the one before it; of the others with that of every other one."""


def answers(name: str, data: Path) -> Iterator[tuple[str, Diagnosis]]:
    """Yield every question about a recording, such as ``TX40 half 1 -> 2``, and what is said of the second log.

    Args:
        name: of :data:`RECORDED`.
        data: folder of the recordings.
    """
    machine, logs = RECORDED[name](data)
    twins = {k: twin for k, log in enumerate(logs) if (twin := _identified(machine, log)) is not None}
    known = list(twins)
    pairs = zip(known, [*known[1:], known[0]], strict=True) if name in IN_TURNS else permutations(known, 2)
    for a, b in pairs:
        yield f"{name} {a + 1} -> {b + 1}", pt.diagnose(twins[a], logs[b])


def _identified(machine: Machine, log: Log) -> pt.Twin | None:
    """Return the twin of a log; None of one that is too short."""
    try:
        return pt.identify(machine, log, loop=False)
    except DataError:
        return None


SEEDS = "none: every question that these recordings allow"


def figures() -> list[Figure]:
    """Ask, print every answer, and count."""
    found = [pair for name in RECORDED for pair in answers(name, folder("."))]
    for name, said in found:
        causes = [(e.effect, e.axis, round(e.confidence, 2)) for e in said.effects]
        print(f"{name}: {said.verdict} {causes}", flush=True)
    what = "healthy recordings beside those of real.py"
    note = "looked at since; at the first run a cause was named in 8 of them"
    counts = {
        "named": (f"{what}: a cause named", sum(bool(d.effects) for _, d in found), note),
        "none": (f"{what}: `none`", sum(d.verdict == "none" for _, d in found), "the same"),
    }
    return [
        Figure(name, words, count, unit="", kind="development", of=len(found), note=note)
        for name, (words, count, note) in counts.items()
    ]
