"""What a twin's effort consists of, free of pinotwin's classes: a tree, matrices, curves and memory.

It is written as one Python or one C99 file. Effects come through :mod:`pinotwin.simulation.tables`; what no table can
hold is in ``omitted``, for files to say.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pprint import pformat
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

from pinotwin.analysis.disturbance import linear_terms
from pinotwin.arrays import Floats, mapped
from pinotwin.dynamics.parameters import joint_axis
from pinotwin.effects import total_effort
from pinotwin.export.runtime import InverseModel
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.simulation.state import Lookup
from pinotwin.simulation.tables import SPEEDS, Tables, tabulate
from pinotwin.system.templates import asset, environment
from pinotwin.twin import Twin
from pinotwin.version import __version__

TOLERANCE = 5e-4
"""Largest error of a curve, as a share of its largest value: a tenth of what a drive's effort repeats to."""
_UNBOUNDED = 1e3  # a limit beyond this [m, rad, m/s or rad/s] is a placeholder of the URDF


@dataclass(frozen=True)
class Inverse:
    """The inverse model of a machine as numbers."""

    name: str  # of the machine
    names: tuple[str, ...]  # axes and passive joints, in the order of every array
    units: tuple[str, ...]  # unit of effort of each
    data: dict[str, Any]  # what :class:`pinotwin.export.runtime.InverseModel` takes
    travel: Floats  # positions that the curves cover [m or rad], shape (2, nv)
    speed: Floats  # largest speed that they cover [m/s or rad/s], shape (nv,)
    omitted: tuple[str, ...]  # keys of the effects that no curve can hold
    # RMS of the difference to the twin on a motion through the whole range, as a share of the RMS of the twin's
    # effort, shape (nv,)
    error: Floats


def inverse_of(twin: Twin, travel: Floats | None = None, speed: Floats | None = None) -> Inverse:
    """Return the inverse model for positions (2, nv) [m or rad] and speeds (nv,) [m/s or rad/s]; limits where None."""
    machine = twin.machine
    travel = default_travel(machine) if travel is None else travel
    speed = default_speed(machine) if speed is None else speed
    tables = tabulate(machine, twin.pairs, travel, speed)
    data = {
        "machine": machine.name,
        "names": list(machine.names),
        **_tree(twin),
        **{name: row.tolist() for name, row in linear_terms(twin).items()},
        **_curves(tables, machine.nv),
    }
    outside = [k for k, e in enumerate(twin.effects) if e.family.acts in ("sensor", "loop")]
    test = sweep(machine, travel, speed)
    return Inverse(
        name=machine.name,
        names=machine.names,
        units=tuple("N·m" if rotary else "N" for rotary in machine.rotary),
        data=data,
        travel=travel,
        speed=speed,
        omitted=tuple(twin.keys[k] for k in sorted({*tables.other, *outside})),
        error=deviation(twin, InverseModel(data).run(test.q, test.v, test.a, test.step), test),
    )


def default_travel(machine: Machine) -> Floats:
    """Return the joints' position limits; two turns or one metre where the URDF has none, shape (2, nv)."""
    model, rotary = machine.model, np.array(machine.rotary)
    usual = np.where(rotary, 4.0 * np.pi, 1.0)
    low = np.where(model.lowerPositionLimit < -_UNBOUNDED, -usual, model.lowerPositionLimit)
    high = np.where(model.upperPositionLimit > _UNBOUNDED, usual, model.upperPositionLimit)
    margin = np.where(rotary, 0.05, 0.005) + 0.01 * (high - low)
    return np.stack([low - margin, high + margin])


def default_speed(machine: Machine) -> Floats:
    """Return the joints' speed limits; 2 m/s or 20 rad/s where the URDF has none, shape (nv,)."""
    limit = np.asarray(machine.model.velocityLimit, dtype=float)
    usual = np.where(machine.rotary, 20.0, 2.0)
    return np.where((limit > 0.0) & (limit < _UNBOUNDED), 1.2 * limit, usual)


def _tree(twin: Twin) -> dict[str, Any]:
    model = twin.model
    moved = [(i, model.inertias[i], *joint_axis(model, i)) for i in range(1, model.njoints)]
    joints = [
        {
            "name": str(model.names[i]),
            "parent": int(model.parents[i]) - 1,
            "column": int(model.idx_vs[i]),
            "rotary": rotary,
            "axis": axis.tolist(),
            "rotation": model.jointPlacements[i].rotation.ravel().tolist(),
            "place": model.jointPlacements[i].translation.tolist(),
            "mass": float(inertia.mass),
            "centre": inertia.lever.tolist(),
            "inertia": inertia.inertia.ravel().tolist(),
        }
        for i, inertia, rotary, axis in moved
    ]
    return {
        "gravity": model.gravity.linear.tolist(),
        "armature": np.asarray(model.armature, dtype=float).tolist(),
        "joints": joints,
    }


def _curves(made: Tables, nv: int) -> dict[str, Any]:
    """Return the tables as curves with few knots; a plain sign gets a width, which a simulation can step."""
    tables, grid = made.lookup, (np.arange(SPEEDS + 1) / SPEEDS) ** 2
    speeds = [grid / slowness for slowness in tables.slowness]
    dry = []
    for k, (j, partner) in enumerate(tables.directions):
        plus, minus = (_thin(speeds[j], row) for row in tables.dry[k])
        slope = 0.0 if partner >= 0 else float(tables.slope[k])
        dry.append({"joint": int(j), "partner": int(partner), "slope": slope, "plus": plus, "minus": minus})
    slip = []
    for k, j in enumerate(tables.slips):
        stiff, play, m, d = (float(x) for x in tables.memory[k])
        shape = {"joint": int(j), "yields": (1.0 / tables.give[k]).tolist(), "x_s": 1.0 / stiff}
        slip.append(shape | {"play": play, "m": m, "d": d, "level": _thin(speeds[j], tables.slip[k, 0])})
    return {
        "position": [place for j in range(nv) if (place := _position(tables, j)) is not None],
        "velocity": [_both_signs(int(j), speeds[j], tables.velocity[k]) for k, j in enumerate(tables.speeds)],
        "dry": dry,
        "slip": slip,
        "coupled": [list(row) for row in made.coupled],
    }


def _thin(x: Floats, y: Floats) -> Curve:
    return curve(x, y, TOLERANCE * float(np.abs(y).max()))


def _position(tables: Lookup, j: int) -> tuple[int, list[float], list[float]] | None:
    start, count = tables.place[j]
    y = tables.position[start : start + count]
    if not np.any(y):
        return None
    x = tables.grid[j, 0] + np.arange(count) / tables.grid[j, 1]
    return (j, *curve(x, y, TOLERANCE * float(np.ptp(y)) + 1e-12))


def _both_signs(j: int, speeds: Floats, values: Floats) -> tuple[int, list[float], list[float]]:
    """Return one curve over the signed speed from f(|v|) and f(-|v|)."""
    x = np.concatenate([-speeds[:0:-1], speeds])
    y = np.concatenate([values[1, :0:-1], values[0]])
    return (j, *_thin(x, y))


class Curve(NamedTuple):
    """A function of one number: straight between the knots ``x``, its end values beyond them."""

    x: list[float]
    y: list[float]


def curve(x: Floats, y: Floats, tolerance: float) -> Curve:
    """Return a curve within ``tolerance`` of the samples y at increasing x, both of shape (n,) (Reumann & Witkam)."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if len(x) == 1 or np.ptp(y) <= 2.0 * tolerance:
        return Curve([float(x[0])], [float(0.5 * (y.min() + y.max()))])
    kept, low, high = [0], -np.inf, np.inf
    for k in range(1, len(x)):
        slope = (y[k] - y[kept[-1]]) / (x[k] - x[kept[-1]])
        if not low <= slope <= high:  # the straight line to k would leave a sample in between
            kept.append(k - 1)
            low, high = -np.inf, np.inf
        run = x[k] - x[kept[-1]]
        rise = y[k] - y[kept[-1]]
        low, high = max(low, (rise - tolerance) / run), min(high, (rise + tolerance) / run)
    kept.append(len(x) - 1)
    return Curve([float(v) for v in x[kept]], [float(v) for v in y[kept]])


STEP = 0.002  # of the sweep [s]


def sweep(machine: Machine, travel: Floats, speed: Floats, seconds: float = 6.0) -> Motion:
    """Return a smooth motion of all axes over much of the range: where a file is compared with the twin."""
    t = np.arange(0.0, seconds, STEP)[:, None]
    middle, half = 0.5 * (travel[0] + travel[1]), 0.4 * (travel[1] - travel[0])
    w = 2.0 * np.pi * (0.31 + 0.043 * np.arange(machine.nv))
    size = np.minimum(half, 0.5 * speed / w)
    q = middle + size * np.sin(w * t)
    v = size * w * np.cos(w * t)
    a = -size * w**2 * np.sin(w * t)
    return Motion.exact((machine.names, machine.rotary), t[:, 0], q, v, a, step=STEP, source="sweep")


def deviation(twin: Twin, found: Floats, motion: Motion) -> Floats:
    """Return RMS(found - twin) / RMS(twin) of every joint's effort along a motion, shape (nv,)."""
    wanted = total_effort(motion, twin.effects, twin.theta)
    scale = np.sqrt(np.mean(wanted**2, axis=0))
    return np.sqrt(np.mean((found - wanted) ** 2, axis=0)) / np.where(scale > 0.0, scale, 1.0)


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


def c_text(inverse: Inverse, stem: str) -> str:
    """Return the text of the C file; its functions begin with ``stem``."""
    template = asset("pinotwin.export", "inverse.c")
    head = "\n".join(f" * {line}".rstrip() for line in header(inverse)).replace("*/", "* /")
    prefix = re.sub(r"\W|^(?=\d)", "_", stem)
    text = template.replace("@HEADER@", head).replace("@DATA@", _data(inverse.data))
    return text.replace("PREFIX", prefix)


def _data(data: dict[str, Any]) -> str:
    first, knots, values = [0], list[float](), list[float]()  # all curves, one after the other

    def added(x: Sequence[float], y: Sequence[float]) -> int:
        """Return the number of a curve that is added."""
        knots.extend(x)
        values.extend(y)
        first.append(len(knots))
        return len(first) - 2

    position = [(j, added(x, y)) for j, x, y in data["position"]]
    velocity = [(j, added(x, y)) for j, x, y in data["velocity"]]
    dry, slip, tied = data["dry"], data["slip"], data["coupled"]
    sliding = [(r["joint"], r["partner"], added(*r["plus"]), added(*r["minus"])) for r in dry]
    slipping = [(row["joint"], added(*row["level"])) for row in slip]
    joints, yields = data["joints"], len(slip[0]["yields"]) if slip else 6
    sizes = {"NV": len(data["names"]), "BODIES": len(joints)}
    sizes |= {f"N_{k.upper()}": len(data[k]) for k in ("position", "velocity", "dry", "slip", "coupled")}
    sizes["YIELDS"] = yields
    lists: dict[str, Any] = {key: data[key] for key in ("gravity", "armature", "viscous", "stiffness")}
    lists |= {key: [int(row[key]) for row in joints] for key in ("parent", "column", "rotary")}
    lists |= {"mass": [row["mass"] for row in joints], "slope": [row["slope"] for row in dry]}
    lists |= {"first": first, "knot": knots, "value": values}
    tables: dict[str, tuple[int, Any]] = {
        key: (len(joints[0][key]), [row[key] for row in joints])
        for key in ("axis", "rotation", "place", "centre", "inertia")
    }
    tables |= {"position": (2, position), "velocity": (2, velocity)}
    tables |= {"dry": (4, sliding), "slip": (2, slipping)}
    tables["yields"] = (yields, [row["yields"] for row in slip])
    tables["contact"] = (4, [[row[k] for k in ("x_s", "play", "m", "d")] for row in slip])
    tables |= {"coupled": (2, [row[:2] for row in tied]), "tied": (2, [row[2:] for row in tied])}
    names = ", ".join(f'"{name}"' for name in data["names"])
    return "\n".join(
        [
            *(f"#define {name} {size}" for name, size in sizes.items()),
            f"static const char *const names[] = {{{names}}};",
            *(_list(name, row) for name, row in lists.items()),
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
