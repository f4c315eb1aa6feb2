"""One self-contained HTML page: no network, opens from a folder, prints, follows light and dark.

    Page("Trunnion").section("Verdict", "All is well.").section("Effort", Plot(figure)).html()

plotly's script is packed into the page once (a third of its size; the browser unpacks it), and only
if the page has a plot. A figure may use the colours of the style sheet, written ``var(--accent)``.
"""

from __future__ import annotations

import base64
import re
import zlib
from dataclasses import dataclass, replace
from functools import cache
from typing import Self

from pinotwin.report.assets import CSS, SCRIPT
from pinotwin.report.blocks import Block, Group, Html, Plot, Tabs, escape, paragraph


@dataclass(frozen=True)
class Section:
    """A titled part of a page.

    Attributes:
        title: its heading.
        blocks: its content.
        intro: a sentence below the heading.
    """

    title: str
    blocks: tuple[Block, ...]
    intro: str = ""

    @property
    def anchor(self) -> str:
        """Where the page's navigation jumps to."""
        return re.sub(r"[^a-z0-9]+", "-", self.title.lower()).strip("-")


@dataclass(frozen=True)
class Page:
    """A report in the making; :meth:`section` returns a longer one.

    Attributes:
        title: heading of the page.
        subtitle: line below it.
        sections: what it holds.
    """

    title: str
    subtitle: str = ""
    sections: tuple[Section, ...] = ()

    def section(self, title: str, *blocks: Block, intro: str = "") -> Self:
        """Return the page with one more section; a section without blocks is left out."""
        if not blocks:
            return self
        return replace(self, sections=(*self.sections, Section(title, blocks, intro)))

    def html(self) -> str:
        """Return the page as one text."""
        writer = _Writer([])
        body = "".join(writer.section(section) for section in self.sections)
        links = "".join(f'<a href="#{s.anchor}">{escape(s.title)}</a>' for s in self.sections if s.title)
        size, packed = _plotly()
        script = f'<script type="text/plain" id="plotly-packed" data-size="{size}">{packed}</script>'
        return _SHELL.format(
            title=escape(self.title),
            subtitle=escape(self.subtitle),
            css=CSS,
            links=links,
            body=body,
            figures="".join(writer.figures),
            script=SCRIPT,
            plotly=script if writer.figures else "",
        )


_SHELL = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width,initial-scale=1">
<meta name="generator" content="pinotwin"><title>{title}</title>
<link rel="icon" href="data:,"><style>{css}</style></head>
<body><div class="bar"><nav><b>{title}</b>{links}
<button id="theme">light / dark</button></nav></div>
<main><header><h1>{title}</h1><p>{subtitle}</p></header>
<noscript><p>The plots need JavaScript; the tables are complete without it.</p></noscript>
{body}
<footer>Made by pinotwin. The page holds everything it shows and loads nothing.</footer></main>
{figures}{plotly}
<script>{script}</script></body></html>
"""


@cache
def _plotly() -> tuple[int, str]:
    """Return the size of plotly's script, and the script deflated and as base64."""
    from plotly.offline import get_plotlyjs

    text = get_plotlyjs().encode()
    deflate = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    return len(text), base64.b64encode(deflate.compress(text) + deflate.flush()).decode()


@dataclass(frozen=True)
class _Writer:
    """Writes blocks; collects the figures' data, which go to the end of the page."""

    figures: list[str]

    def section(self, section: Section) -> str:
        intro = paragraph(section.intro, "lead").text if section.intro else ""
        body = "".join(self.block(block) for block in section.blocks)
        title = f"<h2>{escape(section.title)}</h2>" if section.title else ""
        return f'<section id="{section.anchor}">{title}{intro}{body}</section>'

    def block(self, block: Block) -> str:
        if isinstance(block, Html):
            return block.text
        if isinstance(block, Plot):
            return self._plot(block)
        if isinstance(block, Group):
            inner = "".join(self.block(item) for item in block.blocks)
            return f'<div class="pair">{inner}</div>'
        if isinstance(block, Tabs):
            return self._tabs(block)
        return paragraph(block).text

    def _plot(self, plot: Plot) -> str:
        name = f"figure-{len(self.figures) + 1}"
        # "</" would end the script element that holds the data.
        data = plot.figure.to_json(validate=False).replace("</", "<\\/")
        self.figures.append(f'<script type="application/json" id="{name}">{data}</script>')
        height = int(plot.figure.layout.height or 320)
        note = f"<span>{escape(plot.note)}</span>" if plot.note else ""
        caption = f"<figcaption>{escape(plot.title)}{note}</figcaption>" if plot.title else ""
        return (
            f'<figure>{caption}<div class="plot" data-figure="{name}" '
            f'style="height:{height}px"></div></figure>'
        )

    def _tabs(self, tabs: Tabs) -> str:
        heads, panels = [], []
        for k, (title, blocks) in enumerate(tabs.panels.items()):
            chosen = "true" if k == 0 else "false"
            heads.append(f'<button role="tab" aria-selected="{chosen}">{escape(title)}</button>')
            inner = "".join(self.block(block) for block in blocks)
            hidden = "" if k == 0 else " hidden"
            panels.append(f'<div class="panel" role="tabpanel"{hidden}>{inner}</div>')
        if len(panels) == 1:
            return panels[0]
        return (
            f'<div class="tabs"><div class="heads" role="tablist">{"".join(heads)}</div>'
            f"{''.join(panels)}</div>"
        )
