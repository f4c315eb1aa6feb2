"""Write a twin for other tools: which files there are, and what each leaves out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pinotwin.arrays import Floats
from pinotwin.errors import InputError, require
from pinotwin.export.inverse import Inverse, inverse_of
from pinotwin.export.mjcf import mjcf_files
from pinotwin.export.texts import c_text, left_out, numpy_text
from pinotwin.export.urdf_file import urdf_lines, urdf_text
from pinotwin.notebook import Card, Shown
from pinotwin.system.writing import as_path, write_bytes
from pinotwin.twin import Twin
from pinotwin.twin.twin import TwinLike, as_twin

SUFFIX = {"urdf": ".urdf", "mjcf": ".xml", "numpy": ".py", "c": ".c"}  # format -> suffix of its file


@dataclass(frozen=True, repr=False)
class Export(Card):
    """Files for another tool."""

    format: str  # ``urdf``, ``mjcf``, ``numpy`` or ``c``
    files: dict[str, bytes]  # name -> content
    inverse: Inverse  # the inverse model that they hold
    notes: tuple[str, ...]  # what they leave out, a line each

    def to_dict(self) -> dict[str, Any]:
        """Return what ``pinotwin export --json`` writes."""
        x = self.inverse
        columns = zip(x.names, x.units, x.error, x.travel.T, x.speed, strict=True)
        return {
            "machine": x.name,
            "format": self.format,
            "files": list(self.files),
            "left_out": list(self.notes),
            "axes": {
                name: {"unit": unit, "error": error, "range": travel, "speed": speed}
                for name, unit, error, travel, speed in columns
            },
        }

    def _shown(self) -> Shown:
        rows = [(name, f"{len(content)} bytes") for name, content in self.files.items()]
        return (f"Export as {self.format}", ("file", "size"), rows, "; ".join(self.notes))


def export_twin(
    twin: TwinLike, format: str, out: str | Path, *, travel: Floats | None = None, speed: Floats | None = None
) -> Export:
    """Write a twin for other tools and return what was written.

    Args:
        twin: what was found, or its folder.
        format: ``urdf`` (``<dynamics>`` with damping and friction), ``mjcf`` (MuJoCo, with a Python
            passive-force function beside it), ``numpy`` or ``c`` (the inverse model in one file).
        out: the file.
        travel: positions that curves shall cover [m or rad], shape (2, nv); the URDF's limits where None.
        speed: largest speeds to cover [m/s or rad/s], shape (nv,); the URDF's limits where None.

    Raises:
        InputError: there is no such format, or the name has another format's suffix.
    """
    path, twin = as_path(out, "out"), as_twin(twin)
    require(format, SUFFIX, "--format: no format", InputError)
    if path.suffix != SUFFIX[format]:
        raise InputError(f"--out: {path.name}: a file of format {format} is named *{SUFFIX[format]}")
    inverse = inverse_of(twin, travel, speed)
    files, notes = _made(twin, inverse, format, path.stem)
    for name, content in files.items():
        write_bytes(path.parent / name, content)
    return Export(format, files, inverse, tuple(dict.fromkeys([*left_out(inverse), *notes])))


def _made(twin: Twin, inverse: Inverse, format: str, stem: str) -> tuple[dict[str, bytes], list[str]]:
    """Return the files by name, and what they leave out beside what the inverse model does."""
    if format == "urdf":
        return {f"{stem}.urdf": urdf_text(twin)}, urdf_lines(twin, inverse)
    if format == "mjcf":
        return mjcf_files(twin, inverse, stem)
    text = numpy_text if format == "numpy" else c_text
    return {f"{stem}{SUFFIX[format]}": text(inverse, stem).encode()}, []
