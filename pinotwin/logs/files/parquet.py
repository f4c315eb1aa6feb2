"""Apache Parquet."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pinotwin.errors import LogError
from pinotwin.logs.files import arrow
from pinotwin.logs.files.content import Content, damaged, limited


def load(path: Path, source: str) -> Content:
    """Return the columns of a Parquet file; a column's metadata key ``unit`` is its unit."""
    content = Content()
    try:
        file = pq.ParquetFile(path)
        limited("", file.metadata.num_rows * file.metadata.num_columns)
        table = file.read()
    except (pa.ArrowException, OSError, ValueError, MemoryError, OverflowError) as error:
        raise damaged(source, error) from None
    for field in table.schema:
        unit = (field.metadata or {}).get(b"unit")
        if unit:
            content.units[field.name] = unit.decode(errors="replace")
    if table.num_rows == 0:
        raise LogError(f"{source}: has columns but no rows; record or export it again")
    arrow.take(table.flatten(), content)
    return content
