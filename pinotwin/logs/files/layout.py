"""How a text log is laid out: encoding, delimiter, decimal sign, header, unit row, comments.

Everything is decided from the first lines and stated in a ``Layout``; nothing is guessed twice.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from dataclasses import dataclass, field

from pinotwin.errors import LogError
from pinotwin.units import SI_FACTOR

COMMENTS = ("#", "%", "//")
MISSING = (
    "",
    "nan",
    "na",
    "n/a",
    "#n/a",
    "null",
    "none",
    "-",
    "--",
    "?",
    "-nan",
    "nan(ind)",
    "-nan(ind)",
)

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$|[+-]?inf(inity)?$", re.I)
_SAMPLE = 200
_WHITESPACE = " "


@dataclass(frozen=True)
class Layout:
    """Layout of one text file.

    Attributes:
        text: the whole file as UTF-8, without byte-order mark.
        delimiter: comma, semicolon, tab, or a space for runs of blanks.
        decimal: decimal sign.
        names: column names.
        units: name -> unit from a row of units beneath the header.
        skip: physical lines before the first row of numbers.
        comments: whether comment lines may occur after that.
        notes: what was noticed.
    """

    text: bytes
    delimiter: str
    decimal: str
    names: tuple[str, ...]
    skip: int
    comments: bool
    units: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def inspect_layout(raw: bytes, stem: str, source: str) -> Layout:
    """Return the layout of a text log.

    Args:
        raw: the file's bytes.
        stem: the file's name without ending; headerless columns are ``stem[0]``, ``stem[1]``...
        source: the file's name, for messages.

    Raises:
        LogError: it is not a table of numbers.
    """
    text, notes = _decode(raw, source)
    numbered = _leading_lines(text)
    body = [(i, line) for i, line in numbered if line.strip() and not is_comment(line)]
    if not body:
        raise LogError(f"{source}: holds no lines of data; record or export it again")
    delimiter = _delimiter([line for _, line in body])
    cells = [split_cells(line, delimiter) for _, line in body]
    headers, units_row = _header_rows(cells, source)
    first = headers + units_row
    if first >= len(body):
        raise LogError(f"{source}: has a header but no rows of numbers; record or export it again")
    decimal = _decimal(cells[first:], delimiter, source)
    if headers:
        names = _header_names(cells[0], stem)
    else:
        names = _commented_names(numbered, body[0][0], delimiter, len(cells[0]))
        names = names or [f"{stem}[{i}]" for i in range(len(cells[0]))]
    units = dict(zip(names, cells[1], strict=False)) if units_row else {}
    skip = body[first][0]
    marks = tuple(mark.encode() for mark in COMMENTS)
    # The search for the bare mark is ten times as fast, and almost always the only one.
    rest = any(mark in text and b"\n" + mark in text for mark in marks)
    return Layout(
        text,
        delimiter,
        decimal,
        tuple(names),
        skip,
        rest,
        {k: u.strip("[]() ") for k, u in units.items() if u},
        tuple(notes),
    )


def split_cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of one line, without the blanks around them."""
    if delimiter == _WHITESPACE:
        return line.split()
    try:
        cells = next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:  # a stray carriage return, or a cell beyond csv's limit
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def is_number(cell: str) -> bool:
    """Whether a cell is a number or one of the marks of a missing one."""
    return _NUMBER.match(cell) is not None or cell.lower() in MISSING


def _decode(raw: bytes, source: str) -> tuple[bytes, list[str]]:
    """Return the text as UTF-8 bytes with plain line ends."""
    notes: list[str] = []
    if raw.startswith(codecs.BOM_UTF8):
        raw = raw[3:]
    elif raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raw = _recode(raw, "utf-16", source)
    elif raw[1:64:2].count(0) >= 0.9 * len(raw[1:64:2]) > 0:
        raw = _recode(raw, "utf-16-le", source)
    if b"\x00" in raw or _control_share(raw[:4096]) > 0.02:
        where = f" (a NUL byte at offset {raw.find(0)})" if b"\x00" in raw else ""
        raise LogError(f"{source}: is not text{where}; export the log as CSV or Parquet")
    if not raw.isascii():
        try:
            codecs.lookup("utf-8").decode(raw)
        except UnicodeDecodeError:
            raw = raw.decode("latin-1").encode()
            notes.append("text is not UTF-8 and was read as latin-1")
    if b"\r" in raw and b"\n" not in raw:
        raw = raw.replace(b"\r", b"\n")
    return raw, notes


def _recode(raw: bytes, encoding: str, source: str) -> bytes:
    try:
        return raw.decode(encoding).encode()
    except UnicodeDecodeError:
        raise LogError(f"{source}: is damaged UTF-16 text; export it again as UTF-8") from None


def _control_share(raw: bytes) -> float:
    return sum(byte < 32 and byte not in b"\t\n\r\f" for byte in raw) / max(len(raw), 1)


def is_comment(line: str) -> bool:
    """Whether a line is a comment; Excel's ``#N/A`` is a missing value."""
    bare = line.lstrip()
    return bare.startswith(COMMENTS) and not bare.upper().startswith("#N/A")


def _leading_lines(text: bytes) -> list[tuple[int, str]]:
    """Return the first lines with their numbers: comments, header, and a sample of rows."""
    lines: list[tuple[int, str]] = []
    rows = start = 0
    while start < len(text) and rows < _SAMPLE:
        end = text.find(b"\n", start)
        end = len(text) if end < 0 else end
        line = text[start:end].decode(errors="replace").rstrip("\r")
        lines.append((len(lines), line))
        rows += bool(line.strip()) and not is_comment(line)
        start = end + 1
    return lines


def _delimiter(lines: list[str]) -> str:
    """Return the delimiter that splits most lines into equally many cells, mostly numbers."""
    best, score = ",", (0, 0, -9)
    for candidate in ("\t", ";", ",", _WHITESPACE):
        rows = [split_cells(line, candidate) for line in lines]
        counts = Counter(map(len, rows))
        counts.pop(0, None)
        width, votes = counts.most_common(1)[0] if counts else (0, 0)
        numbers = sum(is_number(cell) for row in rows for cell in row)
        share = round(100 * numbers / max(1, sum(map(len, rows))))
        if width > 1 and (votes, share, -_preference(candidate)) > score:
            best, score = candidate, (votes, share, -_preference(candidate))
    if len(split_cells(lines[0], best)) == 1 and not is_number(lines[0].strip()):
        return ";"  # one name above "0,5": one column with decimal commas
    return best


def _preference(candidate: str) -> int:
    # On a tie: "1,5;2,5" and "1,5<tab>2,5" have decimal commas, "1, 2" has comma and blank.
    return {"\t": 1, ";": 2, ",": 3, _WHITESPACE: 4}[candidate]


def _header_rows(cells: list[list[str]], source: str) -> tuple[int, int]:
    """Return how many header rows (0 or 1) and rows of units (0 or 1) there are."""
    words = [c for c in cells[0] if not is_number(c)]
    if not words:
        return 0, 0
    if len(cells) > 1 and len(words) < len(cells[0]) / 2 and not any(map(is_number, cells[1])):
        raise LogError(f"{source}: line 1 is neither a header nor numbers; add a header line")
    if len(cells) > 1:
        second = [c.strip("[]() ") for c in cells[1] if c]
        if second and all(c in SI_FACTOR and not c.isdigit() for c in second if c != "-"):
            return 1, int(any(c != "-" for c in second))
    return 1, 0


def _header_names(header: list[str], stem: str) -> list[str]:
    return [name or f"{stem}[{i}]" for i, name in enumerate(header)]


def _commented_names(lines: list[tuple[int, str]], stop: int, delimiter: str, width: int) -> list[str]:
    """Return the names in the last comment above the numbers, if they fit (``# t, q, u``)."""
    above = [line for i, line in lines if i < stop and is_comment(line)]
    names = split_cells(above[-1].strip().lstrip("#%/ "), delimiter) if above else []
    fits = len(names) == width and all(n and not is_number(n) for n in names)
    return names if fits else []


def _decimal(rows: list[list[str]], delimiter: str, source: str) -> str:
    cells = [cell for row in rows for cell in row if is_number(cell)]
    commas = [cell for cell in cells if "," in cell]
    if delimiter == "," and not commas:
        return "."
    if commas and any("." in cell for cell in cells):
        point = next(cell for cell in cells if "." in cell)
        raise LogError(f"{source}: {commas[0]!r} and {point!r} use different decimal signs; export with one")
    return "," if commas else "."
