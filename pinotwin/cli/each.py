"""Many logs, each diagnosed by itself (``pinotwin diagnose TWIN --each LOGS...``): one table at the end.

Every log has a folder below ``--out``, written whole, with a record of what it was made of (``made_of.json``); a later
run works on those without one only. A log that failed is a line of the table and tried again; a full disk ends it all.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pinotwin.cli.arguments import Answer
from pinotwin.cli.each_table import FAILED, Row, Table, answered, failed, lines_of
from pinotwin.cli.inputs import distinct, files_of
from pinotwin.cli.progress import progress
from pinotwin.errors import InputError, OutputError
from pinotwin.system.threads import one_blas_thread
from pinotwin.system.writing import alone_in, check_folder, sweep, whole_folder, write_json, write_text

RECORD = "made_of.json"
ENDINGS = (  # endings of the files that a folder among the logs stands for
    *(".csv", ".tsv", ".dat", ".asc", ".parquet", ".pq", ".mat", ".h5", ".hdf5", ".hdf"),
    *(".mcap", ".npy", ".npz", ".jsonl", ".ndjson", ".db3", ".bag"),
)

Fill = Callable[[Path], list[str]]  # writes a result into a folder; returns what went wrong with its picture
Work = Callable[[str, "Asked"], tuple[Mapping[str, Any], Fill]]
"""Diagnoses the log that is named: the content of diagnosis.json, and what fills the log's folder."""


@dataclass(frozen=True)
class Asked:
    """What is asked of every log; the attributes are the options of ``diagnose``."""

    subject: str
    validate: tuple[str, ...]
    resample: float | None
    meshes: str | None
    options: Mapping[str, Any]  # of pinotwin.diagnose
    effects: tuple[str, ...] = ()


@dataclass(frozen=True)
class Job:
    """One log: as it was named, where its result goes, and what that is made of."""

    log: str
    folder: Path
    made_of: str


def each_answered(
    logs: Sequence[str], asked: Asked, work: Work, out: Path, *, workers: int | None, fail_on_gap: bool
) -> Answer:
    """Diagnose every log (or those in a folder) by itself; return table lines, content and the exit code."""
    if workers is not None and workers < 1:
        raise InputError(f"--workers: {workers}: must be at least 1")
    started = time.monotonic()
    jobs = jobs_of(logs, asked, out)
    for job in jobs:
        check_folder(job.folder)
    with alone_in(out):
        for job in jobs:
            sweep(job.folder)
        kept = {job.log: row for job in jobs if (row := known_answer(job)) is not None}
        one = functools.partial(do_job, work=work, asked=asked)
        with Table(out, asked.subject, [job.log for job in jobs], kept) as table:
            _do([job for job in jobs if job.log not in kept], one, table, workers)
    document = table.document()
    from pinotwin.report.days import days_report

    write_text(out / "each.html", days_report(document, out))
    lines = lines_of(document, time.monotonic() - started)
    last = f"written to {out}: each.html, each.csv, each.json and a folder for every log; open {out / 'each.html'}"
    return Answer([*lines, last], document, _code(document["logs"], fail_on_gap, out))


def _do(left: Sequence[Job], one: Callable[[Job], dict[str, Any]], table: Table, workers: int | None) -> None:
    """Do what is left to do, a line of the table for each."""
    from pinotwin.bench.engine import engine

    if not left:
        return
    count = min(workers or os.cpu_count() or 1, len(left))
    with progress() as report, engine(count, apart=True) as each:
        report(*table.progress())
        for job, row in each(one, left, None):
            if isinstance(row, OutputError):
                raise row
            table.add(failed(job.log, row) if isinstance(row, BaseException) else row)
            report(*table.progress())


def jobs_of(given: Sequence[str], asked: Asked, out: Path) -> list[Job]:
    """Return what is to be diagnosed, one job a log, in the order given."""
    logs = list(dict.fromkeys(log for one in given for log in logs_in(one)))
    common = _made_of(asked)
    return [
        Job(log, out / name, hashlib.sha256(f"{common} {_digest(log)}".encode()).hexdigest())
        for log, name in zip(logs, distinct(map(_path, logs), "_"), strict=True)
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


def _path(log: str) -> list[str]:
    """Return the folders of a log, and what its own folder is called by: the stems of its files."""
    first, *others = map(Path, files_of(log))
    return [*first.absolute().parts[1:-1], "_".join([first.stem, *(p.stem for p in others)])]


def _made_of(asked: Asked) -> str:
    """Return a digest of all that the results have in common: code, twin or machine, options, validation."""
    from pinotwin.bench.fingerprint import fingerprint

    digest = hashlib.sha256(fingerprint().encode())
    given = Path(asked.subject)
    if given.exists():
        near = [given]
        if not given.is_dir():
            near += [*given.parent.glob("*.yaml"), *given.parent.glob("*.urdf")]
        digest.update(" ".join(_digest(str(path)) for path in sorted(near)).encode())
    else:
        digest.update(asked.subject.encode())  # the name of a machine that pinotwin brings
    for log in (*asked.validate, *asked.effects):
        digest.update(_digest(log).encode())
    options = [asked.resample, asked.meshes, asked.options]
    digest.update(json.dumps(options).encode())
    return digest.hexdigest()


def _digest(log: str) -> str:
    """Return a digest of the contents of a log's files, or of all files in a folder."""
    digest = hashlib.sha256()
    for path in map(Path, files_of(log)):
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
            return answered(job.log, job.folder, found, float(record["seconds"]))
    except (OSError, ValueError, LookupError, TypeError):
        pass
    return None


@one_blas_thread
def do_job(job: Job, *, work: Work, asked: Asked) -> dict[str, Any]:
    """Diagnose one log (in a worker) and return its line of the table."""
    from pinotwin.report.saved import REPLACES

    start = time.perf_counter()
    found, fill = work(job.log, asked)
    with whole_folder(job.folder, replaces=REPLACES) as folder:
        fill(folder)
        seconds = time.perf_counter() - start
        record = {"log": job.log, "made_of": job.made_of, "seconds": seconds, "asked": asdict(asked)}
        write_json(folder / RECORD, record)
    return answered(job.log, job.folder, found, seconds)


def _code(table: Sequence[Row], fail_on_gap: bool, out: Path) -> int:
    """Return the exit code; what ends in 2 has its line on stderr, as everywhere."""
    bad = sum(row["verdict"] == FAILED for row in table)
    if bad:
        sys.stderr.write(
            f"pinotwin: {bad} of {len(table)} logs could not be diagnosed: see {out / 'each.csv'}\n"
        )
        return 2
    return 1 if fail_on_gap and {row["verdict"] for row in table} != {"none"} else 0
