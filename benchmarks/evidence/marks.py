"""Numbers of README and docs that stand for figures of the file: found, held against it, renewed.

A number that is followed by ``<!--part.name-->`` is the figure's value (``3 of 10``: with its ``of``); ``.range`` after
the name is lowest to highest, ``.low``, ``.high`` and ``.published`` are these alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pinotwin.system.writing import write_text

Content = Mapping[str, Any]

_NUMBER = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"
_NAME = r"\w+(?:\.[\w-]+)+"
_MARK = re.compile(f"<!--{_NAME}-->")
_MARKED = re.compile(
    rf"(?P<number>{_NUMBER})(?: (?P<joint>of|to) (?P<other>{_NUMBER}))?[^\d<\n|]{{0,16}}<!--(?P<name>{_NAME})-->"
)
_ASPECTS: Mapping[str, tuple[str, ...]] = {
    "range": ("low", "high"),
    "low": ("low",),
    "high": ("high",),
    "published": ("published",),
}
_UNITS = r"%|µs|us|ppm|µm|µrad|mrad|deg\b|°|GB|MB|times real time"
_MEASURED = re.compile(
    rf"(?<![\w.])(?:{_NUMBER} to )?{_NUMBER} ?(?:{_UNITS})"  # a number with the unit of an error
    rf"|(?<![\w.])\d+ of \d+"  # a count
    rf"|(?<=\|) *[±+-]? ?\d+(?:\.\d+(?:e-?\d+)?|e-?\d+) *(?=\|)"  # a cell of a table that is no whole number
)
_CODE = re.compile(r"^(?: *```.*?^ *```|(?: {4}[^\n]*\n)+)|`[^`\n]*`|!?\[[^]]*\]\([^)]*\)", re.M | re.S)


def pages(docs: Path) -> list[Path]:
    """Return the README beside the folder of docs, if there is one, and the pages in it."""
    return [p for p in [docs.parent / "README.md", *sorted(docs.rglob("*.md"))] if p.is_file()]


def wrong(text: str, content: Content) -> list[str]:
    """Return what is wrong with the marked numbers of a text."""
    marked = list(_MARKED.finditer(text))
    out = [f"{n} unreadable marks" for n in [len(_MARK.findall(text)) - len(marked)] if n]
    for found in marked:
        stated = _stated(found)
        measured = _measured(found, content)
        if isinstance(measured, str):
            out.append(f"{found['name']}: {measured}")
        elif len(stated) != len(measured) or not all(map(_agree, stated, measured)):
            out.append(f"{found['name']}: stated {' '.join(stated)}, measured {' '.join(map(str, measured))}")
    return out


def renewed(text: str, content: Content) -> str:
    """Return a text with the numbers that are not those of the file written anew, with as many digits."""

    def anew(found: re.Match[str]) -> str:
        stated, measured = _stated(found), _measured(found, content)
        if isinstance(measured, str) or len(stated) != len(measured) or all(map(_agree, stated, measured)):
            return found[0]
        numbers = [_written(x, like) for x, like in zip(measured, stated, strict=True)]
        old = found[0].partition("<!--")[0].rstrip()
        head = f" {found['joint']} ".join(stated)
        return (
            f" {found['joint']} ".join(numbers) + found[0][len(head) :] if old.startswith(head) else found[0]
        )

    return _MARKED.sub(anew, text)


def renew(docs: Path, content: Content) -> list[Path]:
    """Write the numbers of all pages anew; return the pages that changed."""
    changed = []
    for page in pages(docs):
        text = page.read_text(encoding="utf-8")
        if (new := renewed(text, content)) != text:
            write_text(page, new)
            changed.append(page)
    return changed


def unmarked(text: str) -> Iterator[str]:
    """Yield the numbers of a text that look measured and carry no mark, with what stands before them.

    Code and links aside: an error in percent, parts per million, microseconds or degrees, a count ("3 of 10"), a cell
    of a table that is a number and no whole one.
    """
    plain = _CODE.sub(lambda found: " " * len(found[0]), text)
    plain = _MARKED.sub(lambda found: "#" * len(found[0]), plain)
    for found in _MEASURED.finditer(plain):
        yield plain[max(0, found.start() - 30) : found.end()].replace("\n", " ").strip()


def _stated(found: re.Match[str]) -> list[str]:
    return [found["number"], *([found["other"]] if found["other"] else [])]


def _measured(found: re.Match[str], content: Content) -> list[float] | str:
    """Return what the file holds for a mark, or what is wrong with the mark."""
    part, name, *aspect = found["name"].split(".")
    try:
        figure = content[part]["figures"][name]
        if not aspect:
            return [figure["value"], *([figure["of"]] if found["joint"] == "of" else [])]
        return [float(figure[key]) for key in _ASPECTS[".".join(aspect)]]
    except KeyError:
        return "no such figure"


def _agree(stated: str, measured: float) -> bool:
    mantissa, _, power = stated.partition("e")
    step = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
    return abs(measured - float(stated)) <= 0.501 * step


def _written(value: float, like: str) -> str:
    mantissa, _, power = like.partition("e")
    digits = len(mantissa.partition(".")[2])
    if not power:
        return f"{value:.{digits}f}"
    whole, _, exponent = f"{value:.{digits}e}".partition("e")
    return f"{whole}e{int(exponent)}"
