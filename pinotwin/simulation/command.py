"""The command of a log (``qr`` and external loads alone: nothing measured), checked, in joints, and the way back."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from pinotwin.arrays import Floats, Mask
from pinotwin.columns import LOAD_SIGNALS, bind
from pinotwin.dynamics.frames import external_effort
from pinotwin.errors import DataError, LogError, nearest, some
from pinotwin.log import Log
from pinotwin.logs.channels import joint_positions, loads
from pinotwin.loop import command_rates
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.signals import segments

FEWEST = 8  # Rows below which there is nothing to simulate


@dataclass(frozen=True)
class Request:
    """What a log asks of a machine; n rows on an even clock."""

    t: Floats  # time stamps of the log [s], shape (m,)
    clock: Floats  # the even clock, shape (n,); the log's own rows where that is even already
    step: float  # its interval [s]
    qr: Floats  # joint command [m or rad], shape (n, nv); zero for passive joints
    vr: Floats  # its velocity, by cubic spline, shape (n, nv)
    external: Floats  # joint effort of external loads [N or N·m], shape (n, nv), or (1, nv) zeros
    even: bool  # whether the log's own clock is the even one
    source: str  # where the log came from
    notes: tuple[str, ...]  # what was done to it
    every: int = 1  # rows of the even clock a row of the log

    def at_stamps(self, x: Floats) -> Floats:
        """Return a result of shape (n, ...) at the time stamps of the log, shape (m, ...)."""
        rows = x[:: self.every]
        if self.even:
            return rows
        return np.asarray(scipy.interpolate.CubicSpline(self.clock[:: self.every], rows)(self.t), dtype=float)

    def refined(self, every: int) -> Request:
        """Return the same command with ``every`` rows in place of one."""
        if every == 1:
            return self
        n = len(self.clock)
        fine = np.linspace(self.clock[0], self.clock[-1], (n - 1) * every + 1)
        cubic = scipy.interpolate.CubicHermiteSpline(self.clock, self.qr, self.vr)
        external = self.external
        if len(external) > 1:
            external = np.stack([np.interp(fine, self.clock, x) for x in external.T], axis=1)
        return replace(
            self,
            clock=fine,
            step=self.step / every,
            qr=np.asarray(cubic(fine), dtype=float),
            vr=np.asarray(cubic(fine, 1), dtype=float),
            external=external,
            every=self.every * every,
        )


def request(machine: Machine, log: Log | Motion) -> Request:
    """Return the command of a log, or a motion of one stretch; LogError for gaps, DataError for none or two clocks."""
    if isinstance(log, Motion):
        return _of_motion(log)
    held, needed = log.channels, ("t", "qr", *LOAD_SIGNALS)
    measured = {k for k in machine.columns if k.rsplit(".", 1)[-1] not in needed}
    log = bind(log, machine.columns, optional=measured)  # what was measured need not be in the log
    _require(machine, log, held)
    t = np.asarray(log.t, dtype=float)
    even, clock, notes = _clock(log)
    q = joint_positions(machine, log, "qr")
    if not even:
        q = np.asarray(scipy.interpolate.CubicSpline(t, q)(clock), dtype=float)
    step = float(clock[-1] - clock[0]) / (len(clock) - 1)
    vr = np.stack([command_rates(x, step)[0] for x in q.T], axis=1)
    external = _external(machine, log, t, clock, q)
    q, vr = np.ascontiguousarray(q), np.ascontiguousarray(vr)  # else the kernel is compiled again
    return Request(t, clock, step, q, vr, external, even, log.source, notes)


def _of_motion(motion: Motion) -> Request:
    """Return the command of a motion, as smooth as it was made."""
    source = motion.source or "motion"
    if motion.qr is None or motion.vr is None or len(motion) < FEWEST:
        raise DataError(f"{source}: this motion has no command; prepare it from a log with <axis>.qr")
    if len(segments(motion.t)) != 1:
        raise DataError(f"{source}: this motion is of several stretches; take one: motion.cut(start, stop)")
    clock = np.linspace(motion.t[0], motion.t[-1], len(motion))
    qr, vr = np.ascontiguousarray(motion.qr), np.ascontiguousarray(motion.vr)
    external = np.zeros((1, qr.shape[1])) if motion.external is None else motion.external
    return Request(motion.t, clock, motion.step, qr, vr, external, True, source, ())


def motor_coordinates(machine: Machine, q: Floats, e: Floats, u: Floats) -> tuple[Floats, Floats, Floats]:
    """Return joint position, error and effort as the log counts them: zero shifts, transmission."""
    zero = np.zeros(machine.nv)
    for axis in machine.axes.values():
        zero[axis.index] = axis.zero
    q = q - zero
    if machine.transmission is None:
        return q, e, u
    N = machine.transmission
    effort: Floats = np.linalg.solve(N.T, u.T).T.astype(float)
    return q @ N.T, e @ N.T, effort


def _require(machine: Machine, log: Log, held: Iterable[str]) -> None:
    """Refuse a log without time or commands, or with holes in them."""
    if "t" not in log:
        raise LogError(f"{log.source}: no time channel t; name its column in machine.yaml")
    names = [f"{name}.qr" for name in machine.axes]
    missing = [name for name in names if name not in log]
    if missing:
        taken = {"t", *(f"{axis}.{kind}" for axis in machine.axes for kind in ("q", "qr", "v", "u", "e"))}
        taken |= {str(column.column) for key, column in machine.columns.items() if not key.endswith(".qr")}
        free = [channel for channel in held if channel not in taken]  # not known to be something else
        hint = nearest(missing[0], free) if free else "none of its columns is left for it"
        raise LogError(
            f"{log.source}: no channel {some(missing, 2)}; a simulation needs the command of every "
            f"axis: record it too, or name its column under `columns` in machine.yaml; {hint}"
        )
    if len(log) < FEWEST:
        raise DataError(f"{log.source}: {len(log)} rows, at least {FEWEST} are needed to simulate")
    for name in ("t", *names):
        bad = np.flatnonzero(~np.isfinite(log[name]))
        if len(bad):
            rows = some([str(k + 1) for k in bad], 5)
            raise LogError(
                f"{log.source}: channel {name} is not a number in row {rows}; a command must have "
                "no holes: cut the log there"
            )
    late = np.flatnonzero(np.diff(log.t) < 0.0)
    if len(late):
        raise LogError(f"{log.source}: time runs backward at row {late[0] + 2}; sort the log by t")


def _clock(log: Log) -> tuple[bool, Floats, tuple[str, ...]]:
    """Return whether the log is evenly sampled, an even clock, and notes."""
    t = log.t
    if len(segments(t)) == 1:
        return True, np.linspace(t[0], t[-1], len(t)), ()
    gaps = np.diff(t)
    if np.any(gaps == 0.0):
        row = int(np.flatnonzero(gaps == 0.0)[0]) + 2
        raise LogError(f"{log.source}: time stands still at row {row}; give every row its own time")
    step = float(np.median(gaps))
    count = round((t[-1] - t[0]) / step) + 1
    note = (
        f"time stamps are uneven (longest interval {gaps.max():.4g} s, usual {step:.4g} s): the command "
        "was interpolated by a cubic spline onto an even clock"
    )
    return False, np.linspace(t[0], t[-1], count), (note,)


def _external(machine: Machine, log: Log, t: Floats, clock: Floats, q: Floats, block: int = 50000) -> Floats:
    """Return J(q)^T f of the logged loads, at the commanded posture: the tracking error hardly turns J."""
    wrenches = loads(machine, log)
    total = np.zeros((len(q) if wrenches else 1, machine.nv))
    for link, logged in wrenches.items():
        wrench = np.stack([np.interp(clock, t, values) for values in logged.T], axis=1)
        acts: Mask = np.any(wrench != 0.0, axis=1)
        for start in range(0, len(q), block):
            rows = start + np.flatnonzero(acts[start : start + block])
            if len(rows):
                total[rows] += external_effort(machine.model, link, q[rows], wrench[rows])
    return total


def beginning(
    qr: Floats, vr: Floats, step: float, rows: int = 10, jump: float = 10.0, stands: float = 1e-3
) -> tuple[Floats, Floats]:
    """Return position and velocity of the two rows that a machine begins with, shape (2, nv) each.

    They are those of the command (n, nv), unless it cannot have come in so: an axis that stands (slower than the share
    ``stands`` of its top speed) has no acceleration yet, and one whose command begins with a step (``jump`` times the
    acceleration of the next ``rows``) had the velocity of the rows after it, or an integral would be wound up for it.
    """
    h, qr = step, qr[: rows + 1]
    first = (6.0 * (qr[1] - qr[0]) / h - 4.0 * vr[0] - 2.0 * vr[1]) / h
    slopes = np.diff(qr, axis=0)[1:] / h
    later = np.diff(slopes, axis=0) / h
    steps = np.abs(first) > jump * np.abs(later).max(axis=0)
    v = np.where(steps, np.median(slopes, axis=0), vr[0])
    a = np.where(steps, np.median(later, axis=0), first)
    still = np.abs(v) <= stands * np.abs(vr).max(axis=0)
    v, a = np.where(still, 0.0, v), np.where(still, 0.0, a)
    return np.stack([qr[0], qr[0] + h * v + 0.5 * h * h * a]), np.stack([v, v + h * a])
