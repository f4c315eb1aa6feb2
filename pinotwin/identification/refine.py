"""Friction, ripple and tables found once more, through the closed loop (thesis Fig. 4-6, step 4).

What bends behind the encoder, or filters and delays in the loop, leaks into the friction of the open-loop fit. In the
closed loop the same effects act as the disturbance of an identified LTI system,

    [e; u] = G_qr qr + G_d (d_rest + sum_j theta_j column_j)

linear in theta again. Loops and coefficients are found in turn, the few shapes polished by a short local search. The
result is kept only if it pays on the part of the log that it did not see.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.effects import Effect, Shape
from pinotwin.loop import LoopData, LoopModel
from pinotwin.loop.identify import slopes
from pinotwin.motion import Motion
from pinotwin.solve.sandwich import block_covariance
from pinotwin.twin import OpenLoop, Parameters
from pinotwin.twin.parameters import verdict


@dataclass(frozen=True)
class AxisEffects:
    """The effects of one axis beside the rigid body and viscous friction."""

    axis: str  # its name
    keys: tuple[str, ...]  # of its effects in the twin
    effects: tuple[Effect, ...]  # with their present shapes
    where: tuple[int, ...]  # indices of all their coefficients in the twin's theta
    theta: Floats  # present coefficients
    error: Floats  # their standard errors in the open-loop fit
    lower: Floats  # bounds of the coefficients
    shape_error: Floats | None = None  # standard errors of the shapes (of their logarithms where searched so)

    def columns(self, motion: Motion) -> Floats:
        """Return the columns of all effects, shape (n, p)."""
        at = motion.index(self.axis)
        parts = [effect.columns(motion) for effect in self.effects]
        return np.concatenate([c.values[:, c.joints.index(at), :] for c in parts], axis=1)

    def shape_values(self) -> Floats:
        """Return all shapes, log where they are searched so."""
        return np.array([np.log(value) if shape.log else value for _, shape, value in self._shapes()])

    def shape_scales(self, motion: Motion) -> Floats:
        """Return a modest step of each shape: a tenth of a wave over the travel for a pitch."""
        travel = float(np.ptp(motion.axis(self.axis).q))
        pairs = [(shape.name == "period", value) for _, shape, value in self._shapes()]
        return np.array([0.1 * value / max(travel, value) if pitch else 0.3 for pitch, value in pairs])

    def shaped(self, x: Floats) -> AxisEffects:
        """Return the effects at other shapes, kept within their bounds."""
        pairs = [(s, np.exp(raw) if s.log else raw) for (_, s, _), raw in zip(self._shapes(), x, strict=True)]
        kept = [float(np.clip(value, s.lower, s.upper)) for s, value in pairs]
        effects = [effect.shaped([kept.pop(0) for _ in effect.shapes()]) for effect in self.effects]
        return replace(self, effects=tuple(effects))

    def numbers(self) -> Iterator[tuple[str, float, float]]:
        """Yield full name, value and standard error of every coefficient and shape, in plain units."""
        pairs = zip(self.keys, self.effects, strict=True)
        names = [f"{key}.{c.name}" for key, effect in pairs for c in effect.coefficients()]
        for name, value, error in zip(names, self.theta, self.error, strict=True):
            yield name, float(value), float(error)
        errors = np.full(len(self._shapes()), np.nan) if self.shape_error is None else self.shape_error
        for (key, shape, value), error in zip(self._shapes(), errors, strict=True):
            yield f"{key}.{shape.name}", value, float(value * error if shape.log else error)

    def _shapes(self) -> list[tuple[str, Shape, float]]:
        pairs = zip(self.keys, self.effects, strict=True)
        return [(key, *one) for key, e in pairs for one in zip(e.shapes(), e.shape_values(), strict=True)]


def refine(
    data: LoopData, model: LoopModel, motion: Motion, found: AxisEffects, *, explore: bool = False
) -> AxisEffects:
    """Return the effects with shapes and coefficients that explain e and u best through a loop, which is held.

    The disturbance in the data belongs to ``found``; ``explore``: try friction that falls by the other exponent, too.
    """
    problem = _Through(data, model, motion, found)
    forms = [found]
    if explore:
        swapped = tuple((e.other_forms() or (e,))[0] for e in found.effects)
        forms += [] if swapped == found.effects else [replace(found, effects=swapped)]
    best = min((problem.shaped(form) for form in forms), key=lambda pair: pair[1])[0]
    return problem.finished(best)


class _Through:
    """The outputs of a loop to an axis' effects, each weighted by its RMS, as a least-squares problem."""

    def __init__(self, data: LoopData, model: LoopModel, motion: Motion, found: AxisEffects) -> None:
        self.data, self.model, self.motion = data, model, motion
        self.inside = np.r_[*data.segments]
        size = np.sqrt(np.mean(data.outputs[self.inside] ** 2, axis=0))
        self.weight = 1.0 / np.maximum(size, 1e-300)
        rest = data.d[:, 0] - found.columns(motion) @ found.theta
        self.y = (data.outputs - self._outputs(rest, command=True))[self.inside] * self.weight

    def columns(self, trial: AxisEffects) -> Floats:
        """Return the weighted outputs of the loop to every column, shape (rows * outputs, p)."""
        columns = trial.columns(self.motion).T
        parts = [(self._outputs(c, command=False)[self.inside] * self.weight).ravel() for c in columns]
        return np.stack(parts, axis=1)

    def solve(self, trial: AxisEffects, trust: float = 10.0) -> tuple[Floats, Floats]:
        """Return coefficients, free within ``trust`` of their standard errors, and residual of one set of shapes."""
        A, b = self.columns(trial), self.y.ravel()
        noise = max(float(np.std(b - A @ trial.theta)), 1e-12)
        held = trust * np.where(np.isfinite(trial.error), trial.error, np.abs(trial.theta) + 1e-9)
        prior = np.diag(noise / np.maximum(held, 1e-12))
        both = np.concatenate([np.column_stack([A, b]), np.column_stack([prior, prior @ trial.theta])])
        small: Floats = np.asarray(np.linalg.qr(both, mode="r"))
        theta = scipy.optimize.lsq_linear(small[:, :-1], small[:, -1], bounds=(trial.lower, np.inf)).x
        return theta, b - A @ theta

    def shaped(self, found: AxisEffects, steps: int = 4) -> tuple[AxisEffects, float]:
        """Return the effects, shapes polished in few steps (they start close), and half the sum of squares."""
        start = found.shape_values()
        if len(start) == 0:
            return found, 0.0
        scale = found.shape_scales(self.motion)
        best = scipy.optimize.least_squares(
            lambda k: self.solve(found.shaped(start + scale * (k - 1.0)))[1],
            np.ones(len(start)),
            diff_step=0.05,
            max_nfev=steps,
            ftol=1e-4,
            xtol=1e-3,
        )
        return found.shaped(start + scale * (best.x - 1.0)), float(best.cost)

    def finished(self, found: AxisEffects) -> AxisEffects:
        """Return the effects with their coefficients and the standard errors of all that was found."""
        theta, left = self.solve(found)
        x = found.shape_values()
        J = [self.columns(found)]
        for h in np.diag(0.05 * found.shape_scales(self.motion)):
            less, more = (self.columns(found.shaped(x + side * h)) @ theta for side in (-1.0, 1.0))
            J.append((more - less)[:, None] / (2.0 * float(h.sum())))
        errors = self._errors(np.concatenate(J, axis=1), left, found.error)
        count = len(theta)
        return replace(found, theta=theta, error=errors[:count], shape_error=errors[count:])

    def _errors(self, J: Floats, left: Floats, before: Floats) -> Floats:
        """Return the standard errors (p,) of what has slopes J (n, p), beside a loop found from the same rows.

        What no row tells apart from the loop is as sure as it was ``before`` (coefficients,), without one.
        """
        basis = np.linalg.qr(slopes(self.data, self.model))[0]
        size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        alone = (J - basis @ (basis.T @ J)) / size
        known, V = np.linalg.eigh(block_covariance(alone, left))
        told = np.zeros(len(size))
        told[: len(before)] = (1.0 / np.maximum(before * size[: len(before)], 1e-300)) ** 2
        both = (V / np.maximum(known, 1e-300)) @ V.T + np.diag(np.where(np.isfinite(told), told, 0.0))
        return np.asarray(np.sqrt(np.maximum(np.diag(np.linalg.pinv(both, hermitian=True)), 0.0)) / size)

    def _outputs(self, d: Floats, *, command: bool) -> Floats:
        """Return the outputs of the loop to a disturbance, with or without the command, shape (n, ny)."""
        data, out = self.data, np.zeros_like(self.data.outputs)
        for s in data.segments:
            parts = (data.qr[s], data.vr[s], data.ar[s])
            qr, vr, ar = parts if command else (np.zeros(s.stop - s.start),) * 3
            out[s] = self.model.simulate(qr, d[s], vr=vr, ar=ar)
        return out


def axis_effects(plant: OpenLoop, axis: str, most: int = 60) -> AxisEffects | None:
    """Return what can be refined on an axis, shape (p,), or None; tables of over ``most`` columns stay as they are."""
    mine = [
        (key, effect, where)
        for key, effect, where in zip(plant.keys, plant.effects, plant.slices, strict=True)
        if effect.axis == axis
        and set(effect.causes) <= {"friction", "position"}
        and effect.refined_in_loop
        and 0 < len(effect.coefficients()) <= most
    ]
    if not mine:
        return None
    keys, effects, slices = zip(*mine, strict=True)
    where = [k for s in slices for k in range(s.start, s.stop)]
    lower = [c.lower for effect in effects for c in effect.coefficients()]
    return AxisEffects(
        axis=axis,
        keys=keys,
        effects=effects,
        where=tuple(where),
        theta=plant.theta[where],
        error=np.sqrt(np.maximum(np.diag(plant.covariance), 0.0))[where],
        lower=np.array(lower),
    )


def with_refined(plant: OpenLoop, refined: Iterable[AxisEffects]) -> OpenLoop:
    """Return a plant, and its table, with the effects that loops refined."""
    theta, effects = plant.theta.copy(), dict(zip(plant.keys, plant.effects, strict=True))
    rows = {row.name: row for row in plant.parameters}
    for axis in refined:
        theta[list(axis.where)] = axis.theta
        effects |= zip(axis.keys, axis.effects, strict=True)
        for name, value, error in axis.numbers():
            row = replace(rows[name], value=value, dof=np.inf)
            known = row.determined and bool(np.isfinite(error)) and error > 0.0
            word = verdict(value, error, at_bound=value == 0.0) if known else row.verdict
            rows[name] = replace(row, error=error if known else np.nan, determined=known, verdict=word)
    table = Parameters(rows.values())
    return replace(plant, effects=tuple(effects.values()), theta=theta, parameters=table)
