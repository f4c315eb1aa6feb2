"""Writing a log, whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import InputError
from pinotwin.system.writing import whole_file


def write_log(path: Path | str, log: Mapping[str, Floats]) -> Path:
    """Write channels, ``t`` first, as CSV, or as Parquet by the suffix of ``path``, and return it."""
    path = Path(path)
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"{path}: a log is written as .csv or .parquet, not {path.suffix!r}")
    with whole_file(path) as part:
        if path.suffix == ".parquet":
            import pyarrow as pa
            import pyarrow.parquet as pq

            pq.write_table(pa.table({k: np.asarray(x) for k, x in log.items()}), part)
            return path
        table = np.column_stack([np.asarray(x) for x in log.values()])
        np.savetxt(part, table, fmt="%.12g", delimiter=",", header=",".join(log), comments="")
    return path
