"""A log beside the twin's prediction of it, through the same filter and decimation as the rows of the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.errors import DataError, require
from pinotwin.identification.assemble import choose_rows, thin
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.motion import Motion
from pinotwin.twin import Twin


@dataclass(frozen=True, eq=False)
class Evidence:
    """Measured and predicted effort at the rows of the fit; arrays of shape (m, nv), SI."""

    names: tuple[str, ...]  # joint of every column
    rotary: tuple[bool, ...]  # whether each column is a rotation
    measured: tuple[int, ...]  # columns that have a measured effort
    t: Floats  # time from the first row on, running on from log to log [s], shape (m,)
    block: Ints  # number of the unbroken stretch of each row, shape (m,)
    q: Floats  # position; likewise velocity ``v`` and acceleration ``a``
    v: Floats
    a: Floats
    u: Floats  # measured effort [N or N·m]
    parts: Mapping[str, Floats]  # effort of every effect, by its key in the twin
    use: Mask  # rows that the fit uses, shape (m, nv)
    rate: float  # rows per second [Hz]
    source: str  # where the log came from

    @cached_property
    def predicted(self) -> Floats:
        """Effort that the twin expects, shape (m, nv)."""
        return np.sum(list(self.parts.values()), axis=0)

    @cached_property
    def residual(self) -> Floats:
        """Measured minus predicted effort, shape (m, nv)."""
        return self.u - self.predicted

    def without(self, keys: Sequence[str]) -> Floats:
        """Return the measured effort minus every effect but those of ``keys``, shape (m, nv)."""
        kept = [self.parts[key] for key in keys]
        return self.residual + np.sum(kept, axis=0)

    def index(self, axis: str) -> int:
        """Return the column of a measured axis; DataError if there is none, or it has no effort."""
        known = [self.names[j] for j in self.measured]
        require(axis, known, f"{self.source}: no measured effort of axis", DataError)
        return self.names.index(axis)


def evidence(twin: Twin, given: Log | Sequence[Log] | Motion) -> Evidence:
    """Return log(s), or a motion, beside the twin's prediction; LogError for channels, DataError for no usable row."""
    motion = given if isinstance(given, Motion) else prepare(twin.machine, given, **twin.settings)
    rows = choose_rows(motion)
    pick, step = rows.sample, motion.decimation
    u = thin(motion, np.nan_to_num(motion.u))
    u[:, [j for j in range(u.shape[1]) if j not in rows.joints]] = np.nan
    parts = {key: thin(motion, part) for key, part in twin.parts(motion).items()}
    if motion.external is not None:
        parts["external_force"] = -thin(motion, motion.external)
    return Evidence(
        names=motion.names,
        rotary=motion.rotary,
        measured=rows.joints,
        t=_running(motion.t[pick], rows.block, motion.step * step),
        block=rows.block,
        q=motion.q[pick],
        v=motion.v[pick],
        a=motion.a[pick],
        u=u,
        parts=parts,
        use=motion.use[pick],
        rate=1.0 / (motion.step * step),
        source=motion.source,
    )


def _running(t: Floats, block: Ints, step: float) -> Floats:
    """Return a time that starts at zero and never jumps back where one log follows another."""
    out = t - t[0]
    for k in np.flatnonzero(np.diff(block)) + 1:
        if out[k] <= out[k - 1]:
            out[k:] += out[k - 1] - out[k] + step
    return out


def split_rigid_body(twin: Twin, given: Evidence) -> Evidence:
    """Return the evidence with ``rigid_body`` as own ``inertia``, ``gravity``, and ``coupling`` with all velocities."""
    q, v, a = given.q, given.v, given.a
    zero = np.zeros_like(q)
    gravity = twin.rigid_effort(q, zero, zero)
    coupling = twin.rigid_effort(q, v, a) - gravity
    for j in range(q.shape[1]):
        alone = zero.copy()
        alone[:, j] = a[:, j]
        coupling[:, j] -= twin.rigid_effort(q, zero, alone)[:, j] - gravity[:, j]
    rest = {key: part for key, part in given.parts.items() if key != "rigid_body"}
    inertia = given.parts["rigid_body"] - gravity - coupling
    return replace(given, parts={"inertia": inertia, "gravity": gravity, "coupling": coupling, **rest})
