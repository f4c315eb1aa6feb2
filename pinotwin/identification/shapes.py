"""Search of the effects' shapes: each effect with shapes is a moving block of the separable problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.effects import Effect
from pinotwin.effects.layout import effect_keys, effect_slices
from pinotwin.identification.assemble import Rows, assemble, coefficient_names, thin
from pinotwin.identification.settings import better
from pinotwin.motion import Motion
from pinotwin.solve.linear import Options
from pinotwin.solve.moving import Moving
from pinotwin.solve.projection import Span
from pinotwin.solve.result import LinearFit, ShapeFit
from pinotwin.solve.separable import separable

Found = tuple[LinearFit, tuple[Effect, ...], Floats, Mask]


def search_shapes(
    motion: Motion,
    effects: tuple[Effect, ...],
    rows: Rows,
    searched: Sequence[int],
    options: Options,
    unknown: Sequence[int] | None = None,
) -> Found:
    """Find the shapes of some effects, by their index, together with all coefficients.

    Those ``unknown`` (all by default) are searched all over, the others about their shapes. For every shape of every
    effect go its standard error (nan where not searched) and whether it ended at a bound.
    """
    slices = effect_slices(effects)
    fixed = [i for i in range(len(effects)) if i not in searched]
    order = np.concatenate([np.arange(slices[i].start, slices[i].stop) for i in [*fixed, *searched]])
    keys, names = effect_keys(effects), coefficient_names(effects)
    blocks = [_moving(motion, effects[i], keys[i], tuple(names[slices[i]]), rows) for i in searched]
    present = {k: np.array(effects[i].shape_values()) for k, i in enumerate(searched)}
    known = {} if unknown is None else {k: x for k, x in present.items() if searched[k] not in unknown}
    ordered = options.by_coefficient(lambda x, _: x[order])
    fit, shapes = separable(assemble(motion, [effects[i] for i in fixed], rows), blocks, ordered, known)
    shaped, errors, bounds = _with_shapes(effects, searched, shapes)
    return _restored(fit, np.argsort(order), names), shaped, errors, bounds


def widened(motion: Motion, effects: Sequence[Effect], rows: Rows, pays: float) -> dict[int, Effect]:
    """Return effects, by place, worth a further shape: it brings what an axis leaves below the share ``pays``."""
    found = {}
    for k, effect in enumerate(effects):
        joint = None if effect.axis is None else motion.index(effect.axis)
        forms = effect.wider() if joint in rows.joints else ()
        if joint is None or not forms:
            continue
        own = rows.only(joint)
        rest = assemble(motion, [e for e in effects if e is not effect], own)
        span = Span.of(rest, slice(0, len(rest.y)), effort=False)
        y = span.split(rest.y[:, None])[1][:, 0]

        def left(form: Effect, own: Rows = own, y: Floats = y, span: Span = span) -> float:
            columns = form.columns(motion)
            at = columns.joints.index(own.joints[0])
            W = span.split(thin(motion, columns.values[:, at])[own.kept[0]])[1]
            return float(np.linalg.norm(y - W @ np.linalg.lstsq(W, y, rcond=1e-9)[0]))

        if (best := better(effect, forms, left, pays)) is not effect:
            found[k] = best
    return found


def _moving(motion: Motion, effect: Effect, key: str, names: tuple[str, ...], rows: Rows) -> Moving:
    shapes = effect.shapes()
    joints = sorted(set(effect.columns(motion).joints) & set(rows.joints))
    # thousands of trials: a copy by mask costs as much as what is copied
    at = [rows.joints.index(joint) for joint in joints]
    picks = [None if rows.kept[k].all() else np.flatnonzero(rows.kept[k]) for k in at]

    def columns(values: Floats) -> Floats:
        own = effect.shaped(values.tolist()).columns(motion)
        found = [thin(motion, own.values[:, own.joints.index(joint), :]) for joint in joints]
        kept = [x if pick is None else x.take(pick, axis=0) for x, pick in zip(found, picks, strict=True)]
        return kept[0] if len(kept) == 1 else np.concatenate(kept)

    ends = np.cumsum([0, *(kept.sum() for kept in rows.kept)]).tolist()
    places = [slice(ends[k], ends[k + 1]) for k in at]
    return Moving(
        name=key,
        rows=places[0] if len(places) == 1 else np.r_[*places],
        columns=columns,
        names=names,
        shapes=tuple(s.name for s in shapes),
        lower=np.array([s.lower for s in shapes]),
        upper=np.array([s.upper for s in shapes]),
        log=np.array([s.log for s in shapes]),
        starts=effect.grid(motion),
    )


def _restored(fit: LinearFit, back: Ints, names: Sequence[str]) -> LinearFit:
    """Return the fit with its parameters in the order ``back`` picks them."""
    place, problem = np.argsort(back), fit.problem
    each = ("theta", "dof", "determined", "active", "lower", "upper")
    return replace(
        fit,
        problem=problem.with_columns(problem.W[:, back], names),
        covariance=fit.covariance[np.ix_(back, back)],
        unexcited=tuple(sorted(int(place[k]) for k in fit.unexcited)),
        groups=tuple(tuple(sorted(int(place[k]) for k in group)) for group in fit.groups),
        factor=fit.factor[:, back],
        **{name: getattr(fit, name)[back] for name in each},
    )


def _with_shapes(
    effects: Sequence[Effect], searched: Sequence[int], shapes: Sequence[ShapeFit]
) -> tuple[tuple[Effect, ...], Floats, Mask]:
    """Return the effects at the shapes found, and error and bound of every shape of every effect."""
    out, left = list(effects), list(shapes)
    errors = [np.full(len(e.shapes()), np.nan) for e in effects]
    bounds = [np.zeros(len(e.shapes()), bool) for e in effects]
    for i in searched:
        mine = [left.pop(0) for _ in effects[i].shapes()]
        out[i] = effects[i].shaped([s.value for s in mine])
        errors[i] = np.array([s.standard_error for s in mine])
        bounds[i] = np.array([s.at_bound for s in mine])
    return tuple(out), np.concatenate(errors), np.concatenate(bounds)
