"""How objects show themselves in a notebook: a heading, a small table, a line below."""

from __future__ import annotations

import html
import importlib
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any

Shown = tuple[str, Sequence[str], Sequence[Sequence[object]], str]
"""Title, heads of the columns, rows of cells, and a line below."""


class Card(ABC):
    """Shows a dataclass declared with ``repr=False`` as a small table: text in a console, HTML in a notebook."""

    @abstractmethod
    def _shown(self) -> Shown:
        """Return what is shown."""

    def __repr__(self) -> str:
        return plain_card(*self._shown())

    def _repr_html_(self) -> str:
        return card(*self._shown())


class Drawn(Card):
    """A result that also draws itself and writes its page, by :mod:`pinotwin.report.pictures`, loaded on first use."""

    def plot(self, *given: Any) -> Any:
        """Return the plotly figure of the result.

        Args:
            given: of a twin a log to compare with (its own logs without one); of a diagnosis the axis.

        Raises:
            InputError: there is nothing to draw.
        """
        return _pictures().plot(self, *given)

    def report(self, path: str | Path, *logs: Any) -> Path:
        """Write the page of the result and return its path.

        Args:
            path: file to write (.html).
            logs: of a twin, the logs that the page compares it with.

        Raises:
            InputError: the path is no page, or a log is missing.
        """
        written: Path = _pictures().report(self, Path(path), *logs)
        return written

    def _repr_html_(self) -> str:
        """Return the table with the picture below it."""
        return card(*self._shown()) + _pictures().picture(self)


def _pictures() -> Any:
    return importlib.import_module("pinotwin.report.pictures")


def share_cell(x: float | None) -> str:
    """Return a share [1] as a cell in per cent; a dash for none."""
    return "-" if x is None or not math.isfinite(x) else f"{x:.2%}"


_CELL = "text-align:left;padding:2px 12px 2px 0;vertical-align:top"
MOST_ROWS = 24  # a table longer than this is cut; the cell stays on one screen


def card(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], note: str) -> str:
    """Return HTML for a notebook cell; everything is escaped. See :data:`Shown`."""
    cut = len(rows) - MOST_ROWS
    if cut > 0:
        note = f"... and {cut} more. {note}".strip()
    head = "".join(f'<th style="{_CELL}">{html.escape(str(c))}</th>' for c in columns)
    body = "".join(
        "<tr>" + "".join(f'<td style="{_CELL}">{html.escape(str(c))}</td>' for c in row) + "</tr>"
        for row in rows[:MOST_ROWS]
    )
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>" if columns else ""
    below = f"<div>{html.escape(note)}</div>" if note else ""
    return f"<div><strong>{html.escape(title)}</strong>{table}{below}</div>"


LONGEST = 34
"""Characters of a cell of plain text; a longer one is cut, but the last one where the line has room."""


def plain_card(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], note: str) -> str:
    """Return the same as plain text, for ``repr``: one screen of at most 80 columns or so."""
    every = [[*(_cut(str(c)) for c in row[:-1]), str(row[-1])] for row in rows]
    shown = [[_cut(c) for c in columns], *every[:MOST_ROWS]] if columns else []
    before = sum(max(len(row[k]) for row in shown) + 2 for k in range(len(columns) - 1)) if shown else 0
    shown = [[*row[:-1], _cut(row[-1], max(LONGEST, 78 - before))] for row in shown]
    wide = [max(len(row[k]) for row in shown) for k in range(len(columns))]
    lines = ["  ".join(c.ljust(w) for c, w in zip(row, wide, strict=True)).rstrip() for row in shown]
    more = [f"... and {len(every) - MOST_ROWS} more"] if len(every) > MOST_ROWS else []
    return "\n".join([f"<{title}>", *(f"  {line}" for line in [*lines, *more, *([note] if note else [])])])


def _cut(text: str, most: int = LONGEST) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"
