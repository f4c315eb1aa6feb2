"""``pinotwin study trunnion log.csv --only amount --out study``: the source's studies on a machine and its logs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pinotwin.cli.arguments import Answer, Folder, Several
from pinotwin.cli.inputs import check_there, numbers, read_logs
from pinotwin.cli.progress import progress
from pinotwin.errors import InputError

Kinds = Annotated[Sequence[Literal["amount", "coupling", "without", "overlay", "errors"]], "+"]


def run(
    subject: str,
    logs: Several,
    *,
    only: Kinds = (),
    axis: Several = (),
    window: str | None = None,
    out: Folder,
) -> Answer:
    """Make the studies and write page and tables.

    Args:
        subject (TWIN|MACHINE): a twin, or a machine to make one of from the logs
        logs (LOG): servo log(s)
        only (STUDY): of amount, coupling, without, overlay, errors; all without
        axis (AXIS): these axes; all without
        window (LOW,HIGH): seconds of the first log in which the tracking error is split by cause
        out (PATH): folder for study.html and a CSV file per study
    """
    check_there(*logs)
    from pinotwin.twin.twin import as_subject

    given = as_subject(subject)
    from pinotwin.report.study import study

    span = None
    if window is not None:
        low, high = numbers("window", window, "LOW,HIGH in seconds", 2)
        if not low < high:
            raise InputError(f"--window: {low:g} is not before {high:g}")
        span = low, high
    with progress() as report:
        found = study(given, read_logs(logs), only=only, axes=axis, window=span, report=report)
        found.save(out)
    lines = [f"{name}: {one.finding} ({len(one.rows)} rows)" for name, one in found.studies.items()]
    lines += [f"left out: {line}" for line in found.left_out]
    return Answer([*lines, f"studies written to {out}"], found.to_dict())
