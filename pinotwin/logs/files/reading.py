"""One door to all formats: choose the reader by content and ending, join files side by side."""

from __future__ import annotations

import importlib
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import InputError, LogError
from pinotwin.log import Log, is_table
from pinotwin.logs.files import isolated
from pinotwin.logs.files.content import Holes, Seen, to_log
from pinotwin.system.writing import as_path

LogLike = Log | str | Path
"""A log, or the name of its file (``a.csv+b.csv`` joins columns). A pandas table will do as well."""

_FORMATS = {  # format -> module of this package, imported on use (h5py, scipy.io are slow), and endings
    "csv": ("text", ".csv .txt .tsv .dat .asc .log .sco"),
    "parquet": ("parquet", ".parquet .pq"),
    "mat": ("mat", ".mat"),
    "hdf5": ("hdf5", ".h5 .hdf5 .hdf"),
    "mcap": ("mcap", ".mcap"),
    "npy": ("npy", ".npy .npz"),
    "json": ("json_text", ".json .jsonl .ndjson"),
    "ros": ("rosbag", ".db3 .bag"),
}
_ENDINGS = {ending: kind for kind, (_, endings) in _FORMATS.items() for ending in endings.split()}

# Read in a process of their own: a damaged file ends or holds up the C libraries behind them.
_ISOLATED = ("mat", "hdf5")

_MAGIC: tuple[tuple[bytes, str], ...] = (
    (b"PAR1", "parquet"),
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MATLAB 7.3", "hdf5"),
    (b"MATLAB 5.0", "mat"),
    (b"\x89MCAP", "mcap"),
    (b"\x93NUMPY", "npy"),
    (b"SQLite format 3\x00", "ros"),
    (b"#ROSBAG", "ros"),
)

_REFUSED = {
    ".xls": "save the sheet as CSV",
    ".xlsx": "save the sheet as CSV",
    ".gz": "unpack it first",
    ".zip": "unpack it first",
    ".pkl": "a pickle can run code; save the signals as CSV or Parquet",
}


def read(*paths: Any, only: str | None = None) -> Log:
    """Read a recording; several files are joined side by side.

    Args:
        paths: CSV/TXT, JSON, Parquet, MAT (v5, v7.3), HDF5, MCAP, ROS bags (also folders), NPY or NPZ,
            of equal length; or pandas DataFrames.
        only: keep only names that begin with this, for a file that holds several clocks.

    Raises:
        LogError: a file cannot be used; the message names it and the remedy.
    """
    return _read(paths, only)


def _read(paths: Sequence[Any], only: str | None = None, seen: Seen | None = None) -> Log:
    if not paths:
        raise LogError("no log file given; name at least one")
    logs = []
    for k, path in enumerate(paths):
        share = None if seen is None else partial(lambda k, done: seen((k + done) / len(paths)), k)
        if is_table(path):
            logs.append(Log.from_pandas(path, f"table {k + 1}" if len(paths) > 1 else "DataFrame"))
        else:
            logs.append(_read_one(as_path(path, "paths"), only, share))
    return logs[0] if len(logs) == 1 else join(logs, [Path(log.source).stem for log in logs])


def read_argument(text: str, seen: Seen | None = None) -> Log:
    """Read what the command line names: a path, or several joined by ``+``; ``seen`` is told the share read."""
    if os.path.exists(text) or "+" not in text:  # of a text that cannot be a name: False
        return _read([text], seen=seen)
    parts = [part.strip() for part in text.split("+")]
    if not all(parts):
        raise LogError(f"{text}: an empty name beside '+'; write a.csv+b.csv")
    return _read(parts, seen=seen)


def as_log(given: Any, name: str = "log") -> Log:
    """Return a log as it is, or of a file, a DataFrame, a mapping of arrays; ``name``, of the argument, is said."""
    if isinstance(given, Log):
        return given
    if isinstance(given, str | Path):
        return read_argument(str(given))
    if is_table(given):
        return Log.from_pandas(given)
    if isinstance(given, Mapping):
        return Log(given)
    raise InputError(
        f"{name}: expected a Log, a file name or a pandas DataFrame, not {type(given).__name__}; arrays: "
        "Log.from_arrays(t, q=q, u=u, axes=names)"
    )


def as_logs(given: Any, name: str = "log") -> list[Log]:
    """Return one log or several as a list; see :func:`as_log`."""
    several = isinstance(given, Sequence) and not isinstance(given, str)
    return [as_log(one, name) for one in given] if several else [as_log(given, name)]


def _read_one(path: Path, only: str | None, seen: Seen | None) -> Log:
    source = str(path)
    if (path / "metadata.yaml").is_file():  # a ROS 2 bag is a folder
        kind, note = "ros", list[str]()
    elif path.is_dir() and len(stored := [p for p in path.iterdir() if p.suffix in (".mcap", ".db3")]) == 1:
        # a bag that lost its metadata.yaml
        return replace(_read_one(stored[0], only, seen), source=source)
    else:
        kind, note = _format(path, _head(path))
    loader = importlib.import_module(f"pinotwin.logs.files.{_FORMATS[kind][0]}")
    if kind in _ISOLATED:
        content = isolated.load(loader.load, path, source)
    elif kind == "csv":
        content = loader.load(path, source, seen)
    else:
        content = loader.load(path, source)
    content.notes[:0] = note
    return to_log(content, source, only)


def _head(path: Path) -> bytes:
    """Return the first bytes of a file that can be read and is not empty."""
    if path.is_dir():
        raise LogError(f"{path}: is a folder; name a log file inside it")
    try:
        if path.exists() and not path.is_file():
            raise LogError(f"{path}: is a device or a pipe; save the log as a file first")
        with path.open("rb") as file:
            head = file.read(512)
    except FileNotFoundError:
        raise LogError(f"{path}: no such file; {_siblings(path)}") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be opened ({error.strerror}); check its access") from None
    if not head:
        raise LogError(f"{path}: is empty; record or export it again")
    return head


def _siblings(path: Path) -> str:
    if not path.parent.is_dir():
        return f"the folder {path.parent} does not exist either"
    names = sorted(p.name for p in path.parent.iterdir() if p.suffix.lower() in _ENDINGS)
    return f"logs in its folder: {', '.join(names[:8]) if names else 'none'}"


def _format(path: Path, head: bytes) -> tuple[str, list[str]]:
    """Return the format and a note when content and ending disagree."""
    ending = path.suffix.lower()
    by_ending = _ENDINGS.get(ending)
    by_content = next((kind for magic, kind in _MAGIC if head.startswith(magic)), None)
    if by_content is None and ending == ".npz" and head.startswith(b"PK"):
        by_content = "npy"
    if by_content and by_ending not in (by_content, None):
        matlab = ending == ".mat" and by_content == "hdf5"
        note = [] if matlab else [f"the content is {by_content}, not what {ending} promises"]
        return by_content, note
    if by_content:
        return by_content, []
    if ending in _REFUSED:
        raise LogError(f"{path}: {ending} files cannot be read; {_REFUSED[ending]}")
    if by_ending is None:
        raise LogError(f"{path}: unknown ending {ending!r}; known: {', '.join(sorted(_ENDINGS))}")
    if by_ending not in ("csv", "json") and not (by_ending == "mat" and head.startswith(b"\x00\x00\x00\x00")):
        raise LogError(
            f"{path}: is not a {by_ending} file although it ends in {ending}; "
            f"it begins with {head[:8]!r}; export it again or correct the ending"
        )
    return by_ending, []


def join(logs: Sequence[Log], stems: Sequence[str]) -> Log:
    """Join logs of equal length side by side; a name in several files gets the file's stem in front."""
    lengths = {log.source: len(log) for log in logs}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise LogError(f"cannot join files of different length (rows: {said}); cut them alike first")
    notes = []
    for log in logs:
        for note in log.notes:
            said = f"{log.source}: {note}"
            notes.append(Holes(said, note.missing) if isinstance(note, Holes) else said)
    shared = _shared_clock(logs)
    if shared:
        notes.append(f"{shared} is the same in all joined files and kept once")
    channels: dict[str, Floats] = {shared: logs[0][shared]} if shared else {}
    counts = Counter(name for log in logs for name in {*log.channels, *log.scalars})
    scalars: dict[str, float] = {}
    units: dict[str, str] = {k: u for k, u in logs[0].units.items() if k == shared}
    for log, stem in zip(logs, stems, strict=True):
        rename = {name: f"{stem}.{name}" if counts[name] > 1 else name for name in counts}
        for name, x in log.channels.items():
            if name == shared:
                continue
            if rename[name] in channels:
                raise LogError(f"{log.source}: {rename[name]!r} is in another joined file as well")
            channels[rename[name]] = x
        scalars.update({rename[name]: value for name, value in log.scalars.items()})
        units.update({rename[k]: u for k, u in log.units.items() if k != shared})
    return Log(channels, "+".join(lengths), scalars, tuple(notes), units)


def _shared_clock(logs: Sequence[Log]) -> str | None:
    """Return the name of the channel that all logs have, that only rises, and that is the same in all of them."""
    common = [name for name in logs[0].channels if all(name in log for log in logs)]
    for name in sorted(common, key=lambda k: k != "t"):
        x = logs[0][name]
        rises = name == "t" or (len(x) > 1 and bool(np.all(np.diff(x) > 0.0)))
        if rises and all(np.array_equal(x, log[name], equal_nan=True) for log in logs):
            return name
    return None
