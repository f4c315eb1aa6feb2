"""HDF5, and MATLAB v7.3 files: HDF5 with arrays transposed, which the split along the log's length undoes."""

from __future__ import annotations

from pathlib import Path

import h5py

from pinotwin.logs.files.content import Content, held, limited, undamaged


def load(path: Path, source: str) -> Content:
    """Return the data sets of an HDF5 file as ``group.set``; their attribute ``unit`` or ``units`` is their unit."""
    content = Content()
    with undamaged(source), h5py.File(path, "r") as file:
        sets = _sets(file, "", content, set())
        limited(source, sum((item.size or 0) * held(item.dtype) for _, item in sets), path.stat().st_size)
        for name, item in sets:
            _take(name, item, content)
    return content


def _sets(
    group: h5py.Group, prefix: str, content: Content, seen: set[object]
) -> list[tuple[str, h5py.Dataset]]:
    """Return the data sets of a group once each, by their first name; links to other files are left out."""
    out: list[tuple[str, h5py.Dataset]] = []
    for key in group:
        if key.startswith("#"):  # MATLAB's store for cells and references
            continue
        name = f"{prefix}{key}"
        if isinstance(group.get(key, getlink=True), h5py.ExternalLink):
            content.left_out.append(name)
            content.notes.append(f"{name}: a link to another file, not followed; join the files by a+b")
            continue
        item = group.get(key)
        if isinstance(item, h5py.Group):
            if item.id not in seen:  # groups may be linked to each other, even in rings
                seen.add(item.id)
                out += _sets(item, f"{name}.", content, seen)
        elif isinstance(item, h5py.Dataset) and not (item.external or item.is_virtual):
            out.append((name, item))
        else:
            content.left_out.append(name)
    return out


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
