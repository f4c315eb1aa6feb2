"""One effect: laid over the data it was found in (thesis Fig. 3-9, 3-10, 4-10, 4-11), and left out (Fig. 3-8).

The *extracted data* are the measured effort minus every other effect: those of a true effect fall on its curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects import EFFECTS, AxisEffect, known
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.motion import AxisMotion
from pinotwin.signals import rms
from pinotwin.studies.evidence import Evidence, evidence
from pinotwin.studies.study import Study
from pinotwin.system.phrases import STUDIED
from pinotwin.twin import Twin
from pinotwin.units import shown

Against = Literal["velocity", "position"]
FRICTION = tuple(  # Effects that are functions of the velocity of their axis
    name
    for name, e in EFFECTS.items()
    if e.family.name == "friction" and e.depends in ("velocity", "direction", "displacement")
)
RIPPLE = tuple(name for name, e in EFFECTS.items() if e.depends == "position" and e.several)
"""Effects that are periodic in the position of their axis."""
TABLE = tuple(name for name, e in EFFECTS.items() if e.depends == "position" and e.held)
"""Effects that are any function of the position of their axis."""
KINDS: dict[str, tuple[tuple[str, ...], Against]] = {
    "Friction": (FRICTION, "velocity"),
    "Ripple": (RIPPLE, "position"),
    "Position-dependent effort": (TABLE, "position"),
}
"""What is laid over its data -> names of the effects, and what they depend on."""


def overlay(
    twin: Twin, log: Log | Sequence[Log] | Evidence, axis: str, names: Sequence[str], against: Against
) -> Study:
    """Return named effects on one axis over the data extracted for them; DataError for no such effect or effort.

    The rows are the extracted data in bins. The courses are the abscissa ``x`` [SI], the ``extracted`` data and the
    ``fitted`` curve [N or N·m], each of shape (m,), and where the curve is drawn, ``grid`` and ``curve``, shape (g,).
    """
    given = log if isinstance(log, Evidence) else evidence(twin, log)
    j = given.index(axis)
    keys = effect_keys_of(twin, axis, names)
    if not keys:
        raise DataError(
            f"{twin.machine.name}: axis {axis} has none of {', '.join(names)}; list one under "
            f"`axes.{axis}.effects` in machine.yaml and identify again"
        )
    rows = given.use[:, j]
    x = (given.v if against == "velocity" else given.q)[rows, j]
    extracted = given.without(keys)[rows, j]
    fitted = np.sum([given.parts[key][rows, j] for key in keys], axis=0)
    grid, motion = _grid(given, j, x, against)
    order = np.argsort(grid, kind="stable")
    own = [(k, e) for k, e in zip(twin.keys, twin.effects, strict=True) if k in keys]
    parts = [e.axis_columns(motion) @ twin.coefficients(k) for k, e in own if isinstance(e, AxisEffect)]
    curve = np.sum(parts, axis=0)[order]
    return Study(
        finding=STUDIED["overlay"].format(share=explained(extracted, fitted)),
        header=(f"{against} [SI]", "median of the data", "lower quartile", "upper quartile"),
        rows=np.transpose(binned(x, extracted)).tolist(),
        courses={"x": x, "extracted": extracted, "fitted": fitted, "grid": grid[order], "curve": curve},
        axis=axis,
        rotary=given.rotary[j],
        effects=keys,
        against=against,
    )


def explained(extracted: Floats, fitted: Floats) -> float:
    """Return the share of the data's power that a curve explains, all of shape (m,); 1 is all of it."""
    power = float(np.sum(extracted**2))
    return 1.0 - float(np.sum((extracted - fitted) ** 2)) / max(power, 1e-300)


def with_and_without(
    twin: Twin, log: Log | Sequence[Log] | Evidence, axis: str, names: Sequence[str] = RIPPLE
) -> Study:
    """Return an axis' effort predicted with and without each effect (Fig. 3-8); DataError for no such effect or effort.

    The others keep the coefficients that they have beside it. A row of the table has the RMS error with and without.
    The courses are of the effect that matters most, each of shape (m,): ``t`` and the effort ``measured``, predicted
    with all effects (``complete``) and ``without`` it.
    """
    given = log if isinstance(log, Evidence) else evidence(twin, log)
    j = given.index(axis)
    keys = {name: own for name in names if (own := effect_keys_of(twin, axis, [name]))}
    if not keys:
        raise DataError(f"{twin.machine.name}: axis {axis} has none of {', '.join(names)}")
    rows = given.use[:, j]
    parts = {name: np.sum([given.parts[key][rows, j] for key in own], axis=0) for name, own in keys.items()}
    measured, left = given.u[rows, j], given.residual[rows, j]
    table = [(name, rms(left), rms(left + part)) for name, part in parts.items()]
    name, complete, without = max(table, key=lambda row: row[2])
    factor, unit = shown("N·m" if given.rotary[j] else "N", without)
    sizes = {"complete": factor * complete, "without": factor * without, "unit": unit}
    predicted = measured - left
    return Study(
        finding=STUDIED["without"].format(effect=known()[name].title.lower(), **sizes),
        header=("effect", "RMS error with it [N, N·m]", "without"),
        rows=table,
        courses={
            "t": given.t[rows],
            "measured": measured,
            "complete": predicted,
            "without": predicted - parts[name],
        },
        axis=axis,
        rotary=given.rotary[j],
        effects=(name,),
    )


def effect_keys_of(twin: Twin, axis: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the keys of an axis' own effects that have one of the names."""
    pairs = zip(twin.keys, twin.effects, strict=True)
    return tuple(
        key
        for key, effect in pairs
        if isinstance(effect, AxisEffect) and effect.axis == axis and effect.name in names
    )


def _grid(given: Evidence, j: int, x: Floats, against: Against) -> tuple[Floats, AxisMotion]:
    """Return the abscissae of the curve, and a motion that visits them, speeds from standstill outwards either way."""
    n = 1200
    if against == "position":
        grid = np.linspace(float(x.min()), float(x.max()), n)
        q, v = grid, np.zeros(n)
        pieces: tuple[slice, ...] = (slice(0, n),)
    else:
        half = np.linspace(0.0, 1.0, n // 2) ** 2  # denser where Stribeck's curve bends
        grid = np.r_[half * min(float(x.min()), 0.0), half * max(float(x.max()), 0.0)]
        # A second at each speed: enough way for presliding to be over.
        q, v = np.r_[np.cumsum(grid[: n // 2]), np.cumsum(grid[n // 2 :])], grid
        pieces = (slice(0, n // 2), slice(n // 2, n))
    t = np.arange(n, dtype=float)
    motion = AxisMotion(given.names[j], j, given.rotary[j], t, q, v, np.zeros(n), pieces, 1.0 / given.rate)
    return grid, motion


def binned(x: Floats, y: Floats, count: int = 60, fewest: int = 5) -> tuple[Floats, Floats, Floats, Floats]:
    """Return centre, median and quartiles of ``y`` in the bins of ``x`` that hold ``fewest`` rows, shape (k,) each."""
    edges = np.linspace(float(x.min()), float(x.max()), count + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, count - 1)
    order = np.argsort(place, kind="stable")
    groups = np.split(y[order], np.searchsorted(place[order], np.arange(1, count)))
    full = [k for k, group in enumerate(groups) if len(group) >= fewest]
    quartiles = np.array([np.percentile(groups[k], [50, 25, 75]) for k in full]).reshape(-1, 3)
    return (0.5 * (edges[1:] + edges[:-1])[full], *quartiles.T)
