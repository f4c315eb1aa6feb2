"""Identify the closed loop of an axis: poles searched, numerators projected out (thesis 4.2.3).

What a model leaves is never white: the covariance is the sandwich of :func:`pinotwin.solve.sandwich.batch_means`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy
from threadpoolctl import threadpool_limits

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import DataError
from pinotwin.loop.data import LoopData
from pinotwin.loop.layout import Bounds, Layout, Parameter, lay_out
from pinotwin.loop.model import LoopFit, LoopModel, ParameterFit
from pinotwin.loop.projection import Misfit, Projection, Scales
from pinotwin.loop.search import search
from pinotwin.loop.sections import discretise
from pinotwin.loop.structure import Structure
from pinotwin.solve.descent import End
from pinotwin.solve.sandwich import batch_means


def identify_loop(
    data: LoopData,
    structure: Structure | None = None,
    *,
    bounds: Bounds | None = None,
    starts: Floats | None = None,
    judged: bool = True,
) -> LoopModel:
    """Return the closed-loop model of one axis; DataError if the data are too short, or nothing moves.

    ``structure`` has three real poles and one pair where absent; ``bounds`` replace the usual ones by parameter name,
    [Hz] or [-], e.g. ``{"p1": (1, 100), "zeta1": (0.1, 1.5)}``; ``starts`` of theta (logarithms of rad/s or of zeta)
    have shape (k, np). ``judged``: also find intervals and errors, a third of the time.
    """
    structure = structure or Structure()
    data.require_motion()
    layout = lay_out(structure, data.step, (data.d.shape[1], data.outputs.shape[1]), bounds)
    unknown = len(layout.parameters) + layout.residues + len(data.segments) * structure.order
    if data.rows < 3 * unknown:
        raise DataError(
            f"{data.axis}: {data.rows} samples in {len(data.segments)} segments for about "
            f"{unknown} unknowns; give a longer log or a structure with fewer poles"
        )
    # On few cores OpenBLAS' own threads make the many small factorisations slower, not faster.
    with threadpool_limits(1, "blas"):
        found, ends = search(data, layout, starts)
        projection = Projection(data, layout, Scales.of(data))
        misfit = projection.evaluate(found.x)
        residues = misfit.residues * projection.scales.residue_units(layout)
        names = data.axis, data.disturbance_names, data.output_names
        model = LoopModel(*names, data.step, layout.structure, layout.shaped(found.x), residues)
        if not judged:
            return model
        spread = covariance(projection, found.x, on_bound(layout, found.x) != 0)
    fit = _judge(data, projection, found, misfit, spread, model)
    return replace(model, fit=replace(fit, ends=ends))


def on_bound(layout: Layout, theta: Floats, share: float = 1e-3) -> Floats:
    """Return -1, 0 or 1 per parameter: on its lower bound, inside, on its upper bound, to a share of their width."""
    low, high = layout.box
    near = share * (high - low)
    return np.where(theta <= low + near, -1, np.where(theta >= high - near, 1, 0))


def _judge(
    data: LoopData,
    projection: Projection,
    found: End,
    misfit: Misfit,
    spread: tuple[Floats, int],
    model: LoopModel,
) -> LoopFit:
    layout, (joint, blocks) = projection.layout, spread
    sides, variances = on_bound(layout, found.x), np.diag(joint)[: len(found.x)]
    quantile = float(scipy.stats.t.ppf(0.975, max(blocks - 1, 1)))
    numbers = zip(layout.parameters, found.x, sides, variances, strict=True)
    parameters = [pole_fit(p, x, int(side), variance, quantile) for p, x, side, variance in numbers]
    parts = misfit.residual.reshape(layout.outputs, -1)
    rms = np.sqrt(np.sum(parts**2, axis=1) / data.rows) * projection.scales.outputs
    rows = np.r_[*data.segments]
    size = np.sqrt(np.mean(data.outputs[rows] ** 2, axis=0))
    return LoopFit(
        parameters=tuple(parameters),
        numerator_errors=_numerator_errors(model, found.x, joint, projection),
        nrmse=dict(zip(data.output_names, (rms / size).tolist(), strict=True)),
        rms=dict(zip(data.output_names, rms.tolist(), strict=True)),
        samples=data.rows,
        blocks=blocks,
        evaluations=found.evaluations,
        notes=_notes(parameters),
    )


def pole_fit(p: Parameter, x: float, side: int, variance: float, quantile: float) -> ParameterFit:
    """Return one searched pole at its logarithm x, with the interval of so many standard errors."""
    value = math.exp(x) / p.scale
    error = None if side else math.sqrt(max(variance, 0.0))
    interval = None
    if error is not None:
        half = min(quantile * error, 50.0)
        interval = (value * math.exp(-half), value * math.exp(half))
    unit = "-" if p.name.startswith("zeta") else "Hz"
    where = {-1: "lower", 0: None, 1: "upper"}[side]
    return ParameterFit(p.name, value, unit, (p.lower, p.upper), error, interval, where)


def _notes(parameters: list[ParameterFit]) -> tuple[str, ...]:
    notes = [
        f"{p.name} = {p.value:.4g} {p.unit} ended on its {p.at_bound} bound: the log does not "
        "fix it, or the structure has a pole too many"
        for p in parameters
        if p.at_bound
    ]
    notes += [
        f"{p.name} = {p.value:.4g} {p.unit} is known to a factor of {math.exp(1.96 * p.error):.2g} only"
        for p in parameters
        if p.error is not None and p.error > 0.5
    ]
    return tuple(notes)


def _numerator_errors(
    model: LoopModel, theta: Floats, joint: Floats, projection: Projection
) -> Mapping[str, tuple[float, ...]]:
    """Return standard errors of all numerator coefficients, by the delta method."""
    layout = projection.layout
    units = projection.scales.residue_units(layout)
    base = np.concatenate([theta, model.residues.ravel()])
    scale = np.concatenate([np.ones(len(theta)), units.ravel()])
    count = len(theta)

    def numerators(x: Floats) -> list[Floats]:
        residues = x[count:].reshape(model.residues.shape)
        moved = replace(model, sections=layout.shaped(x[:count]), residues=residues)
        return [moved.numerator(o, i)[0] for o in model.outputs for i in model.inputs]

    here = numerators(base)
    size, axes = np.linalg.eigh(joint)
    errors = [np.zeros_like(x) for x in here]
    # Along each principal direction of the covariance: as many as there are free numbers.
    for variance, axis in zip(size, axes.T, strict=True):
        if variance <= 1e-14 * max(size[-1], 1e-300):
            continue
        reach = 1e-3 * math.sqrt(variance)
        moved = numerators(base + reach * axis * scale)
        for total, now, then in zip(errors, here, moved, strict=True):
            total += ((then - now) / 1e-3) ** 2
    names = [f"{o}/{i}" for o in model.outputs for i in model.inputs]
    return {n: tuple(np.sqrt(e).tolist()) for n, e in zip(names, errors, strict=True)}


def slopes(data: LoopData, model: LoopModel) -> Floats:
    """Return the slopes of a loop's outputs, over their RMS, by its poles and free residues, shape (rows * ny, k)."""
    tangents = [t for t, _ in _linearised(Projection(data, model.layout, Scales.of(data)), model.theta)[0]]
    poles, rows = len(model.theta), len(tangents[0])
    own = [np.zeros((rows, len(tangents), t.shape[1] - poles)) for t in tangents]
    for k, t in enumerate(tangents):
        own[k][:, k] = t[:, poles:]
    shared = np.stack([t[:, :poles] for t in tangents], axis=1)
    return np.concatenate([shared, *own], axis=2).reshape(rows * len(tangents), -1)


def covariance(projection: Projection, theta: Floats, held: Mask) -> tuple[Floats, int]:
    """Return the covariance of logarithms and scaled residues, with bounds, shape (np,), as known; and its blocks."""
    tangents, scores = _linearised(projection, theta)
    ny, nc = projection.layout.outputs, projection.layout.residues
    count = len(theta)
    free = [t[:, np.concatenate([~held, np.ones(t.shape[1] - count, dtype=bool)])] for t, _ in tangents]
    # Columns: free poles, then the free directions of the residues, output after output.
    poles = int(np.sum(~held))
    total = poles + sum(t.shape[1] - poles for t in free)
    H, S = np.zeros((total, total)), np.zeros((len(free[0]), total))
    T = np.zeros((count + ny * nc, total))
    T[np.flatnonzero(~held), np.arange(poles)] = 1.0
    at = poles
    for k, G in enumerate(free):
        places = np.concatenate([np.arange(poles), np.arange(at, at + G.shape[1] - poles)])
        H[np.ix_(places, places)] += G.T @ G
        S[:, places] += G * scores[k][:, None]
        rows = slice(count + k * nc, count + (k + 1) * nc)
        to_residues = tangents[k][1]
        T[rows, :poles] = to_residues[:, :count][:, ~held]
        T[rows, at : at + G.shape[1] - poles] = to_residues[:, count:]
        at += G.shape[1] - poles
    own, blocks = batch_means(H, S, poles or total, ny * len(S))
    return T @ own @ T.T, blocks


def _linearised(projection: Projection, theta: Floats) -> tuple[list[tuple[Floats, Floats]], list[Floats]]:
    """Return per output (tangent (n, np + nz), that of the residues (nc, np + nz)), residual."""
    sections = projection.layout.shaped(theta)
    discrete = discretise(sections, projection.step)
    wide = projection.filtered(discrete)
    lengths = projection.blocks[:, 1] - projection.blocks[:, 0]
    rows = np.concatenate([wide[m, :, :n].T for m, n in enumerate(lengths)])
    misfit = projection.evaluate(theta)
    tangents, residuals = [], []
    columns = projection.columns
    phi = rows[:, columns.phi]
    for k, c in enumerate(misfit.residues):
        ties = projection.layout.ties(sections, k, projection.scales.gains(k))
        directions, moves = ties.particular()[1], ties.moves(c)
        slopes = np.zeros((len(rows), len(theta)))
        for i, pairs in enumerate(columns.slopes):
            slopes[:, i] = rows[:, pairs[:, 0]] @ c[pairs[:, 1]]
        to_residues = np.concatenate([moves, directions], axis=1)
        tangent = phi @ to_residues
        tangent[:, : len(theta)] += slopes
        both = np.column_stack([tangent, rows[:, columns.output + k] - phi @ c])
        projection.clear_free(discrete, sections, both)
        tangents.append((both[:, :-1], to_residues))
        residuals.append(both[:, -1])
    return tangents, residuals
