"""Search of the effects' shapes: each effect with shapes is a moving block of the separable problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.effects import Effect
from pinotwin.effects.layout import effect_keys, effect_slices
from pinotwin.identification.assemble import Rows, assemble, coefficient_names, joint_columns, thin
from pinotwin.motion import Motion
from pinotwin.solve.linear import Options, Prior
from pinotwin.solve.moving import Moving
from pinotwin.solve.result import LinearFit
from pinotwin.solve.separable import separable

PAYS = 0.95
"""A further shape is searched where some value of it brings what an axis leaves below this share."""

Found = tuple[LinearFit, tuple[Effect, ...], Floats, Mask]


def search_shapes(
    motion: Motion,
    effects: tuple[Effect, ...],
    rows: Rows,
    searched: Sequence[int],
    options: Options,
    unknown: Sequence[int] | None = None,
) -> Found:
    """Find the shapes of some effects together with all coefficients.

    Args:
        motion: prepared log.
        effects: all effects, in the order of theta.
        rows: rows to fit.
        searched: indices of the effects whose shapes are searched.
        options: prior and bounds in the order of theta.
        unknown: those of them that are searched all over; about the others' present shapes only. All by default.

    Returns:
        The linear fit in the order of the effects, the effects at the shapes found, and for every
        shape of every effect its standard error (nan where it was not searched) and whether it
        ended at a bound.
    """
    slices = effect_slices(effects)
    fixed = [i for i in range(len(effects)) if i not in searched]
    order = np.concatenate([np.arange(slices[i].start, slices[i].stop) for i in [*fixed, *searched]])
    problem = assemble(motion, [effects[i] for i in fixed], rows)
    keys, names = effect_keys(effects), coefficient_names(effects)
    problem = problem.with_columns(problem.W, [names[k] for k in order[: problem.parameters]])
    blocks = [_moving(motion, effects[i], keys[i], tuple(names[slices[i]]), rows) for i in searched]
    present = {k: np.array(effects[i].shape_values()) for k, i in enumerate(searched)}
    known = {} if unknown is None else {k: x for k, x in present.items() if searched[k] not in unknown}
    found = separable(problem, blocks, _permuted(options, order), known)
    shaped, errors, bounds = _with_shapes(effects, searched, found.shapes)
    return _restored(found.fit, np.argsort(order)), shaped, errors, bounds


def widened(motion: Motion, effects: Sequence[Effect], rows: Rows) -> dict[int, Effect]:
    """Return which effects are worth a further shape, with it, by their place: each axis by itself.

    Args:
        motion: prepared log.
        effects: all effects, at the shapes found.
        rows: rows to fit.
    """
    found = {}
    for k, effect in enumerate(effects):
        joint = None if effect.axis is None else motion.index(effect.axis)
        forms = effect.wider() if joint in rows.joints else ()
        if joint is None or not forms:
            continue
        y, others = _alone(motion, [e for e in effects if e is not effect], rows, joint)
        basis = np.linalg.qr(others)[0]

        def left(form: Effect, joint: int = joint, y: Floats = y, basis: Floats = basis) -> float:
            W = _rows_of(motion, form, rows, joint)
            assert W is not None
            W = W - basis @ (basis.T @ W)
            theta = np.linalg.lstsq(W, y, rcond=1e-9)[0]
            return float(np.linalg.norm(y - W @ theta))

        y -= basis @ (basis.T @ y)
        best = min(forms, key=left)
        if left(best) < PAYS * left(effect):
            found[k] = best
    return found


def _alone(motion: Motion, effects: Sequence[Effect], rows: Rows, joint: int) -> tuple[Floats, Floats]:
    """Return effort and columns of one joint on the rows to fit, shapes (m,) and (m, p)."""
    parts = [_rows_of(motion, effect, rows, joint) for effect in effects]
    u = motion.u if motion.external is None else motion.u + motion.external
    kept = rows.kept[rows.joints.index(joint)]
    y = thin(motion, np.nan_to_num(u[:, joint]))[kept]
    return y, np.concatenate([x for x in parts if x is not None], axis=1)


def _rows_of(motion: Motion, effect: Effect, rows: Rows, joint: int) -> Floats | None:
    columns = joint_columns(motion, effect, joint)
    return None if columns is None else columns[rows.kept[rows.joints.index(joint)]]


def _moving(motion: Motion, effect: Effect, key: str, names: tuple[str, ...], rows: Rows) -> Moving:
    shapes = effect.shapes()
    joints = sorted(set(effect.columns(motion).joints) & set(rows.joints))
    # thousands of trials: a copy by mask costs as much as what is copied
    masks = [rows.kept[rows.joints.index(joint)] for joint in joints]
    picks = [None if kept.all() else np.flatnonzero(kept) for kept in masks]

    def columns(values: Floats) -> Floats:
        own = effect.shaped(values.tolist()).columns(motion)
        found = [thin(motion, own.values[:, own.joints.index(joint), :]) for joint in joints]
        kept = [x if pick is None else x.take(pick, axis=0) for x, pick in zip(found, picks, strict=True)]
        return kept[0] if len(kept) == 1 else np.concatenate(kept)

    places = [rows.slice_of(joint) for joint in joints]
    return Moving(
        name=key,
        rows=places[0] if len(places) == 1 else np.concatenate([np.arange(s.start, s.stop) for s in places]),
        columns=columns,
        names=names,
        shapes=tuple(s.name for s in shapes),
        lower=np.array([s.lower for s in shapes]),
        upper=np.array([s.upper for s in shapes]),
        log=np.array([s.log for s in shapes]),
        starts=effect.grid(motion),
    )


def _permuted(options: Options, order: Ints) -> Options:
    def pick(x: Floats | None) -> Floats | None:
        return None if x is None else x[order]

    prior = options.prior
    if prior is not None:
        prior = Prior(prior.mean[order], pick(prior.std))
    return replace(
        options,
        prior=prior,
        ridge=pick(options.ridge),
        lower=pick(options.lower),
        upper=pick(options.upper),
    )


def _restored(fit: LinearFit, back: Ints) -> LinearFit:
    """Return the fit with its parameters in the order ``back`` picks them."""
    place = np.argsort(back)
    problem = fit.problem
    return replace(
        fit,
        problem=problem.with_columns(problem.W[:, back], [problem.names[k] for k in back]),
        theta=fit.theta[back],
        covariance=fit.covariance[np.ix_(back, back)],
        determined=fit.determined[back],
        unexcited=tuple(sorted(int(place[k]) for k in fit.unexcited)),
        groups=tuple(tuple(sorted(int(place[k]) for k in group)) for group in fit.groups),
        active=fit.active[back],
        lower=fit.lower[back],
        upper=fit.upper[back],
        factor=fit.factor[:, back],
    )


def _with_shapes(effects, searched, shapes):  # type: ignore[no-untyped-def]
    out = list(effects)
    errors = [np.full(len(e.shapes()), np.nan) for e in effects]
    bounds = [np.zeros(len(e.shapes()), bool) for e in effects]
    at = 0
    for i in searched:
        mine = shapes[at : at + len(effects[i].shapes())]
        at += len(mine)
        out[i] = effects[i].shaped([s.value for s in mine])
        errors[i] = np.array([s.standard_error for s in mine])
        bounds[i] = np.array([s.bound is not None for s in mine])
    return tuple(out), np.concatenate(errors), np.concatenate(bounds)
