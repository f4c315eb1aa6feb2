"""The pieces that a page is made of; each is escaped HTML or a plotly figure.

Only :class:`Html` goes into a page as it is. Plain text is always escaped, so that a name taken
from a file cannot become markup.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import plotly.graph_objects as go


@dataclass(frozen=True)
class Html:
    """Markup that is ready to go into a page."""

    text: str


@dataclass(frozen=True)
class Plot:
    """A figure with its caption.

    Attributes:
        figure: what to draw.
        title: caption in bold.
        note: how to read it, one sentence.
    """

    figure: go.Figure
    title: str = ""
    note: str = ""


@dataclass(frozen=True)
class Group:
    """Blocks side by side where the window is wide enough."""

    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Tabs:
    """Blocks of which one group is shown at a time.

    Attributes:
        panels: title of each tab -> its blocks.
    """

    panels: Mapping[str, Sequence[Block]]


Block = Html | Plot | Group | Tabs | str
"""What a section holds; a plain string is a paragraph."""


def escape(value: object) -> str:
    """Return text safe for HTML."""
    return html.escape(str(value), quote=True)


def paragraph(text: str, style: str = "") -> Html:
    """Return a paragraph; ``style`` is a class of the style sheet (``verdict``, ``lead``)."""
    words = escape(re.sub(r"(?<=\d) %", "\u00a0%", text))  # a line does not break between them
    return Html(f'<p class="{style}">{words}</p>' if style else f"<p>{words}</p>")


def heading(text: str) -> Html:
    """Return a heading inside a section."""
    return Html(f"<h3>{escape(text)}</h3>")


def notes(lines: Iterable[str]) -> Html:
    """Return things to be careful about, each in its own box."""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return Html(f'<ul class="note-list">{items}</ul>' if items else "")


def bullets(lines: Iterable[str]) -> Html:
    """Return a plain list."""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return Html(f'<ul class="plain-list">{items}</ul>' if items else "")


def chip(text: str, kind: str = "", hint: str = "") -> Html:
    """Return a short coloured label.

    Args:
        text: what it says.
        kind: ``good``, ``fair``, ``bad``, or empty for grey.
        hint: shown when the pointer rests on it.
    """
    title = f' title="{escape(hint)}"' if hint else ""
    return Html(f'<span class="chip {kind}"{title}>{escape(text)}</span>')


@dataclass(frozen=True)
class Tile:
    """One figure in large print.

    Attributes:
        name: what it is of.
        value: the figure with its unit.
        note: what it means.
        label: a short verdict, shown as a chip of kind ``kind``.
        kind: see :func:`chip`.
    """

    name: str
    value: str
    note: str = ""
    label: str = ""
    kind: str = ""


def tiles(items: Iterable[Tile]) -> Html:
    """Return figures in large print, side by side."""
    out = []
    for item in items:
        label = chip(item.label, item.kind).text if item.label else ""
        out.append(
            f'<div class="tile"><div class="name"><span>{escape(item.name)}</span>{label}</div>'
            f'<div class="big">{escape(item.value)}</div>'
            f'<div class="note">{escape(item.note)}</div></div>'
        )
    return Html(f'<div class="tiles">{"".join(out)}</div>')


def table(header: Sequence[str], rows: Iterable[Sequence[object]], numeric: Sequence[int] = ()) -> Html:
    """Return a plain table.

    Args:
        header: title of each column.
        rows: cells; an :class:`Html` cell goes in as it is.
        numeric: columns aligned as numbers.
    """
    kind = ["num" if k in numeric else "" for k in range(len(header))]
    head = "".join(f'<th class="{c}">{escape(h)}</th>' for h, c in zip(header, kind, strict=True))
    body = "".join(
        "<tr>"
        + "".join(
            f'<td class="{c}" data-head="{escape(h)}">{cell(x)}</td>'
            for x, c, h in zip(row, kind, header, strict=True)
        )
        + "</tr>"
        for row in rows
    )
    return Html(
        f'<div class="card scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def share_bar(share: float, even: float) -> Html:
    """Return a bar of a share with a tick at what it would be if it lay evenly, and its number.

    Args:
        share: of the gap, 0 to 1.
        even: share of the time, 0 to 1.
    """
    low = f"{even:.0%}" if even >= 0.01 else "< 1%"
    return Html(
        f'<span class="share"><i style="width:{100 * min(share, 1.0):.1f}%"></i>'
        f'<u style="left:{100 * min(even, 1.0):.1f}%"></u></span> {share:.0%} in {low}'
    )


def cell(value: object) -> str:
    """Return the content of a table cell."""
    return value.text if isinstance(value, Html) else escape(value)
