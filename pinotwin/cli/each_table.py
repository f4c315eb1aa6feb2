"""The table of ``pinotwin diagnose --each``: one row a log, as JSON, as CSV and on the terminal.

A verdict comes from the answer in its log's folder alone, whenever the command is killed: both forms are written whole
before the work begins and at its end, an answer in between is a line more of the CSV.
"""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from pinotwin.bench.engine import KilledWorker
from pinotwin.cli.output import columns
from pinotwin.errors import OutputError, PinotwinError
from pinotwin.system.writing import append_text, csv_text, write_json, write_text

FAILED = "failed"
WAITING = "waiting"
COLUMNS = ("log", "verdict", "signal", "gap", "after", "misfit", "causes", "seconds", "folder", "error")
"""Columns of the table as CSV."""

Row = Mapping[str, Any]


class Table:
    """The table while it grows."""

    def __init__(self, out: Path, subject: str, logs: Sequence[str], kept: Mapping[str, Row]) -> None:
        """Take the names of all logs, in the order given, and log -> row of an earlier run."""
        self.out, self.subject, self.logs = out, subject, logs
        self.kept, self.rows = len(kept), dict(kept)

    def __enter__(self) -> Table:
        self._write(self.rows.values())
        return self

    def _write(self, rows: Iterable[Row]) -> None:
        """Write both forms, as CSV these rows."""
        write_json(self.out / "each.json", self.document())
        write_text(self.out / "each.csv", csv_text([COLUMNS, *map(_cells, rows)]))

    def add(self, row: Row) -> None:
        """Take the row of an answer that is in its folder."""
        self.rows[row["log"]] = row
        append_text(self.out / "each.csv", csv_text([_cells(row)]))

    def progress(self) -> tuple[str, float]:
        """Return how many rows there are, in words and as a share."""
        return f"{len(self.rows)} of {len(self.logs)} logs", len(self.rows) / len(self.logs)

    def document(self) -> dict[str, Any]:
        """Return the table as JSON has it."""
        rows = [self.rows.get(log) or _without_answer(log, WAITING, None) for log in self.logs]
        counts = dict(Counter(row["verdict"] for row in rows))
        return {"subject": self.subject, "counts": counts, "kept_of_an_earlier_run": self.kept, "logs": rows}

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            self._write(self.document()["logs"])
        except OutputError:
            if error is None:  # else the first trouble is the one to tell
                raise


def answered(log: str, folder: Path, found: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """Return the row of an answer, of diagnosis.json: its verdict, the signal that differs most, and the causes."""
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
            {k: e.get(k) for k in ("axis", "effect", "confidence", "size", "sizes")} for e in found["effects"]
        ],
        "gaps": found["gap"],
        "state": found.get("state", {}),
        "sentence": found.get("sentence", ""),
        "situation": found.get("situation", "change"),
        "seconds": round(seconds, 2),
        "folder": str(folder),
        "error": None,
    }


def _of_signal(gap: Mapping[str, Any], name: str) -> float | None:
    """Return another RMS of the gap as a share of its signal's, as ``nrmse`` is one."""
    value, rms, share = gap.get(name), gap.get("rms"), gap.get("nrmse")
    return value * share / rms if value is not None and rms and share else None


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
    said = {"sentence": "", "situation": "", "state": {}}
    return {"log": log, "verdict": verdict, **blank, "causes": [], "gaps": {}, **said, "error": error}


def _cells(row: Row) -> list[Any]:
    flat = {**row, "causes": _causes(row)}
    return ["" if flat[name] is None else flat[name] for name in COLUMNS]


def _causes(row: Row) -> str:
    return "; ".join(f"{c['axis'] or 'machine'}.{c['effect']} {c['confidence']:.0%}" for c in row["causes"])


def lines_of(document: Mapping[str, Any], seconds: float) -> list[str]:
    """Return the table as text: one line a log, the counts last."""
    table, kept = document["logs"], document["kept_of_an_earlier_run"]
    head = ("log", "verdict", "signal", "residual", "with causes", "validation", "causes")
    rows = []
    for row in table:
        sizes = ["-" if row[k] is None else f"{row[k]:.1%}" for k in ("gap", "after", "misfit")]
        last = row["error"] or _causes(row) or "-"
        name = row["log"] if len(row["log"]) <= 48 else f"...{row['log'][-45:]}"
        rows.append([name, row["verdict"], row["signal"] or "-", *sizes, last])
    lines = columns(head, rows, left=(0, 1, 2, 6), piped=1000)  # a line a log
    count = ", ".join(f"{n} {verdict}" for verdict, n in document["counts"].items())
    before = f" ({kept} of an earlier run)" if kept else ""
    return [*lines, f"{len(table)} logs{before}: {count}; {seconds:.0f} s"]
