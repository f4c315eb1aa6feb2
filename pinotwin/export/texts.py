"""The inverse model of a machine as one Python or one C99 file, and what every exported file says of itself."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pprint import pformat
from textwrap import wrap
from typing import Any

from pinotwin.arrays import mapped
from pinotwin.export.inverse import Inverse
from pinotwin.system.templates import asset, environment
from pinotwin.version import __version__


def rendered(template: str, **given: object) -> str:
    """Return a template of this package, filled."""
    return environment("pinotwin.export").get_template(template).render(**given)


def header(inverse: Inverse) -> list[str]:
    """Return the lines of the comment at the top of a file."""
    given = {"inverse": inverse, "version": __version__, "left_out": left_out(inverse)}
    return rendered("header.txt", **given).splitlines()


def left_out(inverse: Inverse, large: float = 0.01) -> list[str]:
    """Return a line for effects that a file does not hold, and one for axes that differ from the twin by much."""
    lines = []
    if inverse.omitted:
        lines.append(f"left out, for no curve holds them: {', '.join(inverse.omitted)}")
    errors = zip(inverse.names, inverse.error, strict=True)
    off = [f"{name} {error:.1%}" for name, error in errors if error > large]
    if off:
        lines.append(f"differs from the twin on a motion through the range by: {', '.join(off)} (RMS)")
    return lines


def numpy_text(inverse: Inverse, stem: str) -> str:
    """Return the text of the module that is called ``stem``."""
    head, data = "\n".join(header(inverse)), literal(inverse.data)
    return rendered("numpy.txt", header=head, stem=stem, runtime=runtime_text(), data=data)


def runtime_text() -> str:
    """Return the source of :mod:`pinotwin.export.runtime` without its docstring."""
    return asset("pinotwin.export", "runtime.py").split('"""', 2)[2].strip()


def literal(value: Any) -> str:
    """Return numbers as a Python literal of few digits and many items a line."""
    short = mapped(value, lambda x: float(f"{x:.10g}") if isinstance(x, float) else x)
    return pformat(short, width=110, compact=True, sort_dicts=False)


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
    """Return the text of the C file; its functions begin with ``stem``."""
    template = asset("pinotwin.export", "inverse.c")
    head = "\n".join(f" * {line}".rstrip() for line in header(inverse)).replace("*/", "* /")
    prefix = re.sub(r"\W|^(?=\d)", "_", stem)
    text = template.replace("@HEADER@", head).replace("@DATA@", _data(inverse.data))
    return text.replace("PREFIX", prefix)


def _data(data: dict[str, Any]) -> str:
    curves = _Curves()
    position = [(j, curves.add(x, y)) for j, x, y in data["position"]]
    velocity = [(j, curves.add(x, y)) for j, x, y in data["velocity"]]
    dry, slip, tied = data["dry"], data["slip"], data["coupled"]
    sliding = [(r["joint"], r["partner"], curves.add(*r["plus"]), curves.add(*r["minus"])) for r in dry]
    slipping = [(row["joint"], curves.add(*row["level"])) for row in slip]
    joints, yields = data["joints"], len(slip[0]["yields"]) if slip else 6
    sizes = {"NV": len(data["names"]), "BODIES": len(joints)}
    sizes |= {f"N_{k.upper()}": len(data[k]) for k in ("position", "velocity", "dry", "slip", "coupled")}
    sizes["YIELDS"] = yields
    lists: dict[str, Any] = {key: data[key] for key in ("gravity", "armature", "viscous", "stiffness")}
    lists |= {key: [int(row[key]) for row in joints] for key in ("parent", "column", "rotary")}
    lists |= {"mass": [row["mass"] for row in joints], "slope": [row["slope"] for row in dry]}
    lists |= {"first": curves.first, "knot": curves.x, "value": curves.y}
    tables: dict[str, tuple[int, Any]] = {
        key: (len(joints[0][key]), [row[key] for row in joints])
        for key in ("axis", "rotation", "place", "centre", "inertia")
    }
    tables |= {
        "position": (2, position),
        "velocity": (2, velocity),
        "dry": (4, sliding),
        "slip": (2, slipping),
    }
    tables["yields"] = (yields, [row["yields"] for row in slip])
    tables["contact"] = (4, [[row[k] for k in ("x_s", "play", "m", "d")] for row in slip])
    tables |= {"coupled": (2, [row[:2] for row in tied]), "tied": (2, [row[2:] for row in tied])}
    names = ", ".join(f'"{name}"' for name in data["names"])
    return "\n".join(
        [
            *(f"#define {name} {size}" for name, size in sizes.items()),
            f"static const char *const names[] = {{{names}}};",
            *(_list(name, values) for name, values in lists.items()),
            *(_table(name, rows, width) for name, (width, rows) in tables.items()),
        ]
    )


_WHOLE = frozenset(("parent", "column", "rotary", "first", "position", "velocity", "dry", "slip", "coupled"))
"""Arrays of whole numbers; the others are double."""


def _number(x: float) -> str:
    text = f"{x:.10g}"
    return text if isinstance(x, int) or any(c in text for c in ".en") else text + ".0"


def _list(name: str, values: Sequence[float]) -> str:
    """Return a declaration; C has no empty arrays, so an absent one has a zero that is never read."""
    text = wrap(", ".join(map(_number, values)) or "0", 106, initial_indent="    ", subsequent_indent="    ")
    kind = "int" if name in _WHOLE else "double"
    return f"static const {kind} {name}[] = {{\n" + "\n".join(text) + "\n};"


def _table(name: str, rows: Sequence[Sequence[float]], width: int) -> str:
    lines = ["    {" + ", ".join(map(_number, row)) + "}," for row in rows] or ["    {0},"]
    kind = "int" if name in _WHOLE else "double"
    return f"static const {kind} {name}_[][{width}] = {{\n" + "\n".join(lines) + "\n};"
