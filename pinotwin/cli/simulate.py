"""``pinotwin simulate TWIN LOG --out PRED.csv``."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinotwin.cli.inputs import add_effects
from pinotwin.cli.output import add_common, beside, check_page, columns, made, say, write_json
from pinotwin.system.writing import write_text

if TYPE_CHECKING:
    from pinotwin.simulation.prediction import Prediction


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("twin", help="folder that `pinotwin identify` wrote")
    parser.add_argument("log", metavar="LOG", help="log; only t, *.qr and external loads are used")
    parser.add_argument(
        "--controller",
        choices=("coupled", "black", "vibration"),
        help="identified controllers around the identified plant (coupled), identified transfer functions "
        "(black), or those with the vibration of a passive joint as output; "
        "without it, the form that predicted held-out data best",
    )
    parser.add_argument("--step", type=float, metavar="S", help="longest internal step (as the loops need)")
    parser.add_argument(
        "--report", metavar="FILE", help="also write a page: predicted beside measured (.html)"
    )
    parser.add_argument("--rrd", metavar="FILE", help="also write a recording for the Rerun viewer (.rrd)")
    add_effects(parser)
    add_common(parser, out="prediction to write (.csv)", required=True, file=True)


def run(args: argparse.Namespace) -> int:
    """Simulate, write, and compare with the log where it was measured."""
    from pinotwin.cli.inputs import read_logs
    from pinotwin.errors import InputError
    from pinotwin.simulation import simulate
    from pinotwin.twin import Twin

    out = Path(args.out)
    if out.suffix != ".csv":
        raise InputError(f"--out: {out.name}: a prediction is written as .csv")
    _check(args)
    began = time.monotonic()
    twin = Twin.load(args.twin)
    (log,) = read_logs([args.log])
    predicted = simulate(twin, log, step=args.step, controller=args.controller)
    predicted.save(out)
    said = _extras(args, predicted, made(began, step=args.step))
    if args.json:
        write_json(args.json, predicted.to_dict())
    for line in summary(predicted.errors):
        say(line)
    for note in predicted.notes:
        say(f"note: {note}")
    say(f"closed loop: {predicted.controller}")
    say(f"{len(predicted)} rows written to {out}")
    for line in said:
        say(line)
    return 0


def _check(args: argparse.Namespace) -> None:
    """Refuse what cannot be written before the work for it is done."""
    check_page(args.report)
    if args.rrd is not None:
        from pinotwin.viewer.rerun import check_recording

        check_recording(args.rrd)


def _extras(args: argparse.Namespace, predicted: Prediction, how: Mapping[str, Any]) -> list[str]:
    """Write the page and the recording that were asked for; return a line about each."""
    said = []
    if args.report is not None:
        from pinotwin.report.simulation import simulation_report

        files = [(beside(args.out, args.report), "the prediction, SI")]
        twin, form = predicted.twin, predicted.controller
        write_text(args.report, simulation_report(twin, predicted.command, predicted, form, files, how))
        said.append(f"page written to {args.report}")
    if args.rrd is not None:
        from pinotwin.viewer.rerun import write_recording

        said.append(write_recording(args.rrd, predicted.twin.machine, predicted.command, predicted))
    return said


def summary(rows) -> list[str]:  # type: ignore[no-untyped-def]
    """Return the table of errors, none where nothing was measured."""
    if not rows:
        return []
    cells = [
        [name, *(_percent(row.get(signal, {}).get(key)) for signal, key in SHOWN)]
        for name, row in rows.items()
    ]
    head = ("axis", "e", "u", "u of std", "e moving", "u moving", "u at rest")
    return [*columns(head, cells), "e tracking error, u effort: RMS error / RMS measured"]


SHOWN = (
    ("e", "nrmse"),
    ("u", "nrmse"),
    ("u", "nrmse_std"),
    ("e", "moving"),
    ("u", "moving"),
    ("u", "resting"),
)
"""Signal and error of each column of the table."""


def _percent(x: float | None) -> str:
    return "-" if x is None or x != x else f"{x:.2%}"
