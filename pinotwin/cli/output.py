"""What the commands share: JSON files, what ``--out`` and ``--json`` name, lines of the result."""

from __future__ import annotations

import argparse
import os
import re
import shutil
import sys
import textwrap
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pinotwin.errors import InputError
from pinotwin.system.writing import check_file, check_folder, now
from pinotwin.system.writing import write_json as write_json


def add_common(
    parser: argparse.ArgumentParser, *, out: str | None, required: bool = False, file: bool = False
) -> None:
    """Add ``--json`` and, with ``out`` as its help, ``--out``.

    Args:
        parser: of the command.
        out: help of ``--out``.
        required: whether the command cannot do without.
        file: whether ``--out`` names a file, not a folder.
    """
    parser.add_argument("--json", metavar="FILE", help="write the machine-readable result here")
    if out is not None:
        parser.add_argument("--out", metavar="PATH", required=required, help=out)
        parser.set_defaults(out_is_file=file)


def check_outputs(args: argparse.Namespace) -> None:
    """Refuse results that cannot be written before the work for them is done."""
    for name in ("json", "html", "report", "rrd"):
        value = getattr(args, name, None)
        if isinstance(value, str):
            check_file(value)
    if isinstance(getattr(args, "out", None), str):
        (check_file if getattr(args, "out_is_file", False) else check_folder)(args.out)


def check_page(path: str | None) -> None:
    """Refuse a page of another ending than a browser knows."""
    if path is not None and Path(path).suffix not in (".html", ".htm"):
        raise InputError(f"--report: {Path(path).name}: a page is written as .html")


def made(began: float, **options: Any) -> dict[str, Any]:
    """Return date, time taken and options of a command, for the foot of its page.

    Args:
        began: ``time.monotonic()`` at its beginning.
        options: as they were given; those that were not are left out.
    """
    return {**stamp(began), "options": {k: v for k, v in options.items() if v is not None}}


def stamp(began: float) -> dict[str, Any]:
    """Return the date, and the time taken since ``time.monotonic()`` was ``began``."""
    return {
        "date": now(),
        "seconds_taken": round(time.monotonic() - began, 1),
    }


def beside(path: str, page: str) -> str:
    """Return the link from a page to a file."""
    return Path(os.path.relpath(path, Path(page).resolve().parent)).as_posix()


def columns(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: Sequence[int] = (0,)) -> list[str]:
    """Return a table as lines; every column as wide as its widest cell, two blanks between.

    Where that is wider than the terminal (80 characters in a pipe), long names in the first column stand on a
    line of their own.

    Args:
        head: title of each column.
        rows: cells.
        left: columns aligned to the left; the others are numbers.
    """
    most = width() or 80
    every = [list(head), *map(list, rows)]
    wide = [max(len(row[k]) for row in every) for k in range(len(head))]
    if sum(wide) + 2 * (len(wide) - 1) > most:
        rest = sum(wide[1:]) + 2 * (len(wide) - 1)
        wide[0] = max(len(head[0]), min(wide[0], most - rest))
    lines = []
    for row in every:
        if len(row[0]) > wide[0]:
            lines.append(row[0])
            row[0] = ""
        cells = [
            c.ljust(w) if k in left else c.rjust(w) for k, (c, w) in enumerate(zip(row, wide, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return lines


def width() -> int | None:
    """Return the columns of the terminal, or what COLUMNS says; None in a pipe, whose lines stay whole."""
    if not (sys.stdout.isatty() or os.environ.get("COLUMNS")):
        return None
    return max(40, min(shutil.get_terminal_size((80, 24)).columns, 120))


def say(text: str = "") -> None:
    """Print a line of the command's result; on a terminal wrapped at blanks, what follows below its text."""
    columns = width()
    if columns is None or len(text) <= columns:
        sys.stdout.write(text + "\n")
        return
    label = re.match(r" *(?:[a-z]{1,10}: |[a-z]{4,8} +)?", text)
    indent = " " * min(len(label.group()) if label else 0, 12)
    lines = textwrap.wrap(
        text, columns, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    sys.stdout.write("\n".join(lines) + "\n")
