"""Many logs, each diagnosed by itself (``pinotwin diagnose TWIN --each LOGS...``): one table at the end.

Every log has a folder of its own below ``--out``, written whole or not at all, with a record of what it was
made of (``made_of.json``). A run that was interrupted, or that is given more logs, works on those without
such a record only; a log that could not be diagnosed has none, is one line of the table, and is tried again.
"""

from __future__ import annotations

import argparse
import csv
import functools
import hashlib
import io
import json
import os
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pinotwin.cli.output import say, write_json
from pinotwin.cli.progress import progress
from pinotwin.errors import InputError, PinotwinError
from pinotwin.threads import one_blas_thread
from pinotwin.writing import whole_folder, write_text

RECORD = "made_of.json"
FAILED = "failed"
COLUMNS = ("log", "verdict", "signal", "gap", "after", "misfit", "causes", "seconds", "folder", "error")
"""Columns of the table as CSV."""
ENDINGS = (
    *(".csv", ".tsv", ".dat", ".asc", ".parquet", ".pq", ".mat", ".h5", ".hdf5", ".hdf"),
    *(".mcap", ".npy", ".npz", ".jsonl", ".ndjson", ".db3", ".bag"),
)
"""Endings of the files that a folder among the logs stands for."""

REPLACES = ("machine", "advice_*.csv")
"""What of an earlier result goes, if the new one has none of it."""

Fill = Callable[[Path], list[str]]
"""Writes a result into a folder; returns what went wrong with its picture."""
Work = Callable[[str, "Asked"], tuple[Mapping[str, Any], Fill]]
"""Diagnoses the log that is named: the content of diagnosis.json, and what fills the log's folder."""


@dataclass(frozen=True)
class Asked:
    """What is asked of every log; the attributes are the options of ``diagnose``."""

    subject: str
    validate: tuple[str, ...]
    resample: float | None
    quick: bool
    seed: int
    meshes: str | None

    def elsewhere(self) -> Asked:
        """Return the same with absolute paths, for workers that stand in another folder."""
        return replace(
            self,
            subject=_absolute(self.subject),
            validate=tuple(map(_absolute, self.validate)),
            meshes=None if self.meshes is None else _absolute(self.meshes),
        )


@dataclass(frozen=True)
class Job:
    """One log: as it was named, where its result goes, and what that is made of."""

    log: str
    folder: Path
    made_of: str


def run_each(args: argparse.Namespace, work: Work) -> int:
    """Diagnose every log by itself, write the table, and return the exit code.

    Args:
        args: of ``diagnose``.
        work: the diagnosis of one log.
    """
    from pinotwin.bench.engine import engine

    if args.workers is not None and args.workers < 1:
        raise InputError(f"--workers: {args.workers}: must be at least 1")
    started = time.monotonic()
    out = Path(args.out)
    asked = Asked(args.subject, tuple(args.validate), args.resample, args.quick, args.seed, args.meshes)
    if args.scheduler is not None:
        asked, out = asked.elsewhere(), out.absolute()
    jobs = jobs_of(args, asked, out)
    rows = {job.log: row for job in jobs if (row := known_answer(job)) is not None}
    kept, left = len(rows), [job for job in jobs if job.log not in rows]
    with progress() as report:
        report(f"{kept} of {len(jobs)} logs", kept / len(jobs))
        if left:
            workers = min(args.workers or os.cpu_count() or 1, len(left))
            with engine(workers, args.scheduler, apart=True) as each:
                for job, row in each(functools.partial(do_job, work=work, asked=asked), left, None):
                    rows[job.log] = failed_row(job, row) if isinstance(row, BaseException) else row
                    report(f"{len(rows)} of {len(jobs)} logs", len(rows) / len(jobs))
    table = [rows[job.log] for job in jobs]
    document = {
        "subject": args.subject,
        "counts": dict(Counter(row["verdict"] for row in table)),
        "kept_of_an_earlier_run": kept,
        "logs": table,
    }
    write_json(out / "each.json", document)
    write_text(out / "each.csv", _csv(table))
    if args.json:
        write_json(args.json, document)
    for line in _lines(table, kept, time.monotonic() - started):
        say(line)
    say(f"table written to {out / 'each.csv'} and each.json; a folder for every log beside them")
    return _code(table, args.fail_on_gap)


def jobs_of(args: argparse.Namespace, asked: Asked, out: Path) -> list[Job]:
    """Return what is to be diagnosed, one job a log, in the order given."""
    logs = list(dict.fromkeys(log for given in args.logs for log in logs_in(given)))
    if args.scheduler is not None:
        logs = [_absolute(log) for log in logs]
    common = _made_of(asked)
    return [
        Job(log, out / name, hashlib.sha256(f"{common} {_digest(log)}".encode()).hexdigest())
        for log, name in zip(logs, _names(logs), strict=True)
    ]


def logs_in(given: str) -> list[str]:
    """Return the logs that an argument stands for: itself, or those in a folder."""
    folder = Path(given)
    if not folder.is_dir() or (folder / "metadata.yaml").is_file():  # a ROS 2 bag is one log
        return [given]
    inside = sorted(
        p for p in folder.iterdir() if p.suffix.lower() in ENDINGS or (p / "metadata.yaml").is_file()
    )
    if not inside:
        raise InputError(f"{given}: no logs in this folder; known endings: {', '.join(ENDINGS)}")
    return [str(path) for path in inside]


def _parts(log: str) -> list[Path]:
    """Return the files of a log; ``a.csv+b.csv`` names two."""
    whole = Path(log)
    return [whole] if whole.exists() or "+" not in log else [Path(p.strip()) for p in log.split("+")]


def _absolute(text: str) -> str:
    parts = _parts(text)
    return "+".join(str(p.absolute()) for p in parts) if all(p.exists() for p in parts) else text


def _names(logs: Sequence[str]) -> list[str]:
    """Return the name of each log's folder: its stem, with the names of its folders where two have one."""
    depth = [0] * len(logs)
    names = [_name(log, 0) for log in logs]
    for _ in range(20):
        # the file system may not tell capitals, and `each.csv` is the table's
        count = Counter(name.casefold() for name in names)
        again = [k for k, name in enumerate(names) if count[name.casefold()] > 1]
        if not again:
            return names
        for k in again:
            depth[k] += 1
            names[k] = _name(logs[k], depth[k])
    return [f"{name}_{k + 1}" for k, name in enumerate(names)]


def _name(log: str, depth: int) -> str:
    first, *others = _parts(log)
    folders = [p for p in first.absolute().parts[1:-1]][::-1][:depth][::-1]
    name = "_".join([*folders, first.stem, *(p.stem for p in others)])[:120]
    return name.lstrip(".") or "log"


def _made_of(asked: Asked) -> str:
    """Return a digest of all that the results have in common: code, twin or machine, options, validation."""
    from pinotwin.bench.fingerprint import fingerprint

    digest = hashlib.sha256(fingerprint().encode())
    given = Path(asked.subject)
    if given.exists():
        near = (
            [given] if given.is_dir() else [*given.parent.glob("*.yaml"), *given.parent.glob("*.urdf"), given]
        )
        digest.update(" ".join(_digest(str(path)) for path in sorted(near)).encode())
    for log in asked.validate:
        digest.update(_digest(log).encode())
    else:
        digest.update(asked.subject.encode())  # the name of a machine that pinotwin brings
    digest.update(json.dumps([asked.resample, asked.quick, asked.seed]).encode())
    return digest.hexdigest()


def _digest(log: str) -> str:
    """Return a digest of the contents of a log's files, or of all files in a folder."""
    digest = hashlib.sha256()
    for path in _parts(log):
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            try:
                with file.open("rb") as stream:
                    digest.update(hashlib.file_digest(stream, "sha256").digest())
            except OSError:
                digest.update(b"unreadable")  # its reader says why
    return digest.hexdigest()


def known_answer(job: Job) -> dict[str, Any] | None:
    """Return the line of a log that was diagnosed before, from the same files and with the same options."""
    try:
        record = json.loads((job.folder / RECORD).read_text(encoding="utf-8"))
        found = json.loads((job.folder / "diagnosis.json").read_text(encoding="utf-8"))
        if record["made_of"] == job.made_of:
            return _row(job, found, float(record["seconds"]))
    except (OSError, ValueError, LookupError, TypeError):
        pass
    return None


@one_blas_thread
def do_job(job: Job, *, work: Work, asked: Asked) -> dict[str, Any]:
    """Diagnose one log (in a worker) and return its line of the table."""
    start = time.perf_counter()
    found, fill = work(job.log, asked)
    with whole_folder(job.folder, replaces=REPLACES) as folder:
        fill(folder)
        seconds = time.perf_counter() - start
        record = {"log": job.log, "made_of": job.made_of, "seconds": seconds, "asked": asdict(asked)}
        write_json(folder / RECORD, record)
    return _row(job, found, seconds)


def _row(job: Job, found: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """Return the line of a log: its verdict, the signal that differs most, and the causes."""
    signals = [(f"{axis}.{name}", gap) for axis, row in found["gap"].items() for name, gap in row.items()]
    signal, gap = max(signals, key=lambda one: one[1]["nrmse"] or 0.0) if signals else ("", {})
    return {
        "log": job.log,
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
        "folder": str(job.folder),
        "error": None,
    }


def _of_signal(gap: Mapping[str, Any], name: str) -> float | None:
    """Return another RMS of the gap as a share of its signal's, as ``nrmse`` is one."""
    value, rms, share = gap.get(name), gap.get("rms"), gap.get("nrmse")
    return value * share / rms if value is not None and rms and share else None


def failed_row(job: Job, error: BaseException) -> dict[str, Any]:
    """Return the line of a log whose diagnosis ended in an error; an unforeseen one keeps its traceback."""
    blank = dict.fromkeys(("signal", "gap", "after", "misfit", "seconds", "folder"))
    row: dict[str, Any] = {
        "log": job.log,
        "verdict": FAILED,
        **blank,
        "causes": [],
        "gaps": {},
        "error": str(error),
    }
    if isinstance(error, PinotwinError):
        return row
    if type(error).__name__ == "KilledWorker":
        why = "its worker died several times: too little memory (fewer --workers), or a crash on this log"
        return {**row, "error": why}
    text = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    return {**row, "error": text, "traceback": "".join(traceback.format_exception(error))}


def _csv(table: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in table:
        flat = {**row, "causes": _causes(row)}
        writer.writerow("" if flat[name] is None else flat[name] for name in COLUMNS)
    return text.getvalue()


def _causes(row: Mapping[str, Any]) -> str:
    return "; ".join(f"{c['axis'] or 'machine'}.{c['effect']} {c['confidence']:.0%}" for c in row["causes"])


def _lines(table: Sequence[Mapping[str, Any]], kept: int, seconds: float) -> list[str]:
    """Return the table as text: one line a log, the counts last."""
    names = [_shown(row["log"]) for row in table]
    wide = max(map(len, [*names, "log"]))
    head = f"{'log':<{wide}}  {'verdict':<16}  {'signal':<8}{'gap':>8}{'after':>8}{'misfit':>8}  causes"
    lines = [head]
    for name, row in zip(names, table, strict=True):
        start = f"{name:<{wide}}  {row['verdict']:<16}  "
        if row["verdict"] == FAILED:
            lines.append(f"{start}{row['error']}")
            continue
        numbers = "".join(
            f"{'-' if row[k] is None else format(row[k], '.1%'):>8}" for k in ("gap", "after", "misfit")
        )
        lines.append(f"{start}{row['signal']:<8}{numbers}  {_causes(row) or '-'}")
    count = ", ".join(f"{n} {verdict}" for verdict, n in Counter(r["verdict"] for r in table).items())
    before = f" ({kept} of an earlier run)" if kept else ""
    return [*lines, f"{len(table)} logs{before}: {count}; {seconds:.0f} s"]


def _shown(log: str) -> str:
    return log if len(log) <= 48 else f"...{log[-45:]}"


def _code(table: Sequence[Mapping[str, Any]], fail_on_gap: bool) -> int:
    verdicts = {row["verdict"] for row in table}
    if FAILED in verdicts:
        return 2
    return 1 if fail_on_gap and verdicts != {"none"} else 0
