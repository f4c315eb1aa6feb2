"""Effects as tables that a compiled loop can look up, made by evaluating the effects as ``Effect.depends`` says.

    position       tau = f(q):            one dense table over the travel, linear in between
    velocity       tau = f(v):            a table over |v| for each sign of v
    direction      tau = d+ g+(|v|) + d- g-(|v|),   d the direction with memory
    displacement   tau = z g(|v|) + m (y - z) + d y',   z the mean of the slip elements, y the bristle

The knots over |v| lie at v_max (k / n)², to resolve a Stribeck speed of 0.1 % of v_max. A motor that turns two joints
(:class:`Paired`) has friction in the sum of their speeds. What fits none of these forms is returned as ``other``; a
wrong effort channel and what the controller does are no part of the plant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.effects import Effect
from pinotwin.effects.effect import Paired
from pinotwin.effects.friction import default_width
from pinotwin.effects.presliding import ELEMENTS, Presliding, yields
from pinotwin.effects.scene import moves
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.simulation.state import Lookup

S = TypeVar("S")
Pairs = Sequence[tuple[Effect, Floats]]  # Effects with their coefficients
SPEEDS = 1024  # Intervals of a table over speed
_FINE = 2e-5  # A position table is refined until its midpoints are off by less than this share of its range
_MOST = 1 << 18


@dataclass(frozen=True)
class Tables:
    """Efforts of all axes as tables; see the module."""

    lookup: Lookup  # the arrays for the kernel
    coupled: tuple[tuple[int, int, float, float], ...]  # see :func:`pinotwin.dynamics.tape.record`
    other: tuple[int, ...]  # indices of the effects that fit no table


def tabulate(machine: Machine, effects: Pairs, travel: Floats, speed: Floats) -> Tables:
    """Return the tables of effects but rigid body, viscous and spring, over a travel, shape (2, nv), up to a speed."""
    v = [x * (np.arange(SPEEDS + 1) / SPEEDS) ** 2 for x in speed]
    forms: dict[str, list[tuple[Effect, Floats]]] = {}
    partners: list[tuple[int, int, float, float, float]] = []
    other: list[int] = []
    for k, (effect, theta) in enumerate(effects):
        if effect.axis is None or effect.causes[0] in ("viscous", "stiffness") or not moves(effect):
            continue
        if isinstance(effect, Paired):
            pairs = machine.names.index(effect.axis), machine.names.index(effect.partner)
            partners.append((*pairs, *effect.terms(theta)))
        elif effect.depends == "other":
            other.append(k)
        forms.setdefault(effect.depends, []).append((effect, theta))
    sliding = [(i, j, c) for i, j, _, _, c in partners if c != 0.0]
    position, place, grid = _positions(machine, forms.get("position", ()), travel)
    plain = _merge(
        machine, forms.get("velocity", ()), lambda *_: 0.0, lambda f, i: np.stack([f(v=v[i]), f(v=-v[i])])
    )
    dry = _merge(machine, forms.get("direction", ()), _width, lambda f, i: _both_ways(f, v[i]))
    slip = _merge(
        machine, forms.get("displacement", ()), lambda e, _: _bend(e), lambda f, i: _sliding(f, v[i])
    )
    lookup = Lookup(
        position=position,
        place=place,
        grid=grid,
        slowness=1.0 / np.asarray(speed, dtype=float),
        speeds=_joints(plain),
        velocity=np.array(list(plain.values())).reshape(-1, 2, SPEEDS + 1),
        directions=np.array(
            [*((i, -1) for i, _ in dry), *((i, j) for i, j, _ in sliding)], dtype=np.intp
        ).reshape(-1, 2),
        slope=1.0 / np.array([*(x for _, x in dry), *(default_width(True) for _ in sliding)]),
        dry=np.array([*dry.values(), *(np.outer((c, -c), np.ones(SPEEDS + 1)) for *_, c in sliding)]).reshape(
            -1, 2, SPEEDS + 1
        ),
        slips=_joints(slip),
        give=np.array([1.0 / (x * yields(spread)) for _, (x, spread) in slip]).reshape(-1, ELEMENTS),
        slip=np.array(list(slip.values())).reshape(-1, 1, SPEEDS + 1),
        memory=_memories(machine, forms.get("displacement", ()), slip),
    )
    return Tables(lookup, tuple((i, j, inertia, b) for i, j, inertia, b, _ in partners), tuple(other))


def _joints(tables: dict[tuple[int, S], Floats]) -> Ints:
    return np.array([i for i, _ in tables], dtype=np.intp)


def _positions(machine: Machine, effects: Pairs, travel: Floats) -> tuple[Floats, Ints, Floats]:
    """Return the position tables of all joints, where each is, and its grid."""
    tables, grid = [], np.zeros((machine.nv, 2))
    for i in range(machine.nv):
        own = [x for x in effects if x[0].axis == machine.names[i]]
        efforts = [partial(_effort, machine, e, theta, i) for e, theta in own]
        values, (start, spacing) = _dense(efforts, [e for e, _ in own], travel[:, i])
        tables.append(values)
        grid[i] = start, 1.0 / spacing
    counts = np.array([len(t) for t in tables], dtype=np.intp)
    place = np.stack([np.cumsum(counts) - counts, counts], axis=1)
    return np.concatenate(tables), place, grid


_Effort = Callable[..., Floats]


def _effort(machine: Machine, effect: Effect, theta: Floats, i: int, **given: Floats) -> Floats:
    """Return the effort of an effect on joint i for made-up samples of q, v or a, zero where not given, shape (n,)."""
    n = max(map(len, given.values()))
    out = np.empty(n)
    for start in range(0, n, 20000):  # the columns of a table are wide
        rows = slice(start, min(start + 20000, n))
        state = np.zeros((3, rows.stop - start, machine.nv))
        for name, x in given.items():
            state["qva".index(name), :, i] = x[rows]
        t = np.arange(float(rows.stop - start))
        motion = Motion.exact((machine.names, machine.rotary), t, *state, step=1.0)
        out[rows] = effect.along(motion, theta)[:, i]
    return out


def _dense(efforts: Sequence[_Effort], effects: Sequence[Effect], travel: Floats) -> tuple[Floats, Floats]:
    """Return the sum of position efforts on an even grid, on knots and fine enough for lines; its start and spacing."""
    if not efforts:
        return np.zeros(1), np.array([travel[0], 1.0])
    tables = [np.asarray(e.knots) for e in effects if hasattr(e, "knots")]
    if tables:  # on the knots of the finest
        knots = min(tables, key=lambda k: float(k[1] - k[0]))
        spacing = float(knots[1] - knots[0])
        start = float(knots[0] - np.ceil((knots[0] - travel[0]) / spacing) * spacing)
    else:
        start, spacing = float(travel[0]), float(travel[1] - travel[0]) / 256.0
    while True:
        count = int(np.ceil((travel[1] - start) / spacing))
        q = start + 0.5 * spacing * np.arange(2 * count + 1)
        values: Floats = np.sum([f(q=q) for f in efforts], axis=0)
        error = np.abs(values[1::2] - 0.5 * (values[:-1:2] + values[2::2])).max()
        if error <= _FINE * np.ptp(values):
            return values[::2], np.array([start, spacing])
        spacing *= 0.5
        if 2 * count >= _MOST:
            return values, np.array([start, spacing])


def _both_ways(effort: _Effort, v: Floats) -> Floats:
    """Return g+ and g-: an axis that slows down keeps its direction, whatever the width."""
    slow = v[::-1]
    plus = effort(v=slow, a=np.where(slow > 0.0, -1.0, 0.0))[::-1]
    minus = effort(v=-slow, a=np.where(slow > 0.0, 1.0, 0.0))[::-1]
    return np.stack([plus, minus])


def _sliding(effort: _Effort, v: Floats) -> Floats:
    """Return g(|v|): every slip element bent to its end."""
    q = 1e6 * np.arange(1, len(v) + 1)
    return effort(q=np.concatenate([[0.0], q]), v=np.concatenate([[0.0], v]))[1:]


def _merge(
    machine: Machine,
    effects: Pairs,
    shape: Callable[[Effect, bool], S],
    table: Callable[[_Effort, int], Floats],
) -> dict[tuple[int, S], Floats]:
    """Return tables by (joint, shape): elements of the same shape move together."""
    found: dict[tuple[int, S], Floats] = {}
    for effect, theta in effects:
        assert effect.axis is not None
        i = machine.names.index(effect.axis)
        key = (i, shape(effect, machine.rotary[i]))
        values = table(partial(_effort, machine, effect, theta, i), i)
        found[key] = found[key] + values if key in found else values
    return found


def _width(effect: Effect, rotary: bool) -> float:
    """Return the width of an element; a plain sign would chatter, so it turns over the usual one."""
    return float(getattr(effect, "width", None) or default_width(rotary))


def _bend(effect: Effect) -> tuple[float, float]:
    return float(effect.x_s), float(effect.spread)  # type: ignore[attr-defined]


def _memories(
    machine: Machine, effects: Pairs, found: dict[tuple[int, tuple[float, float]], Floats]
) -> Floats:
    """Return 1/x_s, play, m and d of every element, in the order of its tables, shape (m, 4)."""
    out = {(i, shape): np.array([1.0 / shape[0], 0.0, 0.0, 0.0]) for i, shape in found}
    for effect, theta in effects:
        assert isinstance(effect, Presliding)
        i = machine.names.index(effect.axis)
        row = out[i, _bend(effect)]
        row[1] = max(row[1], effect.play or 0.0)
        row[2:] += effect.memory(theta)
    return np.array(list(out.values())).reshape(-1, 4)
