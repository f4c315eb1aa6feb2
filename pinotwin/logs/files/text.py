"""CSV and other tables in text, fast through Arrow, cell by cell only where that is refused.

A column whose cells are mostly words is text and is left out with a note; a word in a column of
numbers is an error that names line, column and cell.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import LogError
from pinotwin.logs.files import arrow
from pinotwin.logs.files.content import Content
from pinotwin.logs.files.layout import (
    MISSING,
    Layout,
    inspect_layout,
    is_comment,
    is_number,
    split_cells,
)

_NULLS = sorted({x for m in MISSING for x in (m, m.upper(), m.capitalize())} | {"NaN", "-NaN"})
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_TRAILING = " trailing"


@dataclass(frozen=True)
class _Body:
    """The rows of numbers of a text log.

    Attributes:
        text: bytes that hold the rows.
        start: offset of the first row.
        end: offset behind the last row.
        names: names of all columns.
        layout: the file's layout.
        source: the file's name, for messages.
        lines: line of the file of each row (from 0), where comments or blanks were taken out.
    """

    text: bytes
    start: int
    end: int
    names: tuple[str, ...]
    layout: Layout
    source: str
    lines: Ints | None = None

    @property
    def delimiter(self) -> str:
        """Delimiter of the rows: runs of blanks have become tabs."""
        return "\t" if self.layout.delimiter == " " else self.layout.delimiter

    def head(self, size: int) -> list[list[str]]:
        """Return the cells of the rows in the first ``size`` bytes."""
        rows = self.text[self.start : min(self.end, self.start + size)].decode(errors="replace")
        lines = rows.split("\n")
        whole = lines[:-1] if len(lines) > 1 and self.end > self.start + size else lines
        return [split_cells(row.rstrip("\r"), self.delimiter) for row in whole if row.strip()]

    def line(self, row: int) -> int:
        """Return the line of the file (from 1) that holds a row (from 0)."""
        if self.lines is not None:
            return int(self.lines[row]) + 1
        return row + self.layout.skip + 1


def load(path: Path, source: str) -> Content:
    """Return the columns of a text log."""
    layout = inspect_layout(path.read_bytes(), path.stem, source)
    arrow.refuse_repeated(list(layout.names), source)
    body = _body(layout, source)
    text, dates = _text_columns(body)
    notes = list(layout.notes)
    table = _parse(body, text, dates)
    rows = body.text.count(b"\n", body.start, body.end) + 1
    if table is None or table.num_rows < rows:
        body = _without_comments(body)
        if body.lines is not None and len(body.lines) < rows and not layout.comments:
            notes.append(f"{rows - len(body.lines)} blank lines were skipped")
        table = _parse(body, text, dates)
    if table is None:
        table = _parse_slowly(body, text)
    content = Content(units=dict(layout.units), notes=notes)
    content.place = lambda row: f"line {body.line(row)}"
    arrow.take(table.select(list(layout.names)), content, source)
    return content


def _body(layout: Layout, source: str) -> _Body:
    start = 0
    for _ in range(layout.skip):
        start = layout.text.find(b"\n", start) + 1
    end = len(layout.text)
    while end > start and layout.text[end - 1 : end] in b"\r\n ":
        end -= 1
    body = _Body(layout.text, start, end, layout.names, layout, source)
    if layout.comments or layout.delimiter == " ":
        body = _without_comments(body)
    first = body.head(1 << 16)[0]
    if len(first) == len(body.names) + 1 and first[-1] == "":
        return replace(body, names=(*body.names, _TRAILING))  # a delimiter ends every line
    return body


def _without_comments(body: _Body) -> _Body:
    """Take comment and blank lines out, and runs of blanks where these delimit."""
    if body.lines is not None:
        return body
    blanks, single = body.layout.delimiter == " ", len(body.names) == 1
    kept, numbers = [], []
    rows = body.text[body.start : body.end].split(b"\n")
    for i, row in enumerate(rows, start=body.layout.skip):
        bare = row.strip()
        if (bare or single) and not is_comment(bare[:8].decode(errors="replace")):
            kept.append(b"\t".join(bare.split()) if blanks else row)
            numbers.append(i)
    text = b"\n".join(kept)
    return replace(body, text=text, start=0, end=len(text), lines=np.array(numbers))


def _text_columns(body: _Body) -> tuple[set[str], set[str]]:
    """Return the columns whose sampled cells are mostly words, and those of dates."""
    rows = body.head(1 << 18)
    text, dates = set(), set()
    for i, name in enumerate(body.names):
        cells = [row[i] for row in rows if i < len(row) and row[i]]
        if cells and all(_DATE.match(cell) for cell in cells):
            dates.add(name)
        elif sum(not is_number(cell) for cell in cells) > 0.5 * len(cells):
            text.add(name)
    return text, dates


def _read(body: _Body, types: dict[str, pa.DataType]) -> pa.Table:
    rows = pa.BufferReader(pa.py_buffer(memoryview(body.text)[body.start : body.end]))
    single = len(body.names) == 1  # there a blank line is a missing value
    return pacsv.read_csv(
        rows,
        pacsv.ReadOptions(column_names=body.names, block_size=1 << 22),
        pacsv.ParseOptions(delimiter=body.delimiter, ignore_empty_lines=not single),
        pacsv.ConvertOptions(
            column_types=types,
            null_values=_NULLS,
            decimal_point=body.layout.decimal,
            strings_can_be_null=False,
            check_utf8=False,
        ),
    )


def _parse(body: _Body, text: set[str], dates: set[str]) -> pa.Table | None:
    """Return the table, or None if some cell or row is not what its column promises."""
    types = {name: pa.string() if name in text else pa.float64() for name in body.names}
    types.update({name: pa.timestamp("ns") for name in dates})
    try:
        return _read(body, types)
    except pa.ArrowInvalid:
        return None


def _parse_slowly(body: _Body, text: set[str]) -> pa.Table:
    """Read every cell as text first; forgive blanks and plus signs, name what is no number."""
    try:
        table = _read(body, {name: pa.string() for name in body.names})
    except pa.ArrowInvalid as error:
        raise _ragged(body) or LogError(
            f"{body.source}: cannot be parsed ({str(error).splitlines()[0][:80]}); export it again"
        ) from None
    columns = {
        name: column.to_pylist() if name in text else _numbers(column.to_pylist(), name, body)
        for name, column in zip(body.names, table.columns, strict=True)
    }
    return pa.table(columns)


def _numbers(cells: list[str], name: str, body: _Body) -> Floats:
    out = np.empty(len(cells))
    foreign = "." if body.layout.decimal == "," else ","  # 1.234 would mean something else there
    for row, cell in enumerate(cells):
        bare = cell.strip()
        if bare.lower() in MISSING:
            out[row] = np.nan
            continue
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
        cells = len(split_cells(row.rstrip("\r"), body.delimiter))
        if cells != len(body.names) and row.strip():
            last = i == len(rows) - 1
            remedy = "the log was cut off, delete this last line" if last else "correct the line"
            return LogError(
                f"{body.source}: line {body.line(i)} has {cells} cells where {len(body.names)} "
                f"are expected; {remedy}"
            )
    return None
