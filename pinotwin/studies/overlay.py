"""One effect laid over the data it was found in (thesis Fig. 3-9, 3-10, 4-10, 4-11).

The *extracted data* are the measured effort minus every other effect of the twin. If the effect is
true, they fall on its curve; what scatters about it is the residual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects import EFFECTS, AxisEffect
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.motion import AxisMotion
from pinotwin.studies.evidence import Evidence, evidence
from pinotwin.twin import Twin

Against = Literal["velocity", "position"]
FRICTION = tuple(
    name
    for name, e in EFFECTS.items()
    if e.family.name == "friction" and e.depends in ("velocity", "direction", "displacement")
)
"""Effects that are functions of the velocity of their axis."""
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


@dataclass(frozen=True, eq=False)
class Bins:
    """Extracted data in bins of equal width.

    Attributes:
        x: centre of each bin, shape (k,).
        median: median of its rows.
        low: lower quartile; likewise ``high``.
    """

    x: Floats
    median: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True, eq=False)
class Overlay:
    """Extracted data and the curve that explains them.

    Attributes:
        axis: whose effort it is.
        rotary: rad and N·m, else m and N.
        against: what the curve is a function of.
        effects: keys of the effects that make the curve.
        x: velocity or position of every row [SI], shape (m,).
        extracted: measured minus all other effects [N or N·m], shape (m,).
        fitted: the curve at the same rows, shape (m,).
        grid: where the curve is drawn, shape (g,).
        curve: its value, shape (g,).
        bins: the extracted data in bins.
    """

    axis: str
    rotary: bool
    against: Against
    effects: tuple[str, ...]
    x: Floats
    extracted: Floats
    fitted: Floats
    grid: Floats
    curve: Floats
    bins: Bins

    @property
    def explained(self) -> float:
        """Share of the extracted data's power that the curve explains; 1 is all of it."""
        power = float(np.sum(self.extracted**2))
        return 1.0 - float(np.sum((self.extracted - self.fitted) ** 2)) / max(power, 1e-300)


def overlay(
    twin: Twin,
    log: Log | Sequence[Log] | Evidence,
    axis: str,
    names: Sequence[str],
    against: Against,
) -> Overlay:
    """Return the effects of some names on one axis over the data extracted for them.

    Args:
        twin: whose effects they are.
        log: log(s) of the machine, or the evidence already made from them.
        axis: name of the axis.
        names: names of the effects: :data:`FRICTION` (Fig. 3-10), :data:`RIPPLE` (Fig. 3-9), :data:`TABLE`.
        against: what they depend on.

    Raises:
        DataError: the axis has no such effect, or no measured effort.
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
    grid, motion = _grid(given, j, x, against)
    order = np.argsort(grid, kind="stable")
    return Overlay(
        axis=axis,
        rotary=given.rotary[j],
        against=against,
        effects=keys,
        x=x,
        extracted=extracted,
        fitted=np.sum([given.parts[key][rows, j] for key in keys], axis=0),
        grid=grid[order],
        curve=_curve(twin, keys, motion)[order],
        bins=binned(x, extracted),
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
    """Return the abscissae of the curve, and a motion that visits them.

    Speeds are visited from standstill outwards, in either direction: so the direction with memory
    (Eq. 3.9) has the side that steady motion gives it.
    """
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


def _curve(twin: Twin, keys: Sequence[str], motion: AxisMotion) -> Floats:
    total = np.zeros(len(motion.q))
    for key in keys:
        effect = twin.effects[twin.keys.index(key)]
        if isinstance(effect, AxisEffect):
            total += effect.axis_columns(motion) @ twin.coefficients(key)
    return total


def binned(x: Floats, y: Floats, count: int = 60, fewest: int = 5) -> Bins:
    """Return median and quartiles of ``y`` in bins of ``x``; bins of fewer rows than ``fewest`` are left out."""
    edges = np.linspace(float(x.min()), float(x.max()), count + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, count - 1)
    order = np.argsort(place, kind="stable")
    groups = np.split(y[order], np.searchsorted(place[order], np.arange(1, count)))
    full = [k for k, group in enumerate(groups) if len(group) >= fewest]
    quartiles = np.array([np.percentile(groups[k], [25, 50, 75]) for k in full]).reshape(-1, 3)
    centre = 0.5 * (edges[1:] + edges[:-1])
    return Bins(centre[full], quartiles[:, 1], quartiles[:, 0], quartiles[:, 2])
