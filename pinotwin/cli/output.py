"""What the commands share: links between files, lines and tables on the terminal."""

from __future__ import annotations

import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path


def beside(path: str, page: str) -> str:
    """Return the link from a page to a file."""
    return Path(os.path.relpath(path, Path(page).resolve().parent)).as_posix()


def columns(
    head: Sequence[str], rows: Iterable[Sequence[str]], *, left: Sequence[int] = (0,), piped: int = 80
) -> list[str]:
    """Return a table as lines; columns as wide as their widest cell, two blanks between, those in ``left`` aligned so.

    Wider than the terminal (``piped`` characters in a pipe), long names in the first column have a line of their own.
    """
    most = width() or piped
    every = [list(head), *map(list, rows)]
    wide = [max(len(row[k]) for row in every) for k in range(len(head))]
    if len(head) - 1 in left:
        wide[-1] = len(head[-1])  # text runs on to the right
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
