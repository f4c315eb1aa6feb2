"""``pinotwin blind [--machines ...] [--seeds N] --out DIR``: the withheld-effect bench, scored."""

from __future__ import annotations

import argparse
from pathlib import Path

from pinotwin.cli.output import add_common, say, write_json
from pinotwin.cli.progress import progress
from pinotwin.system.writing import write_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "--machines",
        nargs="+",
        metavar="NAME",
        help="bundled machines, random:SEED, or folders with a virtual.yaml",
    )
    parser.add_argument(
        "--seeds",
        type=int,
        default=1,
        metavar="N",
        help="rounds of about 95 cases each (1); the published table has 4",
    )
    parser.add_argument("--cases", type=int, metavar="N", help="only so many of them, evenly spread")
    parser.add_argument(
        "--situations",
        nargs="+",
        default=["structure", "change"],
        choices=["structure", "change"],
        help="which of the two to run",
    )
    parser.add_argument("--seconds", type=float, default=8.0, help="length of every log [s] (8)")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    parser.add_argument(
        "--limit-minutes",
        type=float,
        metavar="T",
        help="begin no case after so long; the next run goes on from there",
    )
    parser.add_argument("--seed", type=int, default=0, help="of everything that is drawn (0)")
    parser.add_argument("--quick", action="store_true", help="screen only, in every diagnosis")
    add_common(parser, out="folder for bench.html, bench.md, bench.json and cases.jsonl", required=True)


def run(args: argparse.Namespace) -> int:
    """Run the bench and write its table."""
    from pinotwin.bench.cases import MACHINES, draw_cases, some
    from pinotwin.bench.run import Plan, run_bench
    from pinotwin.bench.table import Bench, markdown
    from pinotwin.report.blind import bench_page

    _check(args)
    folder = Path(args.out)
    drawn = draw_cases(args.machines or MACHINES, args.seeds, situations=args.situations, seed=args.seed)
    cases = some(drawn, args.cases)
    plan = Plan(folder, args.seconds, args.workers, args.limit_minutes, args.quick)
    with progress() as report:
        answers = run_bench(cases, plan, report)
    bench = Bench(answers, len(cases))
    content, text = bench.document(), markdown(bench)
    write_json(folder / "bench.json", content)
    write_text(folder / "bench.md", text)
    write_text(folder / "bench.html", bench_page(bench).html())
    if args.json:
        write_json(args.json, content)
    say(text)
    return 0


def _check(args: argparse.Namespace) -> None:
    from pinotwin.errors import InputError

    for name in ("seeds", "workers", "cases"):
        value = getattr(args, name)
        if value is not None and value < 1:
            raise InputError(f"--{name}: must be at least 1")
    if not 2.0 <= args.seconds <= 120.0:
        raise InputError(f"--seconds: {args.seconds:g}: expected 2 to 120")
    if args.limit_minutes is not None and args.limit_minutes <= 0.0:
        raise InputError("--limit-minutes: must be positive")
    if args.seed < 0:
        raise InputError("--seed: must not be negative")
