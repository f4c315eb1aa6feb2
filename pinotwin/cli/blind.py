"""``pinotwin blind [--machines ...] [--seeds N] --out DIR``."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any

from pinotwin.cli.output import add_common, say, whole_folder, write_json
from pinotwin.cli.progress import progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--machines", nargs="+", default=["trunnion", "laser_driller", "emps"],
                        metavar="NAME", help="bundled machines, or folders with a virtual.yaml")  # fmt: skip
    parser.add_argument(
        "--seeds", type=int, default=1, metavar="N", help="repetitions of every case (1)"
    )
    parser.add_argument("--situations", nargs="+", default=["structure", "change"],
                        choices=["structure", "change"], help="which of the two to run")  # fmt: skip
    parser.add_argument("--seconds", type=float, default=12.0, help="length of every log [s] (12)")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    parser.add_argument("--seed", type=int, default=0, help="of everything that is drawn (0)")
    add_common(parser, out="folder for blind.json and blind.txt", required=True)


def run(args: argparse.Namespace) -> int:
    """Run the bench and write its table."""
    from pinotwin.bench.cases import draw_cases
    from pinotwin.bench.run import run_bench
    from pinotwin.bench.scoring import score
    from pinotwin.bench.table import lines
    from pinotwin.errors import InputError

    if args.seeds < 1 or args.workers < 1:
        raise InputError("--seeds and --workers must be at least 1")
    cases = draw_cases(args.machines, args.seeds, situations=args.situations, seed=args.seed)
    with progress() as report:
        answers = run_bench(cases, workers=args.workers, seconds=args.seconds, report=report)
    content: dict[str, Any] = {
        "scores": score(answers),
        "cases": [dataclasses.asdict(a) for a in answers],
    }
    text = lines(content["scores"])
    with whole_folder(args.out) as folder:
        write_json(folder / "blind.json", content)
        (folder / "blind.txt").write_text("\n".join(text) + "\n", encoding="utf-8")
    if args.json:
        write_json(args.json, content)
    for line in text:
        say(line)
    return 0
