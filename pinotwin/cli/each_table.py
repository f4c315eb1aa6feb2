"""The table of ``pinotwin diagnose --each``: one row a log, as JSON, as CSV and on the terminal.

A row with a verdict is made of the answer in its log's folder and of nothing else. So that this holds whenever
the command is killed, a log that is to be worked on says ``waiting`` before the work begins, and gets its verdict
after its folder is in place.
"""

from __future__ import annotations

import csv
import io
import traceback
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pinotwin.bench.engine import KilledWorker
from pinotwin.cli.output import write_json
from pinotwin.errors import PinotwinError
from pinotwin.system.writing import write_text

FAILED = "failed"
WAITING = "waiting"
COLUMNS = ("log", "verdict", "signal", "gap", "after", "misfit", "causes", "seconds", "folder", "error")
"""Columns of the table as CSV."""

Row = Mapping[str, Any]


def write_table(out: Path, document: Mapping[str, Any]) -> None:
    """Write the table in its two forms, each whole or not at all."""
    write_json(out / "each.json", document)
    write_text(out / "each.csv", _csv(document["logs"]))


def document_of(subject: str, table: Sequence[Row], kept: int) -> dict[str, Any]:
    """Return the table as JSON has it.

    Args:
        subject: the twin or machine, as it was named.
        table: a row a log.
        kept: how many rows are of an earlier run.
    """
    counts = dict(Counter(row["verdict"] for row in table))
    return {"subject": subject, "counts": counts, "kept_of_an_earlier_run": kept, "logs": list(table)}


def answered(log: str, folder: Path, found: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """Return the row of an answer: its verdict, the signal that differs most, and the causes.

    Args:
        log: as it was named.
        folder: where its answer is.
        found: the content of diagnosis.json.
        seconds: that the diagnosis took.
    """
    signals = [(f"{axis}.{name}", gap) for axis, row in found["gap"].items() for name, gap in row.items()]
    signal, gap = max(signals, key=lambda one: one[1]["nrmse"] or 0.0) if signals else ("", {})
    return {
        "log": log,
        "verdict": found["verdict"],
        "signal": signal,
        "gap": gap.get("nrmse"),
        "after": _of_signal(gap, "after"),
        "misfit": _of_signal(gap, "misfit"),
        "causes": [
            {"axis": e["axis"], "effect": e["effect"], "confidence": e["confidence"], "size": e["size"]}
            for e in found["effects"]
        ],
        "gaps": found["gap"],
        "seconds": round(seconds, 2),
        "folder": str(folder),
        "error": None,
    }


def _of_signal(gap: Mapping[str, Any], name: str) -> float | None:
    """Return another RMS of the gap as a share of its signal's, as ``nrmse`` is one."""
    value, rms, share = gap.get(name), gap.get("rms"), gap.get("nrmse")
    return value * share / rms if value is not None and rms and share else None


def waiting(log: str) -> dict[str, Any]:
    """Return the row of a log that is not answered yet."""
    return _without_answer(log, WAITING, None)


def failed(log: str, error: BaseException) -> dict[str, Any]:
    """Return the row of a log whose diagnosis ended in an error; an unforeseen one keeps its traceback."""
    if isinstance(error, PinotwinError):
        return _without_answer(log, FAILED, str(error))
    if isinstance(error, KilledWorker):
        why = "its worker died several times: too little memory (fewer --workers), or a crash on this log"
        return _without_answer(log, FAILED, why)
    text = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    trace = "".join(traceback.format_exception(error))
    return {**_without_answer(log, FAILED, text), "traceback": trace}


def _without_answer(log: str, verdict: str, error: str | None) -> dict[str, Any]:
    blank = dict.fromkeys(("signal", "gap", "after", "misfit", "seconds", "folder"))
    return {"log": log, "verdict": verdict, **blank, "causes": [], "gaps": {}, "error": error}


def _csv(table: Sequence[Row]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in table:
        flat = {**row, "causes": _causes(row)}
        writer.writerow("" if flat[name] is None else flat[name] for name in COLUMNS)
    return text.getvalue()


def _causes(row: Row) -> str:
    return "; ".join(f"{c['axis'] or 'machine'}.{c['effect']} {c['confidence']:.0%}" for c in row["causes"])


def lines_of(table: Sequence[Row], kept: int, seconds: float) -> list[str]:
    """Return the table as text: one line a log, the counts last."""
    names = [_shown(row["log"]) for row in table]
    wide = max(map(len, [*names, "log"]))
    columns = f"{'residual':>10}{'with causes':>13}{'validation':>12}  causes"
    lines = [f"{'log':<{wide}}  {'verdict':<16}  {'signal':<8}{columns}"]
    for name, row in zip(names, table, strict=True):
        start = f"{name:<{wide}}  {row['verdict']:<16}  "
        if row["verdict"] == FAILED:
            lines.append(f"{start}{row['error']}")
            continue
        sizes = ["-" if row[k] is None else f"{row[k]:.1%}" for k in ("gap", "after", "misfit")]
        numbers = "{:>10}{:>13}{:>12}".format(*sizes)
        lines.append(f"{start}{row['signal']:<8}{numbers}  {_causes(row) or '-'}")
    count = ", ".join(f"{n} {verdict}" for verdict, n in Counter(r["verdict"] for r in table).items())
    before = f" ({kept} of an earlier run)" if kept else ""
    return [*lines, f"{len(table)} logs{before}: {count}; {seconds:.0f} s"]


def _shown(log: str) -> str:
    return log if len(log) <= 48 else f"...{log[-45:]}"
