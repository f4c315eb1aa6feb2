"""Recordings that are at fault while the machine is well: is the recording named, or a part of the machine accused?

Healthy machines of another simulator; the log of an unseen command is spoilt by ``robust/spoil.py`` of the cases beside
the recordings, seven kinds, on an axis drawn by the seed. Its twin was identified on a log that is well.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

from benchmarks.evidence import asking
from benchmarks.evidence.answers import Answers, Row, Runs

KINDS = ("command_late", "frozen", "clock", "dropped", "doubled", "other_run", "slow_linear")
FAULTS = (
    *("command_late", "command_jitter", "clock_scale", "effort_of_another_run", "rows_lost", "rows_doubled"),
    *("rows_held", "interpolated", "from_a_slower_log", "frozen"),
)
"""Causes that are none of the machine."""
AXIS, STEP = "Y", 0.004
"""What the script spoils, and the step of its clock [s]."""


def recordings(runs: Runs) -> Answers:
    """Ask about every kind on every machine."""
    script = runs.cases / "robust" / "spoil.py"
    if not script.is_file():
        print(f"{script} is not at hand: recordings that are at fault are not asked")
        return Answers([], "")
    seeds = range(runs.seed, runs.seed + runs.machines)
    questions = [f"{seed} {kind}" for seed in seeds for kind in KINDS]
    rows = asking.kept(runs.out, "spoilt", questions, lambda q: _asked(runs, script, *q.split()))
    command = f"python -m benchmarks.evidence.diagnosis spoilt --seed {seeds.start} --machines {len(seeds)}"
    return Answers(rows, command)


def _asked(runs: Runs, script: Path, seed: str, kind: str) -> Row:
    case = runs.at.case(f"random:{seed}", "none", int(seed))
    axes = _axes(case / "valid.csv")
    axis = axes[int(np.random.default_rng(int(seed)).integers(len(axes)))]
    log = case / f"{kind}.csv"
    spoil(script, case / "valid.csv", log, kind, axis)
    row = asking.diagnosed(asking.twin_of(case / "machine", case / "healthy.csv"), log, out=case / kind)
    return {"kind": kind, "axis": axis, **judged(row)}


def judged(row: Row) -> Row:
    """Return an answer with whether it names a cause of the machine, and whether it names the recording."""
    names = [x[0] for x in row["named"]]
    machine = any(name not in FAULTS for name in names)
    recorded = bool(row["recording"]) or any(name in FAULTS for name in names)
    return {**row, "machine_cause": machine, "recorded": recorded}


def _axes(log: Path) -> list[str]:
    with log.open(encoding="utf-8") as f:
        return [x.removesuffix(".qr") for x in f.readline().strip().split(",") if x.endswith(".qr")]


def spoil(script: Path, log: Path, out: Path, kind: str, axis: str) -> None:
    """Spoil a log by the script, which knows one axis and one clock: axis and clock go by these meanwhile.

    Args:
        script: ``spoil.py``.
        log: that is well.
        out: that is not.
        kind: one of :data:`KINDS`.
        axis: whose command or effort is spoilt, where a kind spoils but one axis.
    """
    t = np.loadtxt(log, delimiter=",", skiprows=1, usecols=0, max_rows=2)
    step = float(t[1] - t[0])
    lent = out.with_suffix(".lent.csv")
    _renamed(log, lent, axis, STEP / step)
    subprocess.run([sys.executable, str(script), str(lent), str(out), kind], check=True)
    _renamed(out, out, axis, step / STEP)
    lent.unlink()


def _renamed(log: Path, out: Path, axis: str, stretch: float) -> None:
    """Write a log with the names of two axes exchanged and its clock stretched."""
    head, _, body = log.read_text(encoding="utf-8").partition("\n")
    other = {axis: AXIS, AXIS: axis}
    names = [
        ".".join((other.get(a, a), *rest)) for a, *rest in (x.split(".") for x in head.strip().split(","))
    ]
    rows = [line.split(",") for line in body.splitlines()]
    at = names.index("t")
    for row in rows:
        row[at] = f"{float(row[at]) * stretch:.10g}"
    out.write_text("\n".join(",".join(row) for row in [names, *rows]) + "\n", encoding="utf-8")
