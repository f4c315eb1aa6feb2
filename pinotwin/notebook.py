"""How objects show themselves in a notebook: a heading, a small table, a line below."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

_CELL = "text-align:left;padding:2px 12px 2px 0;vertical-align:top"
MOST_ROWS = 24
"""A table longer than this is cut; the cell stays on one screen."""


def card(
    title: str, columns: Sequence[str] = (), rows: Iterable[Sequence[object]] = (), note: str = ""
) -> str:
    """Return HTML for a notebook cell; everything is escaped.

    Args:
        title: heading.
        columns: heads of the table.
        rows: its cells.
        note: a line below.
    """
    every = list(rows)
    cut = len(every) - MOST_ROWS
    if cut > 0:
        note = f"... and {cut} more. {note}".strip()
    head = "".join(f'<th style="{_CELL}">{html.escape(str(c))}</th>' for c in columns)
    body = "".join(
        "<tr>" + "".join(f'<td style="{_CELL}">{html.escape(str(c))}</td>' for c in row) + "</tr>"
        for row in every[:MOST_ROWS]
    )
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>" if columns else ""
    below = f"<div>{html.escape(note)}</div>" if note else ""
    return f"<div><strong>{html.escape(title)}</strong>{table}{below}</div>"
