"""``pinotwin orientation imu.csv --out orientation.csv``: where an IMU points over time."""

from __future__ import annotations

from typing import Literal

from pinotwin.cli.arguments import Answer, LogFile, PageFile
from pinotwin.cli.inputs import check_there, read_logs
from pinotwin.cli.output import beside
from pinotwin.system.writing import write_text

Method = Literal["vqf", "offline", "smoother", "ekf"]


def run(log: str, *, method: Method = "vqf", report: PageFile | None = None, out: LogFile) -> Answer:
    """Find the orientation, write it, and say how far the sensor was inclined.

    Args:
        log (IMULOG): t, gx gy gz [rad/s], ax ay az [m/s²], or with units
        method: vqf: offline VQF by Laidig and Seel (default); offline: our smoother over the whole record, which has
            not won on recordings yet; smoother or ekf: adaptive Kalman filter
        report (FILE): also write a page: angles over time (.html)
        out (PATH): orientation over time (.csv or .parquet)
    """
    check_there(log)
    import numpy as np

    from pinotwin.logs.write import write_log
    from pinotwin.reconstruction.orientation import orientation_of_log

    (given,) = read_logs([log])
    found = orientation_of_log(given, method)
    write_log(out, found.channels())
    low, high = (float(np.degrees(x)) for x in (found.inclination.min(), found.inclination.max()))
    holes = f", {100 * found.missing:.2g} % interpolated over holes" if found.missing else ""
    lines = [
        f"{given.source}: {len(found.t)} rows at {found.rate:.4g} Hz{holes}",
        f"inclination of the sensor's z axis: {low:.2f} to {high:.2f} deg; quaternions written to {out}",
    ]
    if report:
        from pinotwin.report.orientation import orientation_page

        other: Method = "offline" if method == "vqf" else "vqf"  # of another kind: how far do they agree?
        files = [(beside(out, report), "quaternions and inclination over time, SI")]
        page = orientation_page(found, given, method, (other, orientation_of_log(given, other)), files)
        write_text(report, page.html())
        lines.append(f"page written to {report}")
    facts = {
        "log": given.source,
        "method": method,
        "rows": len(found.t),
        "rate": found.rate,
        "missing": found.missing,
        "inclination": {"min": low, "max": high, "unit": "deg"},
    }
    return Answer(lines, facts)
