"""What coupling between axes is worth: one model of the machine against one per axis (Fig. 3-7).

The latter has inertia and gravity as if the others stood still where they are on average, its own effects at the shapes
of the coupled fit, and no term of another axis' motion.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import block_diag, csr_array

from pinotwin.arrays import Floats
from pinotwin.effects import AxisEffect, Effect
from pinotwin.errors import DataError
from pinotwin.identification.assemble import assemble, choose_rows, thin
from pinotwin.identification.judge import error_row
from pinotwin.identification.plant import fit_options, fit_plant
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.solve.crossval import held_out
from pinotwin.solve.linear import Options
from pinotwin.solve.problem import Problem
from pinotwin.studies.study import Study
from pinotwin.system.phrases import STUDIED, joined

HEADER = ("axis", *(f"{x}, held out{of}" for of in ("", ", of std") for x in ("coupled", "decoupled")))


def coupled_against_decoupled(
    machine: Machine, log: Log | Sequence[Log], *, axes: Sequence[str] = ()
) -> Study:
    """Fit a machine with and without the coupling between its axes; DataError where the log holds too little.

    A row of the table has an axis' held-out errors of both models, over the RMS of its effort and over its standard
    deviation. The courses are of the axis that needs coupling most, (m,): ``t``, the measured effort ``u``, and what
    the ``coupled`` and the ``decoupled`` model expect of rows that they did not see.
    """
    motion = prepare(machine, log)
    plant = fit_plant(machine, motion)
    coupled = assemble(motion, plant.effects, plant.rows)
    decoupled, bounds = decoupled_problem(machine, motion, plant.effects)
    first = held_out(coupled, options=fit_options(machine, plant.effects)).error
    second = held_out(decoupled, options=bounds).error
    rows, courses = [], {}
    for joint, where in coupled.slices.items():
        name, y = machine.names[joint], coupled.y[where]
        if axes and name not in axes:
            continue
        one, other = error_row(y, first[where]), error_row(y, second[where])
        rows.append((name, one["nrmse"], other["nrmse"], one["nrmse_std"], other["nrmse_std"]))
        t = motion.t[plant.rows.sample][plant.rows.kept[plant.rows.joints.index(joint)]]
        courses[name] = {"t": t, "u": y, "coupled": y - first[where], "decoupled": y - second[where]}
    if not rows:
        raise DataError(f"{motion.source}: no measured effort of {', '.join(axes)}")
    ratio, axis = max((row[2] / max(row[1], 1e-300), row[0]) for row in rows)
    lost = [str(row[0]) for row in rows if row[4] > 1.0]
    finding = STUDIED["runaway" if lost else "coupling"].format(
        ratio=ratio, axis=axis, axes=joined(lost or [axis])
    )
    rotary = machine.rotary[machine.names.index(axis)]
    return Study(finding, HEADER, rows, courses[axis], axis, rotary)


def decoupled_problem(machine: Machine, motion: Motion, effects: Sequence[Effect]) -> tuple[Problem, Options]:
    """Return the problem of all axes without coupling, and its bounds; effects that act on two axes are left out."""
    rows = choose_rows(motion)
    blocks, names, lower, upper = [], [], [], []
    for joint, kept in zip(rows.joints, rows.kept, strict=True):
        own = [e for e in effects if isinstance(e, AxisEffect) and e.axis == motion.names[joint]]
        columns = [_alone(machine, motion, joint)]
        columns += [thin(motion, e.columns(motion).values[:, 0]) for e in own]
        blocks.append(np.concatenate(columns, axis=1)[kept])
        beta = columns[0].shape[1]
        given = [c for e in own for c in e.coefficients()]
        lower += [-np.inf] * beta + [c.lower for c in given]
        upper += [np.inf] * beta + [c.upper for c in given]
        names += [f"{motion.names[joint]}:{k}" for k in range(beta + len(given))]
    like = assemble(motion, effects, rows)
    bounds = Options(lower=np.array(lower), upper=np.array(upper))
    return like.with_columns(csr_array(block_diag(blocks)), names), bounds


def _alone(machine: Machine, motion: Motion, joint: int) -> Floats:
    """Return the tree's columns that are not zero at one joint, all others standing at their median."""
    q = np.broadcast_to(np.median(motion.q, axis=0), motion.q.shape).copy()
    v, a = np.zeros_like(q), np.zeros_like(q)
    for still, moving in ((q, motion.q), (v, motion.v), (a, motion.a)):
        still[:, joint] = moving[:, joint]
    parts = (slice(start, start + 20_000) for start in range(0, len(q), 20_000))
    base, model = machine.base, machine.model
    out = np.concatenate([base.regressor(model, q[s], v[s], a[s])[:, joint] for s in parts])
    return thin(motion, out[:, out.any(axis=0)])
