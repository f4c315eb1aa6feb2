"""Closed loops of another simulator's machines: identified on 18 s, 12 s of another command simulated from it alone.

Random machines that nobody had looked at, asked once with `score.py loop` beside the recordings: RMS error over RMS of
tracking error and effort, mean of all axes. A machine that fails counts as a failure, not as an error.
"""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.evidence import store
from benchmarks.evidence.answers import Answers, Given, Row, Runs
from benchmarks.evidence.store import Figure

ROOT = Path(__file__).resolve().parents[2]
SEED, MACHINES = 490, 10
SEEDS = f"random:{SEED} to random:{SEED + MACHINES - 1}; looked at since"
SLOW = True


def figures() -> list[Figure]:
    """Ask about every machine and count; see the module."""
    runs = Runs.beside(ROOT / "out" / "evidence", SEED, MACHINES)
    return figures_of(runs.score("score.py", "loop", "--seeds", runs.seeds).rows)


def figures_of(rows: Sequence[Row]) -> list[Figure]:
    """Return the figures of rows of ``score.py loop``."""
    good = [row for row in rows if "mean" in row]
    return [
        Figure("failed", "machines that fail", float(len(rows) - len(good)), unit="", of=len(rows)),
        _spread("all", "error of e and u, mean of all axes, median machine", [r["mean"] for r in good]),
        _spread("moving", "the same of the rows that move", [r["mean_moving"] for r in good]),
    ]


def _spread(name: str, what: str, shares: Sequence[float]) -> Figure:
    percent = 100.0 * np.asarray(shares)
    return Figure(name, what, float(np.median(percent)), low=float(percent.min()), high=float(percent.max()))


def main() -> None:
    """Count answers of `score.py loop` that were given elsewhere: `python -m benchmarks.evidence.loops FILE...`."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.evidence.loops", description=main.__doc__)
    parser.add_argument("scores", nargs="+", type=Path, metavar="FILE", help="scores.jsonl")
    told: Answers = Given.read(parser.parse_args().scores).score("score.py", "loop")
    what = inspect.cleandoc(__doc__ or "")
    store.keep("loops", what, figures_of(told.rows), command=told.command, seeds="those of the command")


if __name__ == "__main__":
    main()
