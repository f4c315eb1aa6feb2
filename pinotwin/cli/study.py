"""``pinotwin study TWIN|MACHINE LOG [LOG...] --out DIR [--only ...] [--axis ...] [--window LOW,HIGH]``."""

from __future__ import annotations

import argparse
import time

from pinotwin.cli.inputs import add_effects, read_logs
from pinotwin.cli.output import add_common, made, say, write_json
from pinotwin.cli.progress import progress
from pinotwin.system.writing import whole_folder, write_text

KINDS = ("amount", "coupling", "without", "overlay", "errors")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "subject", metavar="TWIN|MACHINE", help="a twin, or a machine to make one of from the logs"
    )
    parser.add_argument("logs", nargs="+", metavar="LOG", help="servo log(s)")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=KINDS,
        default=[],
        metavar="STUDY",
        help=f"of {', '.join(KINDS)}; all without",
    )
    parser.add_argument("--axis", nargs="+", default=[], metavar="AXIS", help="these axes; all without")
    text = "seconds of the first log in which the tracking error is told apart by cause"
    parser.add_argument("--window", metavar="LOW,HIGH", help=text)
    add_effects(parser)
    add_common(parser, out="folder for study.html and a CSV file per study", required=True)


def run(args: argparse.Namespace) -> int:
    """Make the studies and write page and tables."""
    from pinotwin.cli.diagnose import load_subject
    from pinotwin.identification import identify
    from pinotwin.report.study import csv_lines, made_page, study
    from pinotwin.twin import Twin

    window = _window(args.window)
    subject = load_subject(args.subject)
    logs = read_logs(args.logs)
    kinds = [kind for kind in KINDS if not args.only or kind in args.only]
    began = time.monotonic()
    with progress() as report:
        twin = subject if isinstance(subject, Twin) else None
        machine = subject.machine if isinstance(subject, Twin) else subject
        if twin is None and set(kinds) - {"amount", "coupling"}:
            twin = identify(machine, logs, loop="errors" in kinds, report=report)
        found = study(machine, twin, logs, kinds=kinds, axes=args.axis, window=window, report=report)
        how = made(began, only=kinds, axis=args.axis or "all", window=args.window)
        with whole_folder(args.out, replaces=("study.html", "*.csv")) as folder:
            write_text(folder / "study.html", made_page(found, machine, logs, how).html())
            for name, (header, rows) in found.tables.items():
                write_text(folder / name, "\n".join(csv_lines(header, rows)) + "\n")
    if args.json:
        tables = {
            name: [dict(zip(header, row, strict=True)) for row in rows]
            for name, (header, rows) in found.tables.items()
        }
        write_json(args.json, {"machine": machine.name, "tables": tables, "left_out": found.left_out})
    for name, (_, rows) in found.tables.items():
        say(f"{name}: {len(rows)} rows")
    for line in found.left_out:
        say(f"left out: {line}")
    say(f"studies written to {args.out}")
    return 0


def _window(text: str | None) -> tuple[float, float] | None:
    from pinotwin.errors import InputError

    if text is None:
        return None
    try:
        low, high = (float(x) for x in text.split(","))
    except ValueError:
        raise InputError(f"--window: {text!r} is not LOW,HIGH in seconds") from None
    if not low < high:
        raise InputError(f"--window: {low:g} is not before {high:g}")
    return low, high
