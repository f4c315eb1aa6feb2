"""One C99 file with the inverse model of a machine: no heap, no library but libm."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from importlib.resources import files
from typing import Any

from pinotwin.export.header import header
from pinotwin.export.inverse import Inverse


class _Curves:
    """All curves of a machine in two arrays, each known by its number."""

    def __init__(self) -> None:
        self.x: list[float] = []
        self.y: list[float] = []
        self.first: list[int] = [0]

    def add(self, x: Sequence[float], y: Sequence[float]) -> int:
        """Return the number of a curve that is added."""
        self.x += x
        self.y += y
        self.first.append(len(self.x))
        return len(self.first) - 2


def c_text(inverse: Inverse, stem: str) -> str:
    """Return the text of the C file; its functions begin with the name of the machine.

    Args:
        inverse: what to write.
        stem: name of the file, from which the functions' prefix is made.
    """
    template = (files("pinotwin.export") / "inverse.c").read_text(encoding="utf-8")
    head = "\n".join(f" * {line}".rstrip() for line in header(inverse)).replace("*/", "* /")
    prefix = re.sub(r"\W|^(?=\d)", "_", stem)
    text = template.replace("@HEADER@", head).replace("@DATA@", _data(inverse.data))
    return text.replace("PREFIX", prefix)


def _data(data: dict[str, Any]) -> str:
    curves = _Curves()
    position = [(j, curves.add(x, y)) for j, x, y in data["position"]]
    velocity = [(j, curves.add(x, y)) for j, x, y in data["velocity"]]
    dry = [
        (row["joint"], row["partner"], curves.add(*row["plus"]), curves.add(*row["minus"]))
        for row in data["dry"]
    ]
    slip = [(row["joint"], curves.add(*row["level"])) for row in data["slip"]]
    joints = data["joints"]
    out = [
        *_sizes(data),
        _array("char *const", "names", (f'"{name}"' for name in data["names"])),
        *(
            _array("double", key, map(_number, data[key]))
            for key in ("gravity", "armature", "viscous", "stiffness")
        ),
        *(
            _array("int", key, (str(int(row[key])) for row in joints))
            for key in ("parent", "column", "rotary")
        ),
        _array("double", "mass", (_number(row["mass"]) for row in joints)),
        *(
            _rows(key, [row[key] for row in joints])
            for key in ("axis", "rotation", "place", "centre", "inertia")
        ),
        _pairs("position", position, 2),
        _pairs("velocity", velocity, 2),
        _pairs("dry", dry, 4),
        _array("double", "slope", (_number(row["slope"]) for row in data["dry"])),
        _pairs("slip", slip, 2),
        _rows("yields", [row["yields"] for row in data["slip"]], 6),
        _rows("contact", [[row[k] for k in ("x_s", "play", "m", "d")] for row in data["slip"]], 4),
        _pairs("coupled", [row[:2] for row in data["coupled"]], 2),
        _rows("tied", [row[2:] for row in data["coupled"]], 2),
        _array("int", "first", map(str, curves.first)),
        _array("double", "knot", map(_number, curves.x)),
        _array("double", "value", map(_number, curves.y)),
    ]
    return "\n".join(out)


def _sizes(data: dict[str, Any]) -> list[str]:
    sizes = {"NV": len(data["names"]), "BODIES": len(data["joints"])}
    sizes |= {f"N_{k.upper()}": len(data[k]) for k in ("position", "velocity", "dry", "slip", "coupled")}
    sizes["YIELDS"] = len(data["slip"][0]["yields"]) if data["slip"] else 6
    return [f"#define {name} {size}" for name, size in sizes.items()]


def _number(x: float) -> str:
    text = f"{x:.10g}"
    return text if any(c in text for c in ".en") else text + ".0"


def _array(kind: str, name: str, values: Iterable[str]) -> str:
    """Return a declaration; C has no empty arrays, so an absent one has a zero that is never read."""
    items = list(values) or ["0"]
    lines, line = [], "   "
    for item in items:
        if len(line) + len(item) > 106:
            lines.append(line)
            line = "   "
        line += f" {item},"
    return f"static const {kind} {name}[] = {{\n" + "\n".join([*lines, line]) + "\n};"


def _pairs(name: str, rows: Sequence[Sequence[int]], width: int) -> str:
    return _table("int", name, [[str(x) for x in row] for row in rows], width)


def _rows(name: str, rows: Sequence[Sequence[float]], width: int | None = None) -> str:
    return _table("double", name, [[_number(x) for x in row] for row in rows], width or len(rows[0]))


def _table(kind: str, name: str, rows: Sequence[Sequence[str]], width: int) -> str:
    lines = ["    {" + ", ".join(row) + "}," for row in rows] or ["    {0},"]
    return f"static const {kind} {name}_[][{width}] = {{\n" + "\n".join(lines) + "\n};"
