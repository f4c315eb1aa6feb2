"""The base model of a diagnosis: what is believed already, as columns with a prior.

Dry friction is written with the memory of its bristles (:mod:`pinotwin.diagnosis.bristle`); a shape
that was searched (a Stribeck speed, a ripple's pitch) stays free to first order by one column more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.bristle import bristles, usual_distance
from pinotwin.diagnosis.rows import Rows
from pinotwin.effects import (
    Coulomb,
    CoulombAsymmetric,
    Effect,
    PositionTable,
    Presliding,
    Stribeck,
)
from pinotwin.effects.layout import effect_slices
from pinotwin.motion import Motion
from pinotwin.twin.twin import Twin

DRY = (Coulomb, CoulombAsymmetric, Stribeck)
SCATTERED = ("coulomb", "viscous", "coulomb_asymmetric", "viscous_asymmetric", "presliding")


@dataclass(frozen=True)
class Base:
    """Effects of the base model and what is believed about their coefficients.

    Attributes:
        effects: with their shapes fixed.
        distance: presliding distance per joint [m or rad], shape (nv,).
        mean: prior mean of the coefficients, shape (p,).
        precision: prior precision, shape (p, p).
        slopes: (effect, shape, coefficients) of the shapes that stay free to first order.
        change: True if the mean is a twin's belief, False if the base is refitted.
        whole: coefficients that hold at standstill and reversals too, which the rows of a diagnosis
            leave out, shape (p,); the mean where None.
        unknown: effects, as (name, axis), of which a twin's own logs told nothing, their shape included.
    """

    effects: tuple[Effect, ...]
    distance: Floats
    mean: Floats
    precision: Floats
    slopes: tuple[tuple[int, int, Floats], ...] = ()
    change: bool = False
    whole: Floats | None = None
    unknown: frozenset[tuple[str, str | None]] = frozenset()

    @property
    def count(self) -> int:
        """Number of columns."""
        return len(self.mean)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of every column."""
        out = []
        for effect in self.effects:
            where = "" if effect.axis is None else f"{effect.axis}."
            out += [f"{where}{effect.name}.{c.name}" for c in effect.coefficients()]
        for i, k, _ in self.slopes:
            effect = self.effects[i]
            out.append(f"{effect.axis}.{effect.name}.{effect.shapes()[k].name}")
        return tuple(out)

    def columns(self, motion: Motion) -> list[tuple[int, slice, Floats]]:
        """Return the nonzero blocks: (joint, columns, values of shape (n, k))."""
        out = []
        slices = effect_slices(self.effects)
        for effect, where in zip(self.effects, slices, strict=True):
            for joint, values in effect_columns(effect, motion, self.distance):
                out.append((joint, where, values))
        at = slices[-1].stop
        for number, (i, k, theta) in enumerate(self.slopes):
            for joint, values in _slope(self.effects[i], k, theta, motion, self.distance):
                out.append((joint, slice(at + number, at + number + 1), values))
        return out


def effect_columns(effect: Effect, motion: Motion, distance: Floats) -> list[tuple[int, Floats]]:
    """Return (joint, columns) of one effect, dry friction with the memory of its bristles."""
    if isinstance(effect, DRY):
        axis = motion.axis(str(effect.axis))
        fade = None
        if isinstance(effect, Stribeck):
            fade = np.exp(-(np.abs(axis.v / effect.v_s) ** effect.exponent))
        state = bristles(axis, float(distance[axis.index]), fade)
        if isinstance(effect, Stribeck):
            return [(axis.index, state[:, 1:])]
        z = state[:, :1]
        if isinstance(effect, CoulombAsymmetric):
            z = np.concatenate([np.maximum(z, 0.0), np.minimum(z, 0.0)], axis=1)
        return [(axis.index, z)]
    made = effect.columns(motion)
    return [(joint, made.values[:, k, :]) for k, joint in enumerate(made.joints)]


def _slope(
    effect: Effect, k: int, theta: Floats, motion: Motion, distance: Floats
) -> list[tuple[int, Floats]]:
    """Return the derivative of an effect's effort by one of its shapes."""
    shape, x = effect.shapes()[k], effect.shape_values()
    h = 1e-3 * abs(x[k]) if shape.log else 1e-4 * (shape.upper - shape.lower)
    out = []
    up, down = (effect.shaped([v + s * h * (i == k) for i, v in enumerate(x)]) for s in (1, -1))
    for (joint, a), (_, b) in zip(
        effect_columns(up, motion, distance), effect_columns(down, motion, distance), strict=True
    ):
        out.append((joint, ((a - b) @ theta / (2 * h))[:, None] * max(abs(x[k]), h)))
    return out


def plain_base(rows: Rows, effects: Sequence[Effect]) -> Base:
    """Return the base of some effects at the shapes they have, with no belief beside."""
    machine = rows.machine
    distance = np.array([usual_distance(r) for r in machine.rotary])
    p = effect_slices(effects)[-1].stop
    precision = np.diag(_weak(effects, rows, p))
    return Base(tuple(effects), distance, np.zeros(p), precision)


def with_slopes(base: Base, theta: Floats) -> Base:
    """Return the base with a first-order column for every searched shape that has an effect."""
    slices = effect_slices(base.effects)
    slopes = []
    for i, effect in enumerate(base.effects):
        for k in range(len(effect.shapes())):
            if effect.shapes()[k].name == "x_s":
                continue  # rows in motion hardly show it
            if np.linalg.norm(theta[slices[i]]) > 0.0:
                slopes.append((i, k, theta[slices[i]]))
    p = base.count + len(slopes)
    precision = np.zeros((p, p))
    precision[: base.count, : base.count] = base.precision
    return replace(base, slopes=tuple(slopes), mean=np.zeros(p), precision=precision)


CONTACT = 0.3  # of the effort's RMS: what the contact of a presliding law may do at a reversal


def _weak(effects: Sequence[Effect], rows: Rows, p: int) -> Floats:
    """Return a precision per column that only fills what the data leave open.

    Knots that are hardly passed, and the contact terms of presliding: they act at reversals, which the
    rows leave out, and would run away there.
    """
    size = {c.joint: float(np.std(c.y)) + 1e-12 for c in rows.channels}
    out = np.zeros(p)
    for effect, where in zip(effects, effect_slices(effects), strict=True):
        if isinstance(effect, PositionTable):
            joint = rows.motions[0].index(str(effect.axis))
            out[where] = 1.0 / size.get(joint, 1.0) ** 2
        if isinstance(effect, Presliding):
            joint = rows.motions[0].index(str(effect.axis))
            reach = np.max([np.abs(effect.columns(m).values[:, 0]).max(axis=0) for m in rows.motions], 0)
            for k, c in enumerate(effect.coefficients()):
                if c.name in ("m", "d"):
                    doubt = CONTACT * size.get(joint, 1.0) / max(float(reach[k]), 1e-12)
                    out[where.start + k] = 1.0 / doubt**2
    return out


WIDER = 1.5  # of a twin's covariance: what its model leaves out of its standard errors
DOUBT = 0.002  # of any other coefficient, beyond its standard error
TABLE_DOUBT = 0.2  # of a table's RMS: what its knots may be off by, interpolation included
SLOW_DOUBT = 0.2  # of dry friction that its Stribeck part, found at standstill, may be off by
UNKNOWN = 2.0  # standard errors below which a coefficient is not known
SHAPE_DOUBT = 0.25  # relative change of a shape that is not worth a name
PITCH_DOUBT = 1e-3  # the same for a pitch


def change_base(twin: Twin, rows: Rows, *, scatter: float = 0.015) -> Base:
    """Return the base of a twin: its coefficients with their covariance, and ordinary scatter."""
    distance = np.array([usual_distance(r) for r in twin.machine.rotary])
    effects, place = _relaid(twin, rows)
    count = effect_slices(effects)[-1].stop
    theta, doubt = np.zeros(count), np.zeros(count)
    covariance = np.zeros((count, count))
    theta[place], doubt[place] = twin.theta, _doubt(twin, scatter)
    covariance[np.ix_(place, place)] = WIDER * np.array(twin.covariance)
    open_ = np.diag(covariance) <= 0.0
    covariance += np.diag(doubt**2)
    precision = np.zeros_like(covariance)
    known = np.flatnonzero(~open_)
    scale = np.sqrt(np.diag(covariance)[known])
    normal = covariance[np.ix_(known, known)] / np.outer(scale, scale)
    normal += 1e-9 * np.eye(len(known))
    precision[np.ix_(known, known)] = np.linalg.inv(normal) / np.outer(scale, scale)
    weak = _weak(effects, rows.fitted, count)
    precision[open_, open_] = weak[open_]
    plain = Base(effects, distance, theta, precision, (), True, unknown=_unknown(twin))
    sloped = with_slopes(plain, theta)
    for k, (i, shape, _) in enumerate(sloped.slopes):
        name = effects[i].shapes()[shape].name
        at = plain.count + k
        sloped.precision[at, at] = 1.0 / (PITCH_DOUBT if name == "period" else SHAPE_DOUBT) ** 2
    mean = np.concatenate([theta, np.zeros(len(sloped.slopes))])
    return replace(sloped, mean=mean)


def _unknown(twin: Twin) -> frozenset[tuple[str, str | None]]:
    """Return the effects whose size the twin's own logs did not determine: their shape is nothing then.

    A Stribeck speed that was found for no Stribeck friction hides none; where a log then shows some, it is
    not a change.
    """
    out: set[tuple[str, str | None]] = set()
    error = np.sqrt(np.maximum(np.diag(twin.covariance), 0.0))
    for effect, where in zip(twin.effects, effect_slices(twin.effects), strict=True):
        names = [c.name for c in effect.coefficients()]
        own = np.array([n == "s" for n in names]) if "s" in names else np.ones(len(names), bool)
        small = np.abs(twin.theta[where])[own] < UNKNOWN * error[where][own]
        if effect.shapes() and small.all():
            out.add(("stribeck" if "s" in names else effect.name, effect.axis))
    return frozenset(out)


def _relaid(twin: Twin, rows: Rows) -> tuple[tuple[Effect, ...], Ints]:
    """Return the twin's effects with tables over the new travel too, and where its theta goes."""
    effects: list[Effect] = []
    place: list[int] = []
    for effect in twin.effects:
        start, first = sum(len(e.coefficients()) for e in effects), 0
        if isinstance(effect, PositionTable) and effect.start is not None:
            assert effect.spacing is not None
            assert effect.stop is not None
            q = np.concatenate([m.q[:, m.index(effect.axis)] for m in rows.motions])
            first = max(int(np.ceil((effect.start - q.min()) / effect.spacing)), 0)
            last = max(int(np.ceil((q.max() - effect.stop) / effect.spacing)), 0)
            wider = replace(
                effect,
                start=effect.start - first * effect.spacing,
                stop=effect.stop + last * effect.spacing,
            )
            effects.append(wider)
        else:
            effects.append(effect)
        place += range(start + first, start + first + len(effect.coefficients()))
    return tuple(effects), np.array(place)


def _doubt(twin: Twin, scatter: float) -> Floats:
    """Return what a twin's coefficients may be off by beyond their covariance, shape (p,)."""
    out = np.zeros(len(twin.theta))
    for effect, where in zip(twin.effects, effect_slices(twin.effects), strict=True):
        theta = np.abs(twin.theta[where])
        share = scatter if effect.name in SCATTERED else DOUBT
        out[where] = share * theta
        if isinstance(effect, PositionTable) and len(theta):
            out[where] = TABLE_DOUBT * float(np.sqrt(np.mean(theta**2)))
        for k, c in enumerate(effect.coefficients()):
            if c.name == "s":
                out[where.start + k] = SLOW_DOUBT * theta.max()
    return out


def is_scattered(effect: Effect) -> bool:
    """Whether the coefficients of an effect differ a little from run to run."""
    return effect.name in SCATTERED


__all__ = [
    "Base",
    "change_base",
    "effect_columns",
    "is_scattered",
    "plain_base",
    "with_slopes",
]
