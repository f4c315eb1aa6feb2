"""``python -m benchmarks gate``, ``real`` and ``three``: known answers, real recordings, three changes at once.

The bench itself is ``pinotwin blind``.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from pinotwin.errors import DataError, PinotwinError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parts = parser.add_subparsers(dest="what", required=True)
    gate = parts.add_parser(
        "gate", help="a fixed list of questions with known answers; fails if one is wrong"
    )
    gate.add_argument(
        "--quick", action="store_true", help="every healthy machine, and the faults that take less than 15 s"
    )
    gate.add_argument("--workers", type=int, default=2, help="processes (2)")
    gate.add_argument("--data", metavar="DIR", help="real recordings (default $PINOTWIN_DATA)")
    gate.add_argument("--work", metavar="DIR", help="keep twins and foreign cases here")
    real = parts.add_parser("real", help="recordings of real machines, each with an effect withheld")
    real.add_argument("--data", metavar="DIR", help="real recordings (default $PINOTWIN_DATA)")
    three = parts.add_parser("three", help="three changes at once, on ten machines of another simulator")
    three.add_argument("--seeds", default="2209:2260", help="machines; those with a second encoder are asked")
    three.add_argument("--data", metavar="DIR", help="real recordings (default $PINOTWIN_DATA)")
    three.add_argument("--work", metavar="DIR", default="out/three", help="keep the cases here (out/three)")
    args = parser.parse_args(arguments)
    try:
        if args.what == "three":
            return _three(args)
        if args.what == "gate":
            return _gate(args)
        return _real(args)
    except PinotwinError as error:
        sys.stderr.write(f"benchmarks: {error}\n")
        return 2


def _gate(args: argparse.Namespace) -> int:
    from benchmarks.questions.gate import Result, checks, run_gate
    from benchmarks.questions.other_machines import Elsewhere

    def tell(x: Result) -> None:
        sys.stdout.write(f"{'ok   ' if x.holds else 'WRONG'} {x.seconds:5.1f} s  {x.check} -> {x.said}\n")
        sys.stdout.flush()

    start = time.perf_counter()
    every = checks(args.quick)
    with tempfile.TemporaryDirectory(prefix="pinotwin-gate-") as made:
        work = Path(args.work or made)
        elsewhere = Elsewhere.at_hand(work / "elsewhere", args.data)
        results = run_gate(every, work, elsewhere, args.workers, tell)
    wrong, left = sum(not r.holds for r in results), len(every) - len(results)
    if left:
        tell_left = "the recordings and the other simulator are not at hand (PINOTWIN_DATA)"
        sys.stdout.write(f"{left} checks were left out: {tell_left}\n")
    seconds = time.perf_counter() - start
    sys.stdout.write(f"{len(results) - wrong} of {len(results)} right in {seconds:.0f} s\n")
    return int(wrong > 0 or (left > 0 and bool(os.environ.get("PINOTWIN_REQUIRE_DATA"))))


def _three(args: argparse.Namespace) -> int:
    from benchmarks.questions.other_machines import Elsewhere
    from benchmarks.questions.three import told

    elsewhere = Elsewhere.at_hand(Path(args.work), args.data)
    if elsewhere is None:
        raise DataError("the other simulator is not at hand; set PINOTWIN_DATA")
    return told(elsewhere, range(*map(int, args.seeds.split(":"))))


def _real(args: argparse.Namespace) -> int:
    from benchmarks.questions.real import HEAD, cells, data_folder, real_lines
    from benchmarks.questions.real_tasks import TASKS

    for row in (HEAD, ("---",) * len(HEAD), *map(cells, real_lines(data_folder(args.data), TASKS))):
        sys.stdout.write(f"| {' | '.join(row)} |\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
