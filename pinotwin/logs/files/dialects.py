"""Grammars that are no plain table, brought to one line by line, so that messages still name the file's lines."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from pinotwin.units import find_unit

_MINUS = "\u2212".encode()
_THOUSANDS = re.compile(rb"(?<=\d)(?:'|\xe2\x80\x99|\xc2\xa0|\xe2\x80\xaf)(?=\d{3}(?!\d))")
_RULE = re.compile(rb"(?m)^[-=+|:*~ ]{3,}\r?$")
_FRAME = re.compile(rb"(?m)^[ \t]*\|[ \t]*|\|[ \t]*(?=\r?$)")
_VALUE = rb"([+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf))"
_PAIR = re.compile(
    rb"([A-Za-z_/\x80-\xff][^\s=:;,|]*)(?:\s*[=:]\s*|[ \t]+)" + _VALUE + rb"(?:[\s,;|]+|$)", re.I
)
_LEAD = re.compile(rb"(\d[\d:.,TZ+/-]*)[\s,;|]+")
_SHDR = re.compile(rb"(?:\d{4}-\d\d-\d\dT[\d:.]+Z?\|[A-Za-z_][^|\n]*\|[^|\n]*(?:\|[^|\n]*)*\n\s*){2}")
_SEARCHED = 1 << 16


@dataclass(frozen=True)
class Plain:
    """The text of a log as a table: its lines, and names and units where they stand elsewhere than in a header."""

    text: bytes
    names: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)


def plain(text: bytes) -> Plain:
    """Return a text log as a table."""
    if not text.isascii() or b"'" in text:
        text = _THOUSANDS.sub(b"", text.replace(_MINUS, b"-"))
    if text.startswith(b"%TNCscope"):
        return _tncscope(text)
    if _SHDR.match(text):
        return _shdr(text)
    if text.lstrip().startswith((b"|", b"+-")):
        text = _FRAME.sub(b"", text)
    if _RULE.search(text, 0, _SEARCHED):
        text = _RULE.sub(b"", text)
    return _unpaired(text)


def _tncscope(text: bytes) -> Plain:
    """HEIDENHAIN TNCscope: ``%[CURVEn]`` describes a column; the first is the time in us."""
    head = text[: text.find(b"%[DATA]")].decode(errors="replace")
    columns = []
    for k, block in enumerate(head.split("%[CURVE")[1:], start=1):
        pairs = (line.lstrip("%").partition("=") for line in block.splitlines())
        keys = {key.strip(): value.strip() for key, _, value in pairs}
        name = keys.get("NAME") or f"{keys.get('CHANNELTYPE', 'curve')}/{keys.get('AXISTYPE', k)}"
        place = keys.get("COLUMN", "")
        columns.append((int(place) if place.isdecimal() else k, name, find_unit(keys.get("DIMENSION", ""))))
    columns.sort(key=lambda column: column[0])
    units = {name: unit for _, name, unit in columns if unit}
    return Plain(text, ("t", *(name for _, name, _ in columns)), {"t": "us", **units})


def _shdr(text: bytes) -> Plain:
    """MTConnect's adapters: ``stamp|item|value|item|value``, as one item a row."""
    rows = [b"timestamp|dataItem|value"]
    for line in text.split(b"\n"):
        stamp, *cells = line.strip().split(b"|")
        pairs = zip(cells[::2], cells[1::2], strict=False)
        rows += [b"|".join((stamp, item, value)) for item, value in pairs if item]
    return Plain(b"\n".join(rows))


def _unpaired(text: bytes) -> Plain:
    """Rows in which every value stands behind its name: ``pin +0.1 pin +0.2``; one value a row if all rows say so."""
    first = text[:_SEARCHED].rpartition(b"\n")[0].split(b"\n")
    found = [names for names, _ in map(_pairs, filter(bytes.strip, first))]
    names = next((own for own in found if own and own != [b"time"]), [])
    alike = [own == names for own in found[found.index(names) :]] if names else []
    if len(alike) < 2 or not (all(alike) or (alike[1] and len(names) > 2 - (b"time" not in names))):
        return Plain(text)
    rows = []
    for line in text.split(b"\n"):
        own, values = _pairs(line)
        rows.append(b"\t".join(values) if own == names else line)
    return Plain(b"\n".join(rows), tuple(name.decode(errors="replace") for name in names))


def _pairs(line: bytes) -> tuple[list[bytes], list[bytes]]:
    """Return the names of a line and its values, ``time`` for a stamp before them; none where it is no such line."""
    bare = line.strip()
    lead = _LEAD.match(bare)
    at = lead.end() if lead else 0
    names, values = ([b"time"], [lead[1]]) if lead else ([], [])
    while at < len(bare):
        pair = _PAIR.match(bare, at)
        if pair is None:
            return [], []
        names.append(pair[1])
        values.append(pair[2])
        at = pair.end()
    return names, values
