"""A log wherever one is asked for: an object, a file name, or a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pinotwin.errors import InputError
from pinotwin.log import Log, is_table
from pinotwin.logs.files.reading import read_argument

LogLike = Log | str | Path
"""A log, or the name of its file (``a.csv+b.csv`` joins columns). A pandas table will do as well."""


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
