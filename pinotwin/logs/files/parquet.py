"""Apache Parquet."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pinotwin.errors import LogError
from pinotwin.logs.files import arrow
from pinotwin.logs.files.content import Content, limited, undamaged


def load(path: Path, source: str) -> Content:
    """Return the columns of a Parquet file and their units; lists as ``meta/info.json`` (LeRobot) names them."""
    content = Content(parts=_parts(path))
    with undamaged(source, (pa.ArrowException, OSError, ValueError, MemoryError, OverflowError)):
        meta = pq.read_metadata(path)
        leaves = [meta.schema.column(j) for j in range(meta.num_columns)]
        sizes = [max(1, (leaf.length or 0) // 8) for leaf in leaves]
        groups = [meta.row_group(k) for k in range(meta.num_row_groups)]
        chunks = [(group.column(j), size) for group in groups for j, size in enumerate(sizes)]
        held = sum(max(c.num_values * size, c.total_uncompressed_size // 8) for c, size in chunks)
        limited(source, held, path.stat().st_size)
        # one text may fill all rows
        texts = [leaf.path for leaf in leaves if leaf.physical_type == "BYTE_ARRAY"]
        table = pq.ParquetFile(path, read_dictionary=texts).read()
    for field in table.schema:
        unit = (field.metadata or {}).get(b"unit")
        if unit:
            content.units[field.name] = unit.decode(errors="replace")
    if table.num_rows == 0:
        raise LogError(f"{source}: has columns but no rows; record or export it again")
    arrow.take(table.flatten(), content, source)
    return content


def _parts(path: Path) -> dict[str, list[str]]:
    """Return column -> names of its parts, from the ``meta/info.json`` of a LeRobot data set."""
    places = [folder / "meta" / "info.json" for folder in path.resolve().parents[:4]]
    meta = next(filter(Path.is_file, places), None)
    if meta is None:
        return {}
    try:
        features = json.loads(meta.read_text(encoding="utf-8"))["features"]
        return {column: _flat(feature.get("names")) for column, feature in features.items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return {}


def _flat(names: object) -> list[str]:
    """Return the names of a feature: a list, or lists by kind (``{"motors": [...]}``)."""
    if isinstance(names, dict):
        return [part for inner in names.values() for part in _flat(inner)]
    return [str(name) for name in names] if isinstance(names, list) else []
