"""``python -m benchmarks calibrate``: the limits of the diagnosis, derived from healthy machines.

The bench itself is ``pinotwin blind``.
"""

from __future__ import annotations

import argparse
import datetime
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import pinotwin.diagnosis.rules as rules
from pinotwin.errors import PinotwinError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parts = parser.add_subparsers(dest="what", required=True)
    calibrate = parts.add_parser(
        "calibrate", help="derive the limits of false alarms from healthy machines and write the rules"
    )
    calibrate.add_argument("--seed", type=int, default=41, help="of the first random machine (41)")
    calibrate.add_argument("--own", type=int, default=12, help="own random machines (12)")
    calibrate.add_argument("--foreign", type=int, default=8, help="of another simulator (8)")
    calibrate.add_argument("--alpha", type=float, default=0.02, help="false alarms by each rule (0.02)")
    calibrate.add_argument("--workers", type=int, default=2, help="processes (2)")
    calibrate.add_argument("--data", metavar="DIR", help="real recordings (default $PINOTWIN_DATA)")
    calibrate.add_argument("--work", metavar="DIR", help="keep twins and foreign cases here")
    calibrate.add_argument("--out", metavar="FILE", help="write here (default: the package's rules.py)")
    calibrate.add_argument("--dry", action="store_true", help="print the limits and write nothing")
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
    args = parser.parse_args(arguments)
    try:
        if args.what == "gate":
            return _gate(args)
        if args.what == "real":
            return _real(args)
        return _calibrate(args, ["calibrate", *_said(arguments)])
    except PinotwinError as error:
        sys.stderr.write(f"benchmarks: {error}\n")
        return 2


def _said(arguments: Sequence[str] | None) -> list[str]:
    """Return the arguments that the result depends on."""
    given = list(sys.argv[1:] if arguments is None else arguments)[1:]
    kept = [pair for pair in pairwise(given) if pair[0] in ("--seed", "--own", "--foreign", "--alpha")]
    return [x for pair in kept for x in pair]


def _calibrate(args: argparse.Namespace, words: Sequence[str]) -> int:
    from benchmarks.questions.calibrate import derived, measured, write_rules
    from benchmarks.questions.healthy import questions
    from benchmarks.questions.other_machines import Elsewhere

    def tell(line: str) -> None:
        sys.stdout.write(line + "\n")
        sys.stdout.flush()

    with tempfile.TemporaryDirectory(prefix="pinotwin-calibrate-") as made:
        work = Path(args.work or made)
        elsewhere = Elsewhere.at_hand(work / "elsewhere", args.data)
        if elsewhere is None:
            tell("machines from elsewhere and recordings are not at hand: own machines alone")
        asked = questions(args.seed, args.own, args.foreign, elsewhere=elsewhere is not None)
        found = measured(asked, work, elsewhere, args.workers, tell)
    limits = derived([v for _, v in found], args.alpha)
    for x in limits:
        largest = ", ".join(f"{v:.3g}" for v in x.largest)
        was = getattr(rules.RULES, x.rule)
        tell(f"{x.rule}: {was:g} -> {x.value:g} (of {x.questions} questions the largest need {largest})")
    if not args.dry:
        date = datetime.datetime.now(datetime.UTC).date().isoformat()
        command = " ".join(["python -m benchmarks", *words])
        write_rules(Path(args.out or str(rules.__file__)), limits, command, date)
    return 0


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


def _real(args: argparse.Namespace) -> int:
    from benchmarks.questions.real import HEAD, cells, data_folder, real_lines
    from benchmarks.questions.real_tasks import TASKS

    for row in (HEAD, ("---",) * len(HEAD), *map(cells, real_lines(data_folder(args.data), TASKS))):
        sys.stdout.write(f"| {' | '.join(row)} |\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
