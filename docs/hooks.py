"""What mkdocs does with a page before it renders it: figures are put in, notebooks become pages.

``{{ part.name }}`` stands for a figure of figures.json with its unit (a count as ``9 of 10``), with ``.range`` for its
lowest and highest value, with ``.published`` for the value that its source states, ``.plain`` for that of a plain fit.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
NOTEBOOKS = ("robot", "drive")
"""Of examples/, each a page ``notebook_NAME.md``."""
GALLERY = HERE.parent / "out" / "gallery"
PAGES = {
    "twin/report.html": "identify",
    "simulation.html": "simulate",
    "found/report.html": "diagnose",
    "found/machine.html": "diagnose, in 3-D",
    "each/each.html": "diagnose --each",
    "compared/compare.html": "compare",
    "study/study.html": "study",
}
"""Page of the gallery (generate_gallery.py) -> the command that writes it."""


def figures() -> dict[str, Any]:
    """Return figures.json: part -> {what, command, ..., figures: name -> figure}."""
    return dict(json.loads((HERE / "figures.json").read_text(encoding="utf-8")))


def stated(name: str, content: Mapping[str, Any]) -> str:
    """Return a figure as it stands in a text.

    Args:
        name: ``part.name``, ``part.name.range``, ``part.name.published`` or ``part.name.plain``.
        content: what :func:`figures` returns.

    Raises:
        KeyError: there is no such figure.
    """
    part, figure, *aspect = name.split(".")
    found = content[part]["figures"][figure]
    unit = found.get("unit", "")
    end = f" {unit}" if unit else ""
    if aspect == ["range"]:
        return f"{_digits(found['low'])} to {_digits(found['high'])}{end}"
    if aspect in (["published"], ["plain"]):
        return f"{_digits(found[aspect[0]])}{end}"
    if found.get("of") is not None:
        return f"{found['value']:g} of {found['of']}"
    return f"{_digits(found['value'])}{end}"


def _digits(x: float) -> str:
    """Return a number with three significant digits."""
    return f"{x:.0f}" if abs(x) >= 1000.0 else f"{x:#.3g}".rstrip(".")


def filled(text: str, content: Mapping[str, Any]) -> str:
    """Return a page with its figures put in."""
    return re.sub(r"\{\{ ([\w.-]+) \}\}", lambda found: stated(found[1], content), text)


def notebook_page(path: Path) -> str:
    """Return a saved notebook as Markdown, its outputs as they were saved."""
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            shown = "".join(output.get("data", {}).get("text/html", ()))
            text = "".join(output.get("text", ()))
            parts.append(shown or f"```text\n{text.rstrip()}\n```")
    return "\n\n".join(parts) + "\n"


def on_files(files: Any, config: Any) -> Any:
    """Add the notebooks to the pages, and the files of the gallery where they were made."""
    from mkdocs.structure.files import File

    for name in NOTEBOOKS:
        text = notebook_page(HERE.parent / "examples" / f"{name}.ipynb")
        files.append(File.generated(config, f"notebook_{name}.md", content=text))
    for path in sorted(p for p in GALLERY.rglob("*") if p.is_file()):
        name = f"gallery/{path.relative_to(GALLERY).as_posix()}"
        files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def gallery() -> str:
    """Return every page of the gallery with a small view of it; a click opens it."""
    shown = (
        f'<figure><div><iframe src="gallery/{name}" loading="lazy" tabindex="-1"></iframe></div>'
        f'<a href="gallery/{name}"><code>pinotwin {PAGES[name]}</code></a></figure>'
        for name in PAGES
        if (GALLERY / name).is_file()
    )
    return f'<div class="gallery">{"".join(shown)}</div>'


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put the figures in, and lead links to the notebooks to their pages."""
    markdown = markdown.replace("[pages]", gallery())
    linked = re.sub(r"\]\(\.\./examples/(\w+)\.ipynb\)", r"](notebook_\1.md)", markdown)
    return filled(linked, figures())
