"""Identify the closed loop of an axis: poles searched, numerators projected out (thesis 4.2.3).

What a model leaves is never white: the covariance is the sandwich of :func:`pinotwin.solve.sandwich.batch_means`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import DataError
from pinotwin.loop.data import LoopData
from pinotwin.loop.layout import Bounds, Layout, Parameter, lay_out
from pinotwin.loop.model import LoopFit, LoopModel, ParameterFit
from pinotwin.loop.projection import Projection, Scales
from pinotwin.loop.search import search
from pinotwin.loop.sections import discretise
from pinotwin.loop.structure import Structure
from pinotwin.solve.sandwich import batch_means
from pinotwin.system.threads import one_blas_thread


@one_blas_thread
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
    found, ends = search(data, layout, starts)
    projection = Projection(data, layout, Scales.of(data))
    misfit = projection.evaluate(found.x)
    residues = misfit.residues * projection.scales.residue_units(layout)
    names = data.axis, data.disturbance_names, data.output_names
    model = LoopModel(*names, data.step, layout.structure, layout.shaped(found.x), residues)
    if not judged:
        return model
    variances, blocks = _variances(projection, found.x, on_bound(layout, found.x) != 0)
    left = misfit.residual.reshape(layout.outputs, -1)
    quantile = float(scipy.stats.t.ppf(0.975, max(blocks - 1, 1)))
    rest = {"blocks": blocks, "evaluations": found.evaluations, "ends": ends}
    fit = account(data, layout, found.x, variances, left, quantile, **rest)
    return replace(model, fit=replace(fit, notes=_notes(fit.parameters)))


def on_bound(layout: Layout, theta: Floats, share: float = 1e-3) -> Floats:
    """Return -1, 0 or 1 per parameter: on its lower bound, inside, on its upper bound, to a share of their width."""
    low, high = layout.box
    near = share * (high - low)
    return np.where(theta <= low + near, -1, np.where(theta >= high - near, 1, 0))


def account(
    data: LoopData,
    layout: Layout,
    theta: Floats,
    variances: Floats,
    left: Floats,
    quantile: float = 1.96,
    **rest: Any,
) -> LoopFit:
    """Return poles, theta (np,), with intervals of so many standard errors, and the errors of the outputs.

    What is ``left`` of them is over their RMS, shape (ny, n).
    """
    numbers = zip(layout.parameters, theta, on_bound(layout, theta), variances, strict=True)
    nrmse = np.sqrt(np.sum(left**2, axis=1) / data.rows)
    return LoopFit(
        parameters=tuple(_pole(p, x, int(side), variance, quantile) for p, x, side, variance in numbers),
        nrmse=dict(zip(data.output_names, nrmse.tolist(), strict=True)),
        rms=dict(zip(data.output_names, (nrmse * Scales.of(data).outputs).tolist(), strict=True)),
        samples=data.rows,
        **rest,
    )


def _pole(p: Parameter, x: float, side: int, variance: float, quantile: float) -> ParameterFit:
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


def _notes(parameters: Sequence[ParameterFit]) -> tuple[str, ...]:
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


def slopes(data: LoopData, model: LoopModel) -> Floats:
    """Return the slopes of a loop's outputs, over their RMS, by its poles and free residues, shape (rows * ny, k)."""
    J, _ = _linearised(Projection(data, model.layout, Scales.of(data)), model.theta)
    return J.reshape(-1, J.shape[2])


def _variances(projection: Projection, theta: Floats, held: Mask) -> tuple[Floats, int]:
    """Return the variances of the poles' logarithms, shape (np,), 0 of those on bounds; and blocks that tell them."""
    J, left = _linearised(projection, theta)
    J, poles = np.delete(J, np.flatnonzero(held), axis=2), int(np.sum(~held))
    H = np.tensordot(J, J, ((0, 1), (0, 1)))
    S = np.sum(J * left[:, :, None], axis=1)
    own, blocks = batch_means(H, S, poles or len(H), left.size)
    variances = np.zeros(len(theta))
    variances[~held] = np.diag(own)[:poles]
    return variances, blocks


def _linearised(projection: Projection, theta: Floats) -> tuple[Floats, Floats]:
    """Return the Jacobian (n, ny, k), of poles, then of each output's free residues, and the residual (n, ny)."""
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
        tangent = phi @ np.concatenate([ties.moves(c), ties.particular()[1]], axis=1)
        tangent[:, : len(theta)] += columns.moved(rows, c)
        both = np.column_stack([tangent, rows[:, columns.output + k] - phi @ c])
        projection.clear_free(discrete, sections, both)
        tangents.append(both[:, :-1])
        residuals.append(both[:, -1])
    J = np.zeros((len(phi), len(tangents), len(theta) + sum(t.shape[1] - len(theta) for t in tangents)))
    at = len(theta)
    for k, t in enumerate(tangents):
        more = t.shape[1] - len(theta)
        J[:, k, : len(theta)], J[:, k, at : at + more] = t[:, : len(theta)], t[:, len(theta) :]
        at += more
    return J, np.stack(residuals, axis=1)
