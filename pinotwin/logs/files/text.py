"""CSV and other tables in text, fast through Arrow, cell by cell only where that is refused.

Columns of words are left out with a note; a word among numbers is an error that names line, column and cell.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import LogError
from pinotwin.logs.files import arrow, cells
from pinotwin.logs.files.arrow import value_column
from pinotwin.logs.files.cells import MISSING, is_clock, is_comment, is_list, is_number, split_cells
from pinotwin.logs.files.clocks import Group, on_one_clock
from pinotwin.logs.files.content import Content, Seen
from pinotwin.logs.files.header import are_steps
from pinotwin.logs.files.layout import Layout, inspect_layout, line_start

_NULLS = sorted({x for m in MISSING for x in (m, m.upper(), m.capitalize())} | {"NaN", "-NaN"})
_ENDS = (b"eof", b"end", b"ende", b"[eof]", b"[end]", b"end of file")
_ASIDE = {
    "blank": "{} blank lines were skipped",
    "header": "{} repeated lines of the header were skipped",
    "end": "the mark of the file's end was skipped",
    "overrun": "{} overrun marks: samples were lost there",  # of LinuxCNC's halsampler, whose buffer was full
}
_TRAILING = " trailing"

Kinds = dict[str, Literal["text", "lists", "times"]]
"""Column -> what its cells hold, where they are no plain numbers: words, lists of numbers, dates or times of day."""


@dataclass(frozen=True)
class _Body:
    """The rows of numbers of a text log."""

    text: bytes  # bytes that hold the rows
    start: int  # offset of the first row
    end: int  # offset behind the last row
    names: tuple[str, ...]  # names of all columns
    layout: Layout  # the file's layout
    source: str  # the file's name, for messages
    lines: Ints | None = None  # line of the file of each row (from 0), where some were taken out
    notes: tuple[str, ...] = ()  # what was taken out

    @property
    def delimiter(self) -> str:
        """Delimiter of the rows: runs of blanks have become tabs."""
        return "\t" if self.layout.delimiter == " " else self.layout.delimiter

    def head(self, size: int) -> list[list[str]]:
        """Return the cells of the rows in the first ``size`` bytes."""
        lines = self.text[self.start : min(self.end, self.start + size)].decode(errors="replace").split("\n")
        whole = lines[:-1] if len(lines) > 1 and self.end > self.start + size else lines
        return [split_cells(row.rstrip("\r"), self.delimiter) for row in whole if row.strip()]

    def line(self, row: int) -> int:
        """Return the line of the file (from 1) that holds a row (from 0)."""
        return 1 + (row + self.layout.skip if self.lines is None else int(self.lines[row]))


def load(path: Path, source: str, seen: Seen | None = None, longest: int = 2_000_000) -> Content:
    """Return the columns of a text log; a first line of ``longest`` letters, a few thousand columns, is refused."""
    text = path.read_bytes()
    if len(text) > longest and not {10, 13} & set(text[:longest]):
        raise LogError(
            f"{source}: its first line is longer than {longest} letters; this is no log, export it again"
        )
    layout = inspect_layout(text, path.stem, source)
    body = _body(layout, source)
    kinds = _kinds(body)
    table = _parse(body, kinds, seen)
    if table is None or table.num_rows < body.text.count(b"\n", body.start, body.end) + 1:
        body = _cleaned(body)
        table = _parse(body, kinds)
    if table is None:
        table = _parse_slowly(body, kinds)
    units, stated = dict(layout.header.units), dict(layout.header.stated)
    content = Content(units=units, notes=[*layout.notes, *body.notes], stated=stated)
    content.place = lambda row: f"line {body.line(row)}"
    table = _spelled_out(table.select(layout.header.names), kinds, content)
    arrow.take(table, content, source, b"UNAVAILABLE" in layout.text)
    _set_clock(layout, content, source)
    return content


def _spelled_out(table: pa.Table, kinds: Kinds, content: Content) -> pa.Table:
    for i, name in enumerate(table.column_names):
        if kinds.get(name) == "lists":
            table = table.set_column(i, name, cells.lists(table.column(name).to_pylist()))
        elif kinds.get(name) == "times":
            seconds, notes = cells.seconds(table.column(name))
            table = table.set_column(i, name, pa.array(seconds))
            content.units[name] = "s"
            content.notes += [f"{name}: {note}" for note in notes]
    return table


def _set_clock(layout: Layout, content: Content, source: str) -> None:
    """Join the clocks of a file that has several; make that of one that has none but the time of each row."""
    arrays = content.arrays
    units, clocks = layout.header.units, layout.header.clocks
    if clocks:
        stamped = {clock: names for clock, names in clocks.items() if clock in arrays}
        groups = [
            Group(clock, np.asarray(arrays[clock], dtype=float), {n: arrays[n] for n in names if n in arrays})
            for clock, names in stamped.items()
        ]
        unit = next((units[c] for c in clocks if c in units), None)
        t, channels, notes = on_one_clock(groups, source)
        content.arrays = {"t": t, **channels}
        content.notes += notes
        content.units.update({"t": unit} if unit else {})
        return
    if any(map(is_clock, arrays)):
        return
    unit_of = content.units
    steps = (n for n, x in arrays.items() if are_steps(n, np.asarray(x, dtype=float), unit_of.get(n, "s")))
    if layout.step is not None:
        t, unit = np.arange(float(len(next(iter(arrays.values()), ())))) * layout.step, "s"
        said = f"made from the sample time {1e3 * layout.step:.6g} ms above the numbers"
    elif name := next(steps, ""):
        t, unit = np.cumsum(arrays[name], dtype=float) - float(arrays[name][0]), unit_of.get(name, "s")
        said = f"summed from {name}, the time of each row"
    else:
        return
    content.arrays = {"t": t, **arrays}
    content.units["t"] = unit
    content.notes.append(f"t: {said}")


def _body(layout: Layout, source: str) -> _Body:
    start, end = line_start(layout.text, layout.skip), len(layout.text)
    while end > start and layout.text[end - 1 : end] in b"\r\n ":
        end -= 1
    body = _Body(layout.text, start, end, tuple(layout.header.names), layout, source)
    if layout.comments or layout.header.clocks or layout.delimiter == " ":
        body = _cleaned(body)
    rows = body.head(1 << 16)
    if not rows:  # every row repeats the header
        raise LogError(f"{source}: has a header but no rows of numbers; record or export it again")
    if len(rows[0]) == len(body.names) + 1 and rows[0][-1] == "":
        return replace(body, names=(*body.names, _TRAILING))  # a delimiter ends every line
    return body


def _cleaned(body: _Body) -> _Body:
    """Take out what is no row, runs of blanks that delimit, and fill the rows of a file with several clocks."""
    if body.lines is not None:
        return body
    layout, width = body.layout, len(body.names)
    blanks, mark = layout.delimiter == " ", layout.delimiter.encode()
    # without a clock a row without a value still is a sample
    timed = layout.header.clocks or any(map(is_clock, body.names))
    empty = None if width == 1 else mark + b' "\t' if timed else b""
    header = {line.strip(b" \r") for line in body.text[: body.start].split(b"\n")} - {b""}
    kept, numbers, taken = [], [], dict.fromkeys(_ASIDE, 0)
    for i, row in enumerate(body.text[body.start : body.end].split(b"\n"), start=layout.skip):
        bare = row.strip(b" \r")
        aside = _aside(bare, empty, header)
        if aside:
            taken[aside] += 1
        elif aside is None:
            row = b"\t".join(bare.split()) if blanks else row
            kept.append(_filled(row, mark, width) if layout.header.clocks and not blanks else row)
            numbers.append(i)
    text = b"\n".join(kept)
    notes = tuple(said.format(taken[what]) for what, said in _ASIDE.items() if taken[what])
    return replace(body, text=text, start=0, end=len(text), lines=np.array(numbers), notes=notes)


def _aside(bare: bytes, empty: bytes | None, header: set[bytes]) -> str | None:
    """Return what a line between the rows is, "" for a comment, None for a row; ``empty``: letters of no value."""
    if empty is not None and not bare.strip(empty):
        return "blank"
    if bare in header:
        return "header"
    if bare.strip(b" ;,\t").lower() in _ENDS:
        return "end"
    if bare == b"overrun":
        return "overrun"
    return "" if is_comment(bare[:8].decode(errors="replace")) else None


def _filled(row: bytes, mark: bytes, width: int) -> bytes:
    """Return a row that ended with the clocks that still run, with all its cells."""
    cells = [cell.strip() for cell in row.split(mark)]
    while len(cells) > width and not cells[-1]:
        cells.pop()
    return mark.join(cells + [b""] * (width - len(cells)))


def _kinds(body: _Body) -> Kinds:
    """Return what the columns hold, from a sample of rows."""
    rows, kinds = body.head(1 << 18), Kinds()
    for i, name in enumerate(body.names):
        sample = [row[i] for row in rows if i < len(row) and row[i]]
        if sample and all(map(cells.is_stamp, sample)):
            kinds[name] = "times"
        elif sample and all(map(is_list, sample)):
            kinds[name] = "lists"
        elif sum(not is_number(cell) for cell in sample) > 0.5 * len(sample):
            kinds[name] = "text"
    value = value_column(body.names, [name for name, kind in kinds.items() if kind == "text"])
    return kinds if value is None else {value: "text", **kinds}


class _Watched(io.RawIOBase):
    """Bytes that tell how far they were read."""

    def __init__(self, text: memoryview, seen: Seen) -> None:
        self._text, self._at, self._seen = text, 0, seen

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        part = self._text[self._at :] if size < 0 else self._text[self._at : self._at + size]
        self._at += len(part)
        self._seen(self._at / max(len(self._text), 1))
        return bytes(part)


def _read(body: _Body, types: dict[str, pa.DataType], seen: Seen | None = None) -> pa.Table:
    text = memoryview(body.text)[body.start : body.end]
    rows = pa.BufferReader(pa.py_buffer(text)) if seen is None else _Watched(text, seen)
    point = body.layout.decimal
    single = len(body.names) == 1  # there a blank line is a missing value
    return pacsv.read_csv(
        rows,
        pacsv.ReadOptions(column_names=body.names, block_size=1 << 22),
        pacsv.ParseOptions(delimiter=body.delimiter, ignore_empty_lines=not single),
        pacsv.ConvertOptions(check_utf8=False, column_types=types, null_values=_NULLS, decimal_point=point),
    )


def _parse(body: _Body, kinds: Kinds, seen: Seen | None = None) -> pa.Table | None:
    """Return the table, or None if some cell or row is not what its column promises."""
    types = {name: pa.string() if name in kinds else pa.float64() for name in body.names}
    try:
        return _read(body, types, seen)
    except pa.ArrowInvalid:
        return None


def _parse_slowly(body: _Body, kinds: Kinds) -> pa.Table:
    """Read every cell as text first; forgive blanks and plus signs, name what is no number."""
    try:
        table = _read(body, {name: pa.string() for name in body.names})
    except pa.ArrowInvalid as error:
        raise _ragged(body) or LogError(
            f"{body.source}: cannot be parsed ({str(error).splitlines()[0][:80]}); export it again"
        ) from None
    pairs = ((name, column.to_pylist()) for name, column in zip(body.names, table.columns, strict=True))
    return pa.table({name: x if name in kinds else _numbers(x, name, body) for name, x in pairs})


def _numbers(column: list[str], name: str, body: _Body) -> Floats:
    out = np.full(len(column), np.nan)
    thousands = body.layout.thousands
    foreign = "." if body.layout.decimal == "," else ","  # 1.234 would mean something else there
    for row, cell in enumerate(column):
        bare = cell.strip()
        if bare.lower() in MISSING:
            continue
        last = max(bare.rfind("."), bare.rfind(","))
        if is_number(bare) and (thousands or (foreign in bare and bare[last] == body.layout.decimal)):
            bare = bare.replace(foreign, "")
        if not is_number(bare) or foreign in bare:
            raise LogError(
                f"{body.source}: line {body.line(row)}, column {name!r}: {cell!r} is not a number"
                f"; correct the cell or delete the line"
            )
        out[row] = float(bare.replace(",", "."))
    return out


def _ragged(body: _Body) -> LogError | None:
    """Return the error for the first row that has not as many cells as there are names."""
    rows = body.text[body.start : body.end].decode(errors="replace").split("\n")
    for i, row in enumerate(rows):
        found = len(split_cells(row.rstrip("\r"), body.delimiter))
        if found != len(body.names) and row.strip():
            last = i == len(rows) - 1
            remedy = "the log was cut off, delete this last line" if last else "correct the line"
            return LogError(
                f"{body.source}: line {body.line(i)} has {found} cells where {len(body.names)} "
                f"are expected; {remedy}"
            )
    return None
