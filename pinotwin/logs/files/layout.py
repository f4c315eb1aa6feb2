"""How a text log is laid out: encoding, delimiter, decimal sign, header, unit row, comments.

The numbers are found first: the rows that have most in common. What stands right above them is their
header and units, what stands above that is kept as notes (:mod:`pinotwin.logs.files.preamble`).
Everything is decided from the first lines and stated in a ``Layout``; nothing is guessed twice.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

from pinotwin.errors import LogError
from pinotwin.logs.files.content import distinct, repeated
from pinotwin.logs.files.dialects import plain
from pinotwin.logs.files.preamble import UNIT_TITLES, read_preamble
from pinotwin.units import SI_FACTOR, find_unit

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
    "unavailable",  # MTConnect
)
CLOCK_NAMES = ("t", "time", "zeit", "timestamp", "time stamp", "temps", "tiempo", "x_value")

_NUMBER = re.compile(
    r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$|[+-]?inf(inity)?$"
    r"|[+-]?\d{1,3}(,\d{3})+\.\d*$|[+-]?\d{1,3}(\.\d{3})+,\d*$",
    re.I,
)
_LIST = re.compile(r"[\[(].*[\])]$", re.S)
_SEP = re.compile(r"\"?sep=(.)\"?[\s,;]*$", re.I)
_INTEGER = re.compile(r"[+-]?\d+(e[+-]?\d+)?$", re.I)
_HALVES = re.compile(rb"([+-]?\d+),(\d+(?:[eE][+-]?\d+)?)")
_ASIDE = tuple(b"\n" + mark.encode() for mark in COMMENTS)
_TIMES = ("s", "ms", "us", "µs", "ns")
_SAMPLE = 400
_WHITESPACE = " "


@dataclass(frozen=True)
class Layout:
    """Layout of one text file.

    Attributes:
        text: the whole file as UTF-8, without byte-order mark.
        delimiter: comma, semicolon, tab, bar, or a space for runs of blanks.
        decimal: decimal sign.
        names: column names.
        units: name -> unit from a row of units beneath the header, or from the lines above it.
        skip: physical lines before the first row of numbers.
        comments: whether comment lines may occur after that.
        notes: what was noticed.
        thousands: sign between groups of three digits, "" for none.
        clocks: clock column -> columns that it stamps, where a file has several.
        step: sample time that the lines above state [s], for a file without a time column.
        stated: name -> name that the file states for this column and others.
    """

    text: bytes
    delimiter: str
    decimal: str
    names: tuple[str, ...]
    skip: int
    comments: bool
    units: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    thousands: str = ""
    clocks: dict[str, tuple[str, ...]] = field(default_factory=dict)
    step: float | None = None
    stated: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class _Header:
    """What the rows above the numbers say of the columns."""

    names: list[str]
    units: dict[str, str]
    rows: int
    clocks: dict[str, tuple[str, ...]] = field(default_factory=dict)
    stated: dict[str, str] = field(default_factory=dict)


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
    if delimiter == "," and _halved(cells, start, source):
        at = line_start(text, body[start][0])
        whole = inspect_layout(text[:at] + _HALVES.sub(rb"\1.\2", text[at:]), stem, source)
        said = "the comma is delimiter and decimal sign: two cells each were joined to a number"
        return replace(whole, notes=(*notes, said, *whole.notes))
    decimal, thousands = _decimal(cells[start:], delimiter, source)
    header = _header(cells, start, stem)
    if grammar.names:
        named = distinct(grammar.names)
        header = _Header(named, grammar.units, 0, {}, repeated(named, grammar.names))
    names = header.names
    if not names:
        names = distinct(_commented_names(numbered, body[start][0], delimiter, len(cells[start])))
        names = names or [f"{stem}[{i}]" for i in range(len(cells[start]))]
    above = _above(numbered, body, start - header.rows, bool(stated))
    preamble = read_preamble(above, cells[: start - header.rows], names)
    first = line_start(text, body[start][0])
    return Layout(
        text,
        delimiter,
        decimal,
        tuple(names),
        body[start][0],
        any(text.find(mark, first) >= 0 for mark in _ASIDE)
        or text.find(b"\n" + delimiter.encode(), first) >= 0,
        {**preamble.units, **header.units},
        (*notes, *preamble.notes),
        thousands,
        header.clocks,
        preamble.step,
        header.stated,
    )


def line_start(text: bytes, line: int) -> int:
    """Return where a line (from 0) begins."""
    start = 0
    for _ in range(line):
        start = text.find(b"\n", start) + 1
    return start


def _halved(cells: Sequence[Sequence[str]], start: int, source: str) -> bool:
    """Whether commas cut every number in two: they are decimal sign and delimiter alike.

    Raises:
        LogError: they cut only some, and which cannot be told.
    """
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


def _header_row(rows: Sequence[Sequence[str]], start: int) -> int:
    """Return the last row without a number above the row ``start``, -1 for none."""
    return next((i for i in range(min(start, len(rows) - 1), -1, -1) if not any(map(_value, rows[i]))), -1)


def _above(
    numbered: Sequence[tuple[int, str]], body: Sequence[tuple[int, str]], header: int, stated: bool
) -> list[str]:
    """Return the lines above the header, comments among them unless there is nothing else."""
    stop = body[header][0]
    lines = [line for i, line in numbered if i < stop]
    return [] if all(is_comment(line) or not line.strip() for line in lines) else lines[int(stated) :]


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


def is_list(cell: str) -> bool:
    """Whether a cell holds a list of numbers: ``[0.1, 0.2]``."""
    return _LIST.match(cell) is not None and all(
        map(is_number, cell[1:-1].replace(",", " ").split() or ["x"])
    )


def is_clock(name: str) -> bool:
    """Whether a column is called as clocks are: ``Time``, ``Zeit [s]``, ``timestamp``."""
    bare = re.split(r"[\[(/]", name.strip())[0].strip(" _").casefold()
    return bare in CLOCK_NAMES or bare.startswith(("time ", "time_", "zeit")) or bare.endswith("timestamp")


def _value(cell: str) -> bool:
    return bool(cell) and (is_number(cell) or is_list(cell))


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
    best, score = ",", (0, 0, 0, -9)
    for candidate in ("\t", ";", "|", ",", _WHITESPACE):
        rows = [split_cells(line, candidate) for line in lines]
        numeric, width = _numeric_rows(rows)
        counts = Counter(map(len, rows))
        counts.pop(0, None)
        if not numeric and counts:
            width = counts.most_common(1)[0][0]
        cells = [cell for i in numeric for cell in rows[i]] or [c for row in rows for c in row]
        share = round(100 * sum(map(_value, cells)) / max(1, len(cells)))
        voted = (len(numeric), counts[width] if width else 0, share, -_preference(candidate))
        if width > 1 and voted > score:
            best, score = candidate, voted
    if best == ",":
        rows = [split_cells(line, ",") for line in lines]
        top = _header_row(rows, _first_row(rows))
        if top >= 0 and len(rows[top]) == 1 and all(len(row) <= 2 for row in rows[top + 1 :]):
            return ";"  # one name above "0,5": one column with decimal commas
    return best


def _preference(candidate: str) -> int:
    # On a tie: "1,5;2,5" and "1,5<tab>2,5" have decimal commas, "1, 2" has comma and blank.
    return {"\t": 1, ";": 2, "|": 3, ",": 4, _WHITESPACE: 5}[candidate]


def _numeric_rows(rows: Sequence[Sequence[str]]) -> tuple[list[int], int]:
    """Return the rows that are mostly numbers and as wide as most of these, and their width."""
    mostly = [i for i, row in enumerate(rows) if any(map(_value, row)) and _share(row) >= 0.5]
    if not mostly:
        return [], 0
    width = Counter(len(rows[i]) for i in mostly).most_common(1)[0][0]
    return [i for i in mostly if len(rows[i]) == width], width


def _share(row: Sequence[str]) -> float:
    """Return the share of cells that are numbers, lists, or missing."""
    return sum(not cell or _value(cell) for cell in row) / max(1, len(row))


def _first_row(rows: Sequence[Sequence[str]]) -> int:
    """Return the first row of numbers; without any, the row below the header (a table of words).

    The rows of numbers decide which columns hold numbers; the first row that has them there is it.
    A header block of ``Name;value`` rows does not: its first cell is a word.
    """
    numeric, width = _numeric_rows(rows)
    if not numeric:
        usual = Counter(map(len, rows)).most_common(1)[0][0]
        top = next(i for i, row in enumerate(rows) if len(row) == usual)
        return top + 1 + (len(rows) > top + 1 and _unit_row(rows[top + 1], rows[top]))
    columns = [k for k in range(width) if 2 * sum(is_number(rows[i][k]) for i in numeric) > len(numeric)]
    lists = [k for k in range(width) if 2 * sum(is_list(rows[i][k]) for i in numeric) > len(numeric)]
    lead = min((*columns, *lists), default=0)
    start = numeric[0]
    for i in numeric:
        good = sum(is_number(rows[i][k]) or is_list(rows[i][k]) for k in (*columns, *lists))
        if (is_number(rows[i][lead]) or is_list(rows[i][lead])) and 2 * good >= len(columns) + len(lists):
            start = i
            break
    return _with_ragged(rows, start, width)


def _with_ragged(rows: Sequence[Sequence[str]], start: int, width: int) -> int:
    """Return the row below the header if only rows of numbers of another width lie between."""
    above = start
    while above and len(rows[above - 1]) > 1 and all(map(_value, rows[above - 1])):
        above -= 1
    named = above and len(rows[above - 1]) == width and not any(map(_value, rows[above - 1]))
    return above if named else start


def _unit_row(row: Sequence[str], header: Sequence[str]) -> bool:
    """Whether a row under a header holds its units, one of which may be unknown."""
    bare = [cell for cell in row if cell and cell.strip("[]() ") not in ("", "-")]
    if not any(row) or any(cell.isdigit() for cell in bare) or len(row) > len(header) + 1:
        return False
    known = [cell for cell in bare if cell.strip("[]() ") in SI_FACTOR or find_unit(cell)]
    if all(re.fullmatch(r"[\[(].*[\])]", cell) for cell in row if cell not in ("", "-")):
        return bool(bare)
    return bool(bare) and 2 * len(known) > len(bare) and not any(map(_titled, header))


def _titled(cell: str) -> bool:
    return bool(cell) and _NUMBER.match(cell) is not None


def _header(cells: list[list[str]], start: int, stem: str) -> _Header:
    """Return names and units from the rows above the numbers; no names where none stand there."""
    width, above = len(cells[start]), [_trimmed(row, len(cells[start])) for row in cells[:start]]
    if not above:
        return _Header([], {}, 0)
    labelled = _labelled(above, width)
    if labelled is not None:
        return labelled
    units_row = len(above) > 1 and _unit_row(above[-1], above[-2])
    names = above[-1 - units_row]
    rows = 1 + units_row
    if not _names_columns(names, above[:-rows], width):
        return _Header([], {}, 0)
    if not names[-1] and not any(row[-1] for row in cells[start:] if len(row) == len(names)):
        names = names[:-1]  # a delimiter ends every line
    stated = [name or f"{stem}[{i}]" for i, name in enumerate(names)]
    titles, units = _under(above[-1 - rows][: len(names)] if len(above) > rows else [], stated)
    named = distinct(titles)
    for name, cell in zip(named, above[-1] if units_row else (), strict=False):
        unit = find_unit(cell) or cell.strip("[]() ")
        if unit and unit.casefold() not in UNIT_TITLES:
            units[name] = unit
    return _Header(named, units, rows + (titles != stated), _stamped(named), repeated(named, stated))


def _under(upper: Sequence[str], names: list[str]) -> tuple[list[str], dict[str, str]]:
    """Return the names below another row of names, and the units that stand in the lower for clocks in the upper.

    ``Axis X;;Axis Y;`` over ``pos;cur;pos;cur`` tells equal names apart; ``Time`` over ``ms`` is a clock.
    """
    words = [cell for cell in upper if cell]
    if len(upper) != len(names) or len(words) < 2 or any(map(is_number, words)):
        return names, {}
    counts, group = Counter(names), ""
    titles: list[str] = []
    units: dict[str, str] = {}
    for above, name in zip(upper, names, strict=True):
        group = above or group
        if is_clock(above) and find_unit(name) in _TIMES:
            units[above] = name
            titles.append(above)
        else:
            titles.append(f"{group} {name}" if counts[name] > 1 and group else name)
    return titles, units


def _trimmed(row: list[str], width: int) -> list[str]:
    """Return a row of names without the empty cells that a delimiter at its end makes."""
    end = len(row)
    while end > width and not row[end - 1]:
        end -= 1
    return row[:end]


def _names_columns(row: Sequence[str], above: Sequence[Sequence[str]], width: int) -> bool:
    """Whether a row right above the numbers is their header, not the last line of a block."""
    words = [cell for cell in row if not is_number(cell)]
    if not words or (len(row) == 1 and width > 1):
        return False
    if above and _is_pair(row) and _is_pair(above[-1]):
        return False  # "Samples;4000" under "Offset;0"
    return not above or len(row) == width or (len(row) > 1 and len(row) >= 0.6 * width)


def _is_pair(row: Sequence[str]) -> bool:
    kept = [cell for cell in row if cell]
    return len(kept) == 2 and not is_number(kept[0]) and is_number(kept[1])


def _labelled(above: list[list[str]], width: int) -> _Header | None:
    """Return the header of a scope whose rows begin with what they say, a clock a channel.

    A row ``Name  pos  Name  vel`` (TwinCAT; ``Channel name`` of a DAQ) puts its label over each clock and the
    channel's name over the channels that the clock stamps.
    """
    rows = {row[0].casefold(): row for row in above if len(row) > 1 and row[0]}
    names = next((row for label, row in rows.items() if label.split()[-1] == "name"), None)
    if names is None or not {"unit", "symbolname", "sampletime[ms]"} & set(rows):
        return None
    named, clocks, clock = [], dict[str, list[str]](), ""
    label = names[0]
    for i, name in enumerate([*names, *[label] * (width - len(names))][:width]):
        if name == label:
            clock = f"{label}#{i}"
            clocks[clock] = []
            named.append(clock)
        else:
            named.append(name or f"[{i}]")
            clocks[clock].append(named[-1])
    cells = rows.get("unit", [])
    units = {n: u for n, c in zip(named, cells, strict=False) if (u := find_unit(c)) and n not in clocks}
    time = "ms" if "sampletime[ms]" in rows else "s"
    units.update(dict.fromkeys(clocks, time))
    return _Header(named, units, len(above) - above.index(names), {k: tuple(v) for k, v in clocks.items()})


def _stamped(names: list[str]) -> dict[str, tuple[str, ...]]:
    """Return clock -> columns up to the next clock, where a header repeats its clock."""
    clocks: dict[str, list[str]] = {}
    bases = [re.sub(r"#\d+", "", name) for name in names]
    counts, clock = Counter(bases), ""
    for name, base in zip(names, bases, strict=True):
        if counts[base] > 1 and is_clock(base):
            clock = name
            clocks[clock] = []
        elif clock:
            clocks[clock].append(name)
    return {k: tuple(v) for k, v in clocks.items()} if names and names[0] in clocks else {}


def _commented_names(lines: list[tuple[int, str]], stop: int, delimiter: str, width: int) -> list[str]:
    """Return the names in the last comment above the numbers, if they fit (``# t, q, u``)."""
    above = [line for i, line in lines if i < stop and is_comment(line)]
    names = split_cells(above[-1].strip().lstrip("#%/ "), delimiter) if above else []
    fits = len(names) == width and all(n and not is_number(n) for n in names)
    return names if fits else []


def _decimal(rows: list[list[str]], delimiter: str, source: str) -> tuple[str, str]:
    """Return the decimal sign and the sign between thousands ("" for none)."""
    cells = [cell for row in rows for cell in row if is_number(cell)]
    both = [cell for cell in cells if "," in cell and "." in cell]
    if both:
        decimal = both[0][max(both[0].rfind(","), both[0].rfind("."))]
        return decimal, "." if decimal == "," else ","
    commas = [cell for cell in cells if "," in cell]
    if delimiter == "," and not commas:
        return ".", ""
    points = [cell for cell in cells if "." in cell]
    if commas and points:
        raise LogError(
            f"{source}: {commas[0]!r} and {points[0]!r} use different decimal signs; export with one"
        )
    return ("," if commas else "."), ""
