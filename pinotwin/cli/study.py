"""``pinotwin study TWIN|MACHINE LOG [LOG...] --out DIR [--only ...] [--axis ...] [--window LOW,HIGH]``."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pinotwin.cli.inputs import add_effects, read_logs
from pinotwin.cli.output import add_common, made, say, write_json
from pinotwin.cli.progress import Report, progress
from pinotwin.errors import InputError, nearest

if TYPE_CHECKING:
    from pinotwin.logs.files.given import LogLike
    from pinotwin.machine import Machine
    from pinotwin.report.study import Studied
    from pinotwin.twin import Twin

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
    text = "seconds of the first log in which the tracking error is split by cause"
    parser.add_argument("--window", metavar="LOW,HIGH", help=text)
    add_effects(parser)
    add_common(parser, out="folder for study.html and a CSV file per study", required=True)


def study(
    subject: Machine | Twin | str | Path,
    log: LogLike | Sequence[LogLike],
    *,
    only: Sequence[str] = (),
    axes: Sequence[str] = (),
    window: tuple[float, float] | None = None,
    report: Report | None = None,
) -> Studied:
    """Make the studies of a machine: how much data, which coupling, which effect matters.

    Args:
        subject: a twin, or a machine to make one of from the logs; or its folder.
        log: servo log(s) or their files.
        only: studies of :data:`KINDS`; all when empty.
        axes: axes to look at; all when empty.
        window: first and last time of the tracking error by cause [s].
        report: called with the stage and the share done.

    Raises:
        InputError: a study or an axis is unknown, or none can be made.
    """
    from pinotwin.cli.diagnose import load_subject
    from pinotwin.identification import identify
    from pinotwin.logs.files.given import as_logs
    from pinotwin.report.study import studies
    from pinotwin.twin import Twin

    began = time.monotonic()
    for kind in only:
        if kind not in KINDS:
            raise InputError(f"study: no study {kind!r}; {nearest(kind, KINDS)}")
    kinds = [kind for kind in KINDS if not only or kind in only]
    given = load_subject(str(subject)) if isinstance(subject, str | Path) else subject
    logs = as_logs(log)
    twin = given if isinstance(given, Twin) else None
    machine = given.machine if isinstance(given, Twin) else given
    if twin is None and set(kinds) - {"amount", "coupling"}:
        twin = identify(machine, logs, loop="errors" in kinds, report=report)
    found = studies(machine, twin, logs, kinds=kinds, axes=axes, window=window, report=report)
    span = None if window is None else ",".join(f"{x:g}" for x in window)
    return found.dated(machine, logs, made(began, only=kinds, axis=list(axes) or "all", window=span))


def run(args: argparse.Namespace) -> int:
    """Make the studies and write page and tables."""
    window = _window(args.window)
    logs = read_logs(args.logs)
    with progress() as report:
        found = study(args.subject, logs, only=args.only, axes=args.axis, window=window, report=report)
        found.save(args.out)
    if args.json:
        write_json(args.json, found.to_dict())
    for name, (_, rows) in found.tables.items():
        say(f"{name}: {len(rows)} rows")
    for line in found.left_out:
        say(f"left out: {line}")
    say(f"studies written to {args.out}")
    return 0


def _window(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        low, high = (float(x) for x in text.split(","))
    except ValueError:
        raise InputError(f"--window: {text!r} is not LOW,HIGH in seconds") from None
    if not low < high:
        raise InputError(f"--window: {low:g} is not before {high:g}")
    return low, high
