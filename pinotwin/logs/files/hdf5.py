"""HDF5, and MATLAB v7.3 files, which are HDF5 with arrays transposed.

Transposition needs no care here: a matrix is split along the axis of the log's length either way.
"""

from __future__ import annotations

from pathlib import Path

import h5py

from pinotwin.logs.files.content import Content, damaged


def load(path: Path, source: str) -> Content:
    """Return the data sets of an HDF5 file; ``group/set`` becomes ``group.set``.

    The attribute ``unit`` or ``units`` of a data set is its unit.
    """
    content = Content()
    try:
        with h5py.File(path, "r") as file:
            _walk(file, "", content)
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        raise damaged(source, error) from None
    return content


def _walk(group: h5py.Group, prefix: str, content: Content) -> None:
    for key in group:
        if key.startswith("#"):  # MATLAB's store for cells and references
            continue
        name = f"{prefix}{key}"
        item = group.get(key)
        if isinstance(item, h5py.Group):
            _walk(item, f"{name}.", content)
        elif isinstance(item, h5py.Dataset):
            _take(name, item, content)
        else:
            content.left_out.append(name)


def _take(name: str, item: h5py.Dataset, content: Content) -> None:
    matlab = item.attrs.get("MATLAB_class", b"")
    matlab = matlab.decode() if isinstance(matlab, bytes) else str(matlab)
    if matlab in ("char", "cell", "function_handle") or "MATLAB_empty" in item.attrs:
        content.left_out.append(name)
        return
    for key in ("unit", "units"):
        unit = item.attrs.get(key)
        if isinstance(unit, bytes | str):
            content.units[name] = unit.decode() if isinstance(unit, bytes) else unit
    content.add(name, item[()])
