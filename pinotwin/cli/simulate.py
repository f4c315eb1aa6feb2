"""``pinotwin simulate twin other.csv --out predicted.csv``: a prediction from the command alone."""

from __future__ import annotations

import time
from typing import Any, Literal

from pinotwin.cli.arguments import Answer, CsvFile, File, PageFile
from pinotwin.cli.inputs import check_there, check_twin, read_logs
from pinotwin.cli.output import beside, columns
from pinotwin.notebook import share_cell
from pinotwin.system.stamps import made
from pinotwin.system.writing import write_text


def run(
    twin: str,
    log: str,
    *,
    controller: Literal["coupled", "black", "vibration"] | None = None,
    step: float | None = None,
    report: PageFile | None = None,
    rrd: File | None = None,
    out: CsvFile,
) -> Answer:
    """Simulate, write, and compare with the log where it was measured.

    Args:
        log (LOG): log; only t, *.qr and external loads are used
        controller: identified controllers around the identified plant (coupled), identified transfer functions
            (black), or those with the vibration of a passive joint as output; without it, the form that predicted
            held-out data best
        step (S): longest internal step (as the loops need)
        report (FILE): also write a page: predicted beside measured (.html)
        rrd (FILE): also write a recording for the Rerun viewer (.rrd)
        out (PATH): prediction to write (.csv)
    """
    if rrd is not None:
        from pinotwin.viewer.rerun import check_recording, write_recording

        check_recording(rrd)
    check_twin(twin)
    check_there(log)
    from pinotwin.simulation import simulate
    from pinotwin.twin import Twin

    began = time.monotonic()
    predicted = simulate(Twin.load(twin), *read_logs([log]), step=step, controller=controller)
    predicted.save(out)
    lines = summary(predicted.errors)
    lines += [f"note: {note}" for note in predicted.notes]
    lines += [f"closed loop: {predicted.controller}", f"{len(predicted)} rows written to {out}"]
    if report is not None:
        from pinotwin.report.simulation import simulation_report

        files = [(beside(out, report), "the prediction, SI")]
        write_text(report, simulation_report(predicted, files, made(began, step=step)))
        lines.append(f"page written to {report}")
    if rrd is not None:
        lines.append(write_recording(rrd, predicted.twin.machine, predicted.command, predicted))
    return Answer(lines, predicted.to_dict())


def summary(rows: Any) -> list[str]:
    """Return the table of errors, none where nothing was measured."""
    if not rows:
        return []
    cells = [
        [name, *(share_cell(row.get(signal, {}).get(key)) for signal, key in SHOWN)]
        for name, row in rows.items()
    ]
    head = ("axis", "e", "u", "u of std", "e moving", "u moving", "u at rest")
    return [*columns(head, cells), "e tracking error, u effort: RMS error / RMS measured"]


SHOWN = [x.split() for x in ("e nrmse", "u nrmse", "u nrmse_std", "e moving", "u moving", "u resting")]
"""Signal and error of each column of the table."""
