"""``pinotwin orientation IMULOG --out ORIENTATION.csv``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import numpy as np

from pinotwin.cli.inputs import read_logs
from pinotwin.cli.output import add_common, beside, check_page, say, write_json
from pinotwin.system.writing import write_text

if TYPE_CHECKING:
    from pinotwin.imu.orientation import Method
    from pinotwin.log import Log
    from pinotwin.reconstruction.orientation import Orientation

_METHODS = ("vqf", "offline", "smoother", "ekf")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("log", metavar="IMULOG", help="t, gx gy gz [rad/s], ax ay az [m/s²], or with units")
    parser.add_argument(
        "--method",
        choices=_METHODS,
        default="vqf",
        help="vqf: offline VQF by Laidig and Seel (default); offline: our smoother over the whole record, which "
        "has not won on recordings yet; smoother or ekf: adaptive Kalman filter",
    )
    parser.add_argument("--report", metavar="FILE", help="also write a page: angles over time (.html)")
    add_common(parser, out="orientation over time (.csv or .parquet)", required=True, file=True)


def run(args: argparse.Namespace) -> int:
    """Find the orientation, write it, and say how far the sensor was inclined."""
    from pinotwin.errors import InputError
    from pinotwin.logs.write import write_log
    from pinotwin.reconstruction.orientation import orientation_of_log

    if not str(args.out).endswith((".csv", ".parquet")):
        raise InputError(f"--out: {args.out}: a log ends in .csv or .parquet")
    check_page(args.report)
    (log,) = read_logs([args.log])
    found = orientation_of_log(log, args.method)
    write_log(args.out, found.channels())
    low, high = (float(np.degrees(x)) for x in (found.inclination.min(), found.inclination.max()))
    if args.report:
        _write_page(args, log, found)
    if args.json:
        facts = {
            "log": log.source,
            "method": args.method,
            "rows": len(found.t),
            "rate": found.rate,
            "missing": found.missing,
            "inclination": {"min": low, "max": high, "unit": "deg"},
        }
        write_json(args.json, facts)
    holes = f", {100 * found.missing:.2g} % interpolated over holes" if found.missing else ""
    say(f"{log.source}: {len(found.t)} rows at {found.rate:.4g} Hz{holes}")
    say(f"inclination of the sensor's z axis: {low:.2f} to {high:.2f} deg; quaternions written to {args.out}")
    if args.report:
        say(f"page written to {args.report}")
    return 0


def _write_page(args: argparse.Namespace, log: Log, found: Orientation) -> None:
    """Write the page; a second method of another kind on the same log tells how far they agree."""
    from pinotwin.reconstruction.orientation import orientation_of_log
    from pinotwin.report.orientation import orientation_page

    other: Method = "offline" if args.method == "vqf" else "vqf"
    files = [(beside(args.out, args.report), "quaternions and inclination over time, SI")]
    page = orientation_page(found, log, args.method, (other, orientation_of_log(log, other)), files)
    write_text(args.report, page.html())
