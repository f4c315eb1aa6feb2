"""One self-contained HTML page and its pieces: no network, opens from a folder, prints, follows light and dark.

    Page("Trunnion").section("Verdict", "All is well.").section("Effort", Plot(figure)).html()

A piece is escaped HTML (a macro of templates/blocks.html) or a plotly figure. Only :class:`Html` goes in as it is: a
name taken from a file cannot become markup. A page with much prose has its own template, which gets what ``given``
holds. plotly's script is packed in once, if the page has a plot. A figure may use the colours of the style sheet,
written ``var(--accent)``.
"""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Self
from urllib.parse import quote

import numpy as np
import plotly.graph_objects as go
from jinja2 import Environment
from markupsafe import Markup as Html

from pinotwin.system.templates import asset, environment


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


Block = Html | Plot | Group | Tabs | str  # What a section holds; a plain string is a paragraph
Files = Sequence[tuple[str, str]]  # Name, relative to the page, and content of what lies beside it


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


@dataclass(frozen=True)
class Section:
    """A titled part of a page, with a sentence below its heading."""

    title: str
    blocks: tuple[Block, ...]
    intro: str = ""


@dataclass(frozen=True)
class Page:
    """A report in the making; :meth:`section` returns a longer one."""

    title: str  # heading of the page
    subtitle: str = ""  # line below it
    sections: tuple[Section, ...] = ()  # what it holds, below what its template says
    template: str = "page"  # of its own, without ``.html``
    given: Mapping[str, Any] = field(default_factory=dict)  # what that template is given
    files: Files = ()
    # where it comes from: version, date, options, logs; see :func:`made_of`
    made: Mapping[str, Any] = field(default_factory=dict)

    def section(self, title: str, *blocks: Block, intro: str = "") -> Self:
        """Return the page with one more section, or more in its last one; a section without blocks is left out."""
        if not blocks:
            return self
        if self.sections and self.sections[-1].title == title:
            *before, last = self.sections
            return replace(self, sections=(*before, replace(last, blocks=(*last.blocks, *blocks))))
        return replace(self, sections=(*self.sections, Section(title, blocks, intro)))

    def html(self) -> str:
        """Return the page as one text."""
        writer = _Writer()
        tools = {f.__name__: f for f in (writer.show, writer.plot, writer.section, plotly, packed)}
        own = {k: getattr(self, k) for k in ("title", "subtitle", "sections")}
        own |= {"beside": files_block(self.files), "provenance": macro("provenance", self.made)}
        looks = {"css": asset("pinotwin.report", "page.css"), "script": asset("pinotwin.report", "page.js")}
        lists = {"figures": writer.figures, "links": writer.links}
        template = templates().get_template(f"{self.template}.html")
        return template.render(**self.given, **own, **looks, **lists, **tools)


def files_block(files: Files) -> list[Block]:
    """Return links to what lies beside a page, by name and content; none where nothing does."""
    rows = [(macro("link", quote(name), name), what) for name, what in files]
    return [table(("file", "what it holds"), rows)] if rows else []


def plotly(figures: Sequence[str]) -> tuple[int, str]:
    """Return the size of the part of plotly that draws figures, given as JSON, and its script packed."""
    kinds = {trace.get("type", "scatter") for text in figures for trace in json.loads(text)["data"]}
    return _script(basic=kinds <= {"scatter", "bar"})


def packed(figures: Sequence[str]) -> tuple[int, int, str]:
    """Return figures, given as JSON, deflated as base64, with their size and the place where their text begins.

    Before the text stand their arrays of floats, each once and its bytes by weight, in the text ``@``, place and size.
    """
    places: dict[str, str] = {}
    planes = bytearray()

    def moved(found: re.Match[str]) -> str:
        if (name := found[2]) not in places:
            rows = np.frombuffer(base64.b64decode(name), np.uint8).reshape(-1, 4)
            places[name] = f"@{len(planes)} {rows.size}"
            planes.extend(rows.T.tobytes())
        return f'{found[1]}{places[name]}"'

    held = re.compile(r'("dtype":"f[48]","bdata":")([^"]{99,})"')
    text = ",".join(held.sub(moved, figure) for figure in figures)
    return len(planes) + len(text.encode()) + 2, len(planes), _deflated(bytes(planes) + f"[{text}]".encode())


def _deflated(content: bytes) -> str:
    deflate = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    return base64.b64encode(deflate.compress(content) + deflate.flush()).decode()


@cache
def _script(*, basic: bool) -> tuple[int, str]:
    """Return the size of plotly's script, a part of it (plotly-basic 4.1.1) or all, and it deflated, as base64."""
    from plotly.offline import get_plotlyjs

    text = (asset("pinotwin.report", "plotly-basic.min.js") if basic else get_plotlyjs()).encode()
    return len(text), _deflated(text)


@dataclass(frozen=True)
class _Writer:
    """Writes blocks; collects the figures' data, which go to the end of the page, and the navigation."""

    figures: list[str] = field(default_factory=list)
    links: list[tuple[str, str]] = field(default_factory=list)

    def show(self, *blocks: Block) -> Html:
        """Return blocks as markup."""
        return Html("".join(macro("show", block, self.figures) for block in blocks))

    def plot(self, figure: Any, title: str = "", note: str = "") -> Html:
        """Return a figure with its caption."""
        return self.show(Plot(figure, title, note))

    def section(self, title: str, intro: str = "", *, caller: Callable[[], str]) -> str:
        """Return a section around what the template holds between its tags, nothing where that is empty."""
        body = str(caller()).strip()
        if not body:
            return ""
        anchor = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")
        if title:
            self.links.append((anchor, title))
        return macro("section", anchor, title, paragraph(intro, "lead") if intro else "", Html(body))
