"""What coupling between axes is worth: one model of the machine against one per axis (Fig. 3-7).

The decoupled model is the same machine, each axis on its own: its inertia and its gravity as if
the other axes stood still where they are on average, and its own effects. It has no term in which
another axis' motion appears. Shapes are those of the coupled fit in both, so that nothing else
differs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from pinotwin.arrays import Floats
from pinotwin.effects import AxisEffect, Effect
from pinotwin.identification.assemble import assemble, choose_rows, joint_columns, thin
from pinotwin.identification.judge import error_row
from pinotwin.identification.plant import fit_options, fit_plant
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.solve.crossval import held_out
from pinotwin.solve.linear import Options
from pinotwin.solve.problem import Problem


@dataclass(frozen=True, eq=False)
class AxisComparison:
    """Both models on one axis; arrays of shape (m,).

    Attributes:
        axis: its name.
        rotary: rad and N·m, else m and N.
        t: time of each row [s].
        u: measured effort [N or N·m].
        coupled: effort that the coupled model expects, from folds that did not see the row.
        decoupled: the same of the decoupled model.
    """

    axis: str
    rotary: bool
    t: Floats
    u: Floats
    coupled: Floats
    decoupled: Floats

    @property
    def coupled_error(self) -> dict[str, float]:
        """``rms``, ``nrmse`` and ``nrmse_std`` of the coupled model on held-out data."""
        return error_row(self.u, self.u - self.coupled)

    @property
    def decoupled_error(self) -> dict[str, float]:
        """The same of the decoupled model."""
        return error_row(self.u, self.u - self.decoupled)


@dataclass(frozen=True, eq=False)
class CoupledAgainstDecoupled:
    """Both models on every axis, judged on held-out stretches of the log.

    Attributes:
        axes: the comparison, by axis name.
    """

    axes: dict[str, AxisComparison]

    @property
    def gain(self) -> dict[str, float]:
        """Held-out error of the decoupled model divided by that of the coupled one, per axis."""
        return {
            name: row.decoupled_error["rms"] / max(row.coupled_error["rms"], 1e-300)
            for name, row in self.axes.items()
        }


def coupled_against_decoupled(
    machine: Machine,
    log: Log | Sequence[Log],
    *,
    decimate: int | None = None,
) -> CoupledAgainstDecoupled:
    """Fit a machine with and without the coupling between its axes; compare on held-out data.

    Args:
        machine: what is believed.
        log: servo log(s).
        decimate: see :func:`pinotwin.prepare`.

    Raises:
        DataError: the log holds too little.
    """
    motion = prepare(machine, log, decimate=decimate)
    plant = fit_plant(machine, motion)
    coupled = assemble(motion, plant.effects, plant.rows)
    decoupled, bounds = decoupled_problem(machine, motion, plant.effects)
    first = held_out(coupled, options=fit_options(machine, plant.effects)).error
    second = held_out(decoupled, options=bounds).error
    t = thin_time(motion)
    axes = {}
    for joint, rows in coupled.slices.items():
        y, kept = coupled.y[rows], plant.rows.kept[plant.rows.joints.index(joint)]
        name = machine.names[joint]
        axes[name] = AxisComparison(
            name, machine.rotary[joint], t[kept], y, y - first[rows], y - second[rows]
        )
    return CoupledAgainstDecoupled(axes)


def thin_time(motion: Motion) -> Floats:
    """Return the time of the decimated rows [s], shape (m,)."""
    return motion.t[choose_rows(motion).sample]


def decoupled_problem(machine: Machine, motion: Motion, effects: Sequence[Effect]) -> tuple[Problem, Options]:
    """Return the problem of all axes without coupling, and its bounds.

    Args:
        machine: whose tree it is.
        motion: prepared log.
        effects: the effects, shapes fixed; those that act on two axes are left out.
    """
    rows = choose_rows(motion)
    blocks, names, lower, upper = [], [], [], []
    for joint, kept in zip(rows.joints, rows.kept, strict=True):
        own = [e for e in effects if isinstance(e, AxisEffect) and e.axis == motion.names[joint]]
        columns = [_alone(machine, motion, joint)]
        columns += [c for e in own if (c := joint_columns(motion, e, joint)) is not None]
        blocks.append(np.concatenate(columns, axis=1)[kept])
        beta = columns[0].shape[1]
        given = [c for e in own for c in e.coefficients()]
        lower += [-np.inf] * beta + [c.lower for c in given]
        upper += [np.inf] * beta + [c.upper for c in given]
        names += [f"{motion.names[joint]}:{k}" for k in range(beta + len(given))]
    like = assemble(motion, effects, rows)
    wide = np.zeros((len(like.y), len(names)))
    at = 0
    for joint, block in zip(rows.joints, blocks, strict=True):
        wide[rows.slice_of(joint), at : at + block.shape[1]] = block
        at += block.shape[1]
    return like.with_columns(wide, names), Options(lower=np.array(lower), upper=np.array(upper))


def _alone(machine: Machine, motion: Motion, joint: int) -> Floats:
    """Return the tree's independent columns at one joint, all others standing at their median."""
    q = np.broadcast_to(np.median(motion.q, axis=0), motion.q.shape).copy()
    v, a = np.zeros_like(q), np.zeros_like(q)
    for still, moving in ((q, motion.q), (v, motion.v), (a, motion.a)):
        still[:, joint] = moving[:, joint]
    out = np.empty((len(q), len(machine.base)))
    for start in range(0, len(q), 20_000):
        rows = slice(start, start + 20_000)
        values = machine.base.regressor(machine.model, q[rows], v[rows], a[rows])
        out[rows] = values[:, joint]
    some = out[:: max(len(out) // 2000, 1)]
    _, R, pivot = qr(some / _unit(some), mode="economic", pivoting=True)
    size = np.abs(np.diag(R))
    kept = np.sort(pivot[: len(size)][size > 1e-8 * size.max(initial=1e-300)])
    return thin(motion, out[:, kept])


def _unit(columns: Floats) -> Floats:
    """Return the columns' lengths; those of rounding size count as one, so that they stay small."""
    length = np.linalg.norm(columns, axis=0)
    return np.where(length > 1e-12 * length.max(initial=1e-300), length, 1.0 + length.max(initial=0.0))
