"""The pieces that a page is made of; each is escaped HTML (a macro of templates/blocks.html) or a plotly figure.

Only :class:`Html` goes in as it is: a name taken from a file cannot become markup.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from pinotwin.system.templates import environment

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from jinja2 import Environment


@dataclass(frozen=True)
class Html:
    """Markup that is ready to go into a page."""

    text: str

    def __html__(self) -> str:
        """Return the markup: templates take it as it is."""
        return self.text


@dataclass(frozen=True)
class Plot:
    """A figure with its caption."""

    figure: go.Figure  # what to draw
    title: str = ""  # caption in bold
    note: str = ""  # how to read it, one sentence

    @property
    def data(self) -> str:
        """The figure as JSON."""
        return str(self.figure.to_json(validate=False)).replace("\\u002f", "/")

    @property
    def height(self) -> int:
        """Height on the page [px]."""
        return int(self.figure.layout.height or 320)


@dataclass(frozen=True)
class Group:
    """Blocks side by side where the window is wide enough."""

    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Tabs:
    """Blocks of which one group is shown at a time."""

    panels: Mapping[str, Sequence[Block]]  # title of each tab -> its blocks


Block = Html | Plot | Group | Tabs | str
"""What a section holds; a plain string is a paragraph."""


@dataclass(frozen=True)
class Tile:
    """One figure with its unit in large print, with a verdict as a :func:`chip`; or several under one heading."""

    name: str = ""
    value: str = ""
    note: str = ""
    label: str = ""
    kind: str = ""
    hint: str = ""
    small: bool = False
    heading: str = ""
    parts: tuple[Tile, ...] = ()


@cache
def templates() -> Environment:
    """Return the templates of the pages, which know every function of this module and of ``display``."""
    from pinotwin.report import display

    made = environment("pinotwin.report")
    pieces = (paragraph, heading, notes, bullets, chip, tiles, table)
    numbers = (display.percent, display.number, display.seconds, display.elided)
    made.globals |= {f.__name__: f for f in (*pieces, *numbers)}
    # Every per cent sign stands apart from its number; no line breaks there, or after a sign of order.
    apart = re.compile(r"(?<=\d) ?(?=%(?!\w))|(?<=[≤≥]) ")
    made.finalize = lambda x: apart.sub("\u00a0", x) if type(x) is str else x
    made.filters["each"] = lambda form, values: ", ".join(form % x for x in values)
    return made


def macro(name: str, *given: object) -> Html:
    """Return what a macro of the blocks makes."""
    made = str(getattr(templates().get_template("blocks.html").module, name)(*given))
    return Html(re.sub(r"(^|>)\s*\n\s*(?=<|$)", r"\1", made).strip())


def paragraph(text: str, style: str = "") -> Html:
    """Return a paragraph; ``style`` is a class of the style sheet (``verdict``, ``lead``)."""
    return macro("paragraph", text, style)


def heading(text: str) -> Html:
    """Return a heading inside a section."""
    return macro("heading", text)


def notes(lines: Iterable[str]) -> Html:
    """Return things to be careful about, each in its own box."""
    return macro("listed", list(lines), "note-list")


def bullets(lines: Iterable[str]) -> Html:
    """Return a plain list."""
    return macro("listed", list(lines), "plain-list")


def chip(text: str, kind: str = "", hint: str = "") -> Html:
    """Return a short label, ``good``, ``fair``, ``bad`` or grey, with a hint where the pointer rests on it."""
    return macro("chip", text, kind, hint)


def tiles(items: Iterable[Tile]) -> Html:
    """Return figures in large print, side by side."""
    return macro("tiles", list(items))


def table(header: Sequence[str], rows: Iterable[Sequence[object]], numeric: Sequence[int] = ()) -> Html:
    """Return a plain table; an :class:`Html` cell goes in as it is, ``numeric`` columns are aligned as numbers."""
    head = [(title, "num" if k in numeric else "") for k, title in enumerate(header)]
    cells = [[(x, *column) for x, column in zip(row, head, strict=True)] for row in rows]
    return macro("cells", head, cells)
