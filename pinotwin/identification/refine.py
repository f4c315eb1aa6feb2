"""Friction, ripple and tables found once more, through the closed loop (thesis Fig. 4-6, step 4).

The open-loop fit takes the effort for what the rigid model needs, so what bends behind the encoder, or
filters and delays in the loop, leaks into friction. In the closed loop the same effects act as the
disturbance of an LTI system that was identified with its poles and zeros:

    [e; u] = G_qr qr + G_d (d_rest + sum_j theta_j column_j)

which is linear in theta again. So loops and coefficients are found in turn, and the few shapes are
polished by a short local search around them. The result is kept only if it pays on the part of the log
that it did not see.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares, lsq_linear

from pinotwin.arrays import Floats
from pinotwin.effects import Effect
from pinotwin.loop import LoopData, LoopModel
from pinotwin.motion import Motion
from pinotwin.solve.sandwich import block_covariance

TRUST = 10.0
"""How many of its standard errors a coefficient may move before the open-loop fit holds it back."""
STEPS = 4
"""Gauss-Newton steps on the shapes: they start close."""
MOST_COLUMNS = 60
"""Effects with more columns than this (tables) stay as they are: each trial would filter them all."""


@dataclass(frozen=True)
class AxisEffects:
    """The effects of one axis beside the rigid body and viscous friction.

    Attributes:
        axis: its name.
        effects: with their present shapes.
        where: indices of all their coefficients in the twin's theta.
        theta: present coefficients.
        error: their standard errors in the open-loop fit.
        lower: bounds of the coefficients.
        shape_error: standard errors of the shapes (of their logarithms where searched so).
    """

    axis: str
    effects: tuple[Effect, ...]
    where: tuple[int, ...]
    theta: Floats
    error: Floats
    lower: Floats
    shape_error: Floats | None = None

    def columns(self, motion: Motion) -> Floats:
        """Return the columns of all effects, shape (n, p)."""
        at = motion.index(self.axis)
        parts = [effect.columns(motion) for effect in self.effects]
        return np.concatenate([c.values[:, c.joints.index(at), :] for c in parts], axis=1)

    def shape_values(self) -> Floats:
        """Return all shapes, log where they are searched so."""
        out = []
        for effect in self.effects:
            for shape, value in zip(effect.shapes(), effect.shape_values(), strict=True):
                out.append(np.log(value) if shape.log else value)
        return np.array(out)

    def shape_scales(self, motion: Motion) -> Floats:
        """Return a modest step of each shape: a tenth of a wave over the travel for a pitch."""
        travel = float(np.ptp(motion.axis(self.axis).q))
        out = []
        for effect in self.effects:
            for shape, value in zip(effect.shapes(), effect.shape_values(), strict=True):
                pitch = shape.name == "period"
                out.append(0.1 * value / max(travel, value) if pitch else 0.3)
        return np.array(out)

    def shaped(self, x: Floats) -> AxisEffects:
        """Return the effects at other shapes, kept within their bounds."""
        rest = list(x)
        effects = []
        for effect in self.effects:
            values = []
            for shape in effect.shapes():
                raw = rest.pop(0)
                value = float(np.exp(raw)) if shape.log else float(raw)
                values.append(min(max(value, shape.lower), shape.upper))
            effects.append(effect.shaped(values))
        return replace(self, effects=tuple(effects))


def refine(
    data: LoopData, model: LoopModel, motion: Motion, found: AxisEffects, *, explore: bool = False
) -> AxisEffects:
    """Return the effects with shapes and coefficients that explain e and u best through a loop.

    Args:
        data: command, disturbance and outputs of the axis; the disturbance belongs to ``found``.
        model: the loop, held as it is.
        motion: the motion behind ``data``.
        found: what to refine.
        explore: also try friction that falls with speed by the other exponent.
    """
    rest = data.d[:, 0] - found.columns(motion) @ found.theta
    weight = 1.0 / np.maximum(_size(data, data.outputs), 1e-300)
    target = (data.outputs - _through(model, data, rest, command=True)) * weight
    forms = [found, *_others(found)] if explore else [found]
    shaped = [_shaped(data, model, motion, form, target, weight) for form in forms]
    best = min(shaped, key=lambda pair: pair[1])[0]
    return _finished(data, model, motion, best, target, weight)


def _others(found: AxisEffects) -> list[AxisEffects]:
    """Return the effects with the other usual exponent of Stribeck's curve, 1 or 2, if they have one."""
    swapped = tuple((e.other_forms() or (e,))[0] for e in found.effects)
    return [] if swapped == found.effects else [replace(found, effects=swapped)]


def _shaped(
    data: LoopData, model: LoopModel, motion: Motion, found: AxisEffects, y: Floats, weight: Floats
) -> tuple[AxisEffects, float]:
    """Return the effects with their shapes polished, and half the sum of squares there."""

    def misfit(trial: AxisEffects) -> Floats:
        return _solve(data, model, trial, trial.columns(motion), y, weight)[1]

    start = found.shape_values()
    if len(start) == 0:
        return found, 0.0
    scale = found.shape_scales(motion)
    best = least_squares(
        lambda k: misfit(found.shaped(start + scale * (k - 1.0))),
        np.ones(len(start)),
        diff_step=0.05,
        max_nfev=STEPS,
        ftol=1e-4,
        xtol=1e-3,
    )
    return found.shaped(start + scale * (best.x - 1.0)), float(best.cost)


def _finished(
    data: LoopData, model: LoopModel, motion: Motion, found: AxisEffects, y: Floats, weight: Floats
) -> AxisEffects:
    """Return the effects with their coefficients and the standard errors of all that was found."""

    def residual(x: Floats) -> Floats:
        trial = found.shaped(x)
        return y - (_filtered(data, model, trial.columns(motion), weight) @ theta).reshape(y.shape)

    columns = found.columns(motion)
    theta, _ = _solve(data, model, found, columns, y, weight)
    inside = np.concatenate([np.arange(s.start, s.stop) for s in data.segments])
    A = _filtered(data, model, columns, weight).reshape(len(y), y.shape[1], -1)[inside]
    x = found.shape_values()
    steps = 0.05 * found.shape_scales(motion)
    slopes = [(residual(x - h) - residual(x + h))[inside] / (2.0 * float(h.sum())) for h in np.diag(steps)]
    J = np.concatenate([A, np.stack(slopes, axis=-1)], axis=-1) if slopes else A
    rows = J.reshape(-1, J.shape[-1])
    spread = block_covariance(rows, residual(x)[inside].ravel())
    errors = np.sqrt(np.maximum(np.diag(spread), 0.0))
    count = len(theta)
    return replace(found, theta=theta, error=errors[:count], shape_error=errors[count:])


def _solve(
    data: LoopData, model: LoopModel, trial: AxisEffects, columns: Floats, y: Floats, weight: Floats
) -> tuple[Floats, Floats]:
    """Return coefficients and residual of one set of shapes."""
    inside = np.concatenate([np.arange(s.start, s.stop) for s in data.segments])
    A = _filtered(data, model, columns, weight).reshape(len(y), y.shape[1], -1)[inside]
    A = A.reshape(-1, A.shape[-1])
    b = y[inside].ravel()
    noise = max(float(np.std(b - A @ trial.theta)), 1e-12)
    held = TRUST * np.where(np.isfinite(trial.error), trial.error, np.abs(trial.theta) + 1e-9)
    prior = np.diag(noise / np.maximum(held, 1e-12))
    both = np.concatenate([np.column_stack([A, b]), np.column_stack([prior, prior @ trial.theta])])
    small: Floats = np.asarray(np.linalg.qr(both, mode="r"))
    theta = lsq_linear(small[:, :-1], small[:, -1], bounds=(trial.lower, np.inf)).x
    return theta, b - A @ theta


def _filtered(data: LoopData, model: LoopModel, columns: Floats, weight: Floats) -> Floats:
    """Return the weighted outputs of the loop to every column, shape (n * ny, p)."""
    parts = [(_through(model, data, c, command=False) * weight).ravel() for c in columns.T]
    return np.stack(parts, axis=1)


def _through(model: LoopModel, data: LoopData, d: Floats, *, command: bool) -> Floats:
    """Return the outputs of the loop to a disturbance, with or without the command, shape (n, ny)."""
    out = np.zeros_like(data.outputs)
    still = np.zeros(1)
    for s in data.segments:
        if command:
            out[s] = model.simulate(data.qr[s], d[s], vr=data.velocity[s], ar=data.acceleration[s])
        else:
            still = np.zeros(s.stop - s.start)
            out[s] = model.simulate(still, d[s], vr=still, ar=still)
    return out


def _size(data: LoopData, values: Floats) -> Floats:
    inside = np.concatenate([np.arange(s.start, s.stop) for s in data.segments])
    return np.sqrt(np.mean(values[inside] ** 2, axis=0))


def axis_effects(
    effects: Sequence[Effect], slices: Sequence[slice], theta: Floats, errors: Floats, axis: str
) -> AxisEffects | None:
    """Return what can be refined on one axis, or None if there is nothing."""
    mine = [
        (effect, where)
        for effect, where in zip(effects, slices, strict=True)
        if effect.axis == axis
        and set(effect.causes) <= {"friction", "position"}
        and effect.refined_in_loop
        and 0 < len(effect.coefficients()) <= MOST_COLUMNS
    ]
    if not mine:
        return None
    where = [k for _, s in mine for k in range(s.start, s.stop)]
    lower = [c.lower for effect, _ in mine for c in effect.coefficients()]
    return AxisEffects(
        axis=axis,
        effects=tuple(effect for effect, _ in mine),
        where=tuple(where),
        theta=theta[where],
        error=errors[where],
        lower=np.array(lower),
    )
