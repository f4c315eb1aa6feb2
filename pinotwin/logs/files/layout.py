"""How a text log is laid out: encoding, delimiter, decimal sign, header, unit row, comments.

The numbers are found first, as the rows that have most in common; what stands above is header, units and notes.
"""

from __future__ import annotations

import codecs
import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain

from pinotwin.errors import LogError
from pinotwin.logs.files.cells import COMMENTS, has_value, is_comment, is_list, is_number, split_cells
from pinotwin.logs.files.content import distinct, repeated
from pinotwin.logs.files.dialects import plain
from pinotwin.logs.files.header import Header, is_unit_row, read_header, read_preamble

_SEP = re.compile(r"\"?sep=(.)\"?[\s,;]*$", re.I)
_INTEGER = re.compile(r"[+-]?\d+(e[+-]?\d+)?$", re.I)
_HALVES = re.compile(rb"([+-]?\d+),(\d+(?:[eE][+-]?\d+)?)")
_DELIMITERS = "\t;|, "  # tried in this order: ``1,5;2,5`` has decimal commas, ``1, 2`` has comma and blank


@dataclass(frozen=True)
class Layout:
    """Layout of one text file."""

    text: bytes  # the whole file as UTF-8, without byte-order mark
    delimiter: str  # comma, semicolon, tab, bar, or a space for runs of blanks
    decimal: str  # decimal sign
    header: Header  # names and units of the columns, the latter perhaps from the lines above it
    skip: int  # physical lines before the first row of numbers
    comments: bool  # whether comment lines may occur after that
    notes: tuple[str, ...] = ()  # what was noticed
    thousands: str = ""  # sign between groups of three digits, "" for none
    step: float | None = None  # sample time that the lines above state [s], for a file without a time column


def inspect_layout(raw: bytes, stem: str, source: str) -> Layout:
    """Return the layout of a text log, or LogError; columns without a header are ``stem[0]``, ``stem[1]``..."""
    text, notes = _decode(raw, source)
    grammar = plain(text)
    text = grammar.text
    numbered = _leading_lines(text)
    body = [(i, line) for i, line in numbered if line.strip() and not is_comment(line)]
    stated = _SEP.match(body[0][1]) if body else None
    body = body[1:] if stated else body
    if not body:
        raise LogError(f"{source}: holds no lines of data; record or export it again")
    delimiter = stated[1] if stated else _delimiter([line for _, line in body])
    cells = [split_cells(line, delimiter) for _, line in body]
    start = _first_row(cells)
    if start >= len(body):
        raise LogError(f"{source}: has a header but no rows of numbers; record or export it again")
    skip = body[start][0]
    first = line_start(text, skip)
    if delimiter == "," and _halved(cells, start, source):
        whole = inspect_layout(text[:first] + _HALVES.sub(rb"\1.\2", text[first:]), stem, source)
        said = "the comma is delimiter and decimal sign: two cells each were joined to a number"
        return replace(whole, notes=(*notes, said, *whole.notes))
    decimal, thousands = _decimal(cells[start:], source)
    header = read_header(cells, start, stem)
    if grammar.names:
        named = distinct(grammar.names)
        header = Header(named, grammar.units, 0, stated=repeated(named, grammar.names))
    names = header.names or distinct(_commented_names(numbered, skip, delimiter, len(cells[start])))
    names = names or [f"{stem}[{i}]" for i in range(len(cells[start]))]
    above = [line for i, line in numbered if i < body[start - header.rows][0]]
    only_comments = all(is_comment(line) or not line.strip() for line in above)
    above = [] if only_comments else above[int(bool(stated)) :]
    step, units, said_above = read_preamble(above, cells[: start - header.rows], names)
    marks = (*(mark.encode() for mark in COMMENTS), delimiter.encode())
    return Layout(
        text=text,
        delimiter=delimiter,
        decimal=decimal,
        header=replace(header, names=names, units={**units, **header.units}),
        skip=skip,
        comments=any(text.find(b"\n" + mark, first) >= 0 for mark in marks),
        notes=(*notes, *said_above),
        thousands=thousands,
        step=step,
    )


def _commented_names(lines: Iterable[tuple[int, str]], stop: int, delimiter: str, width: int) -> list[str]:
    """Return the names in the last comment above the numbers, if they fit (``# t, q, u``)."""
    above = [line for i, line in lines if i < stop and is_comment(line)]
    names = split_cells(above[-1].strip().lstrip("#%/ "), delimiter) if above else []
    return names if len(names) == width and all(n and not is_number(n) for n in names) else []


def line_start(text: bytes, line: int) -> int:
    """Return where a line (from 0) begins."""
    start = 0
    for _ in range(line):
        start = text.find(b"\n", start) + 1
    return start


def _decode(raw: bytes, source: str) -> tuple[bytes, list[str]]:
    """Return the text as UTF-8 bytes with plain line ends, and what was noticed."""
    notes: list[str] = []
    wide = raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    if wide or raw[1:64:2].count(0) >= 0.9 * len(raw[1:64:2]) > 0:
        try:
            raw = raw.decode("utf-16" if wide else "utf-16-le").encode()
        except UnicodeDecodeError:
            raise LogError(f"{source}: is damaged UTF-16 text; export it again as UTF-8") from None
    raw = raw.removeprefix(codecs.BOM_UTF8)
    control = sum(byte < 32 and byte not in b"\t\n\r\f" for byte in raw[:4096])
    if b"\x00" in raw or control > 0.02 * max(len(raw[:4096]), 1):
        where = f" (a NUL byte at offset {raw.find(0)})" if b"\x00" in raw else ""
        raise LogError(f"{source}: is not text{where}; export the log as CSV or Parquet")
    try:
        if not raw.isascii():  # the usual log needs no copy as text
            raw.decode()
    except UnicodeDecodeError:
        raw = raw.decode("latin-1").encode()
        notes.append("text is not UTF-8 and was read as latin-1")
    return raw.replace(b"\r", b"\n") if b"\n" not in raw else raw, notes


def _leading_lines(text: bytes, rows: int = 400) -> list[tuple[int, str]]:
    """Return the first lines with their numbers: comments, header, and a sample of rows."""
    lines: list[tuple[int, str]] = []
    for raw in io.BytesIO(text):
        line = raw.removesuffix(b"\n").decode(errors="replace").rstrip("\r")
        lines.append((len(lines), line))
        rows -= bool(line.strip()) and not is_comment(line)
        if not rows:
            break
    return lines


def _delimiter(lines: list[str]) -> str:
    """Return the delimiter that splits most lines into equally many cells, mostly numbers."""
    best, score = ",", (0, 0, 0)
    for candidate in _DELIMITERS:
        rows = [split_cells(line, candidate) for line in lines]
        numeric, width = _numeric_rows(rows)
        counts = Counter(len(row) for row in rows if row)
        if not numeric and counts:
            width = counts.most_common(1)[0][0]
        cells = [cell for i in numeric for cell in rows[i]] or list(chain(*rows))
        share = round(100 * sum(map(has_value, cells)) / max(1, len(cells)))
        voted = (len(numeric), counts[width] if width else 0, share)
        if width > 1 and voted > score:
            best, score = candidate, voted
    if best == ",":
        rows = [split_cells(line, ",") for line in lines]
        top = _header_row(rows, _first_row(rows))
        if top >= 0 and len(rows[top]) == 1 and all(len(row) <= 2 for row in rows[top + 1 :]):
            return ";"  # one name above "0,5": one column with decimal commas
    return best


def _numeric_rows(rows: Sequence[Sequence[str]]) -> tuple[list[int], int]:
    """Return the rows that are mostly numbers and as wide as most of these, and their width."""
    mostly = [
        i
        for i, row in enumerate(rows)
        if any(map(has_value, row)) and 2 * sum(not cell or has_value(cell) for cell in row) >= len(row)
    ]
    if not mostly:
        return [], 0
    width = Counter(len(rows[i]) for i in mostly).most_common(1)[0][0]
    return [i for i in mostly if len(rows[i]) == width], width


def _first_row(rows: Sequence[Sequence[str]]) -> int:
    """Return the first row of numbers in the columns that hold numbers, else the row below the header."""
    numeric, width = _numeric_rows(rows)
    if not numeric:
        usual = Counter(map(len, rows)).most_common(1)[0][0]
        top = next(i for i, row in enumerate(rows) if len(row) == usual)
        return top + 1 + (len(rows) > top + 1 and is_unit_row(rows[top + 1], rows[top]))

    def holds(row: Sequence[str]) -> bool:
        good = [is_number(row[k]) or is_list(row[k]) for k in columns or [0]]
        return good[0] and 2 * sum(good) >= len(columns)

    cells = enumerate(zip(*(rows[i] for i in numeric), strict=True))
    counts = [(k, max(sum(map(kind, column)) for kind in (is_number, is_list))) for k, column in cells]
    columns = [k for k, count in counts if 2 * count > len(numeric)]
    start = above = next((i for i in numeric if holds(rows[i])), numeric[0])
    while above and len(rows[above - 1]) > 1 and all(map(has_value, rows[above - 1])):
        above -= 1
    named = above and len(rows[above - 1]) == width and not any(map(has_value, rows[above - 1]))
    return above if named else start


def _header_row(rows: Sequence[Sequence[str]], start: int) -> int:
    """Return the last row without a number above the row ``start``, -1 for none."""
    above = range(min(start, len(rows) - 1), -1, -1)
    return next((i for i in above if not any(map(has_value, rows[i]))), -1)


def _halved(cells: Sequence[Sequence[str]], start: int, source: str) -> bool:
    """Whether commas cut every number in two, decimal sign and delimiter alike; LogError where they cut only some."""
    top = _header_row(cells, start)
    names = [cell for cell in cells[top] if cell] if top >= 0 else []
    rows = [row[:-1] if row and not row[-1] else row for row in cells[top + 1 :]]
    wide = [row for row in rows if len(names) < len(row) <= 2 * len(names)]
    if not names or 2 * len(wide) <= len(rows) or not all(map(_INTEGER.match, chain(*rows))):
        return False
    if all(len(row) == 2 * len(names) and all(cell[0].isdigit() for cell in row[1::2]) for row in rows):
        return True
    raise LogError(
        f"{source}: the comma stands between the columns and is the decimal sign as well ({len(names)} names, "
        f"{min(map(len, rows))} to {max(map(len, rows))} cells a row); export with semicolons or with decimal points"
    )


def _decimal(rows: list[list[str]], source: str) -> tuple[str, str]:
    """Return the decimal sign and the sign between thousands ("" for none)."""
    cells = [cell for row in rows for cell in row if is_number(cell)]
    commas = [cell for cell in cells if "," in cell]
    points = [cell for cell in cells if "." in cell]
    both = next((cell for cell in commas if "." in cell), None)
    if both:
        return (",", ".") if both.rfind(",") > both.rfind(".") else (".", ",")
    if commas and points:
        raise LogError(
            f"{source}: {commas[0]!r} and {points[0]!r} use different decimal signs; export with one"
        )
    return ("," if commas else "."), ""
