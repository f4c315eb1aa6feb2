"""One run: initial equilibrium, command and noise arrays, the kernel, the log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import DataError, MachineError, nearest
from pinotwin.virtual import columns as c
from pinotwin.virtual.control import INTEGRAL, N_STATE, PREVIOUS
from pinotwin.virtual.kernel import position_effort, run
from pinotwin.virtual.mass import gravity_at
from pinotwin.virtual.parameters import Timing
from pinotwin.virtual.recording import Recording, SealedTruth
from pinotwin.virtual.rigid import Tree, empty_pose
from pinotwin.virtual.sensors import measured_effort
from pinotwin.virtual.structs import Axes, Drive, Record, Room, State
from pinotwin.virtual.trajectories import Trajectory
from pinotwin.virtual.truth import Pulse, Truth

_COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")


class Runnable(Protocol):
    """What a run asks of a virtual machine; see :class:`pinotwin.virtual.machine.VirtualMachine`."""

    @property
    def name(self) -> str:
        """Name of the machine."""

    @property
    def truth(self) -> Truth:
        """The sealed truth."""

    @property
    def tree(self) -> Tree:
        """The bodies as they are."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all joints."""

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the driven ones."""

    @property
    def links(self) -> Mapping[str, tuple[int, Floats, Floats]]:
        """Link -> joint, place and orientation of its frame."""

    @property
    def timing(self) -> Timing:
        """Sampling of the controller."""

    def tables(self, truth: Truth | None = None) -> Axes:
        """Return the kernel's tables."""

    def scattered(self, rng: np.random.Generator) -> Truth:
        """Return the truth with this run's friction."""


def record_run(
    machine: Runnable,
    trajectory: Trajectory,
    seed: int,
    noise: bool,
    loads: Sequence[Pulse],
    truth_rate: float | None,
) -> Recording:
    """Run the machine once; see :meth:`VirtualMachine.record`."""
    truth = machine.truth
    rng = np.random.default_rng([truth.seed, 1000, seed])
    run_truth = machine.scattered(rng) if noise else truth
    axes = machine.tables(run_truth)
    if not noise:
        axes.P[:, c.RESOLUTION] = 0.0
    every = _decimation(truth.control_rate, truth.log_rate, "log rate")
    fine = _decimation(truth.control_rate, truth_rate or truth.log_rate, "truth rate")
    step = int(np.gcd(every, fine))
    n = round(trajectory.seconds * truth.control_rate / every) * every
    if n < every:
        raise DataError(f"{machine.name}: a trajectory of {trajectory.seconds} s is too short")
    drive = _drive(machine, trajectory, loads, n, rng if noise else None)
    state = equilibrium(machine, axes, drive)
    record = empty_record(step, n // step, len(machine.axes), len(machine.joints))
    timing = (machine.timing.period, machine.timing.updates, machine.timing.substeps)
    run(machine.tree, axes, drive, state, empty_room(len(machine.joints)), record, timing)
    if not np.all(np.isfinite(record.q)):
        raise MachineError(f"{machine.name}: the simulation diverged; lower the loop gains")
    log = _log(machine, run_truth, drive, record, every, loads, rng if noise else None)
    return Recording(machine.name, log, _sealed(machine, record, fine), seed)


def _decimation(control: float, rate: float, what: str) -> int:
    every = round(control / rate)
    if every < 1 or abs(control / rate - every) > 1e-9:
        raise MachineError(f"{what} {rate} Hz does not divide the control rate {control} Hz")
    return every


def _drive(
    machine: Runnable,
    trajectory: Trajectory,
    loads: Sequence[Pulse],
    n: int,
    rng: np.random.Generator | None,
) -> Drive:
    t = np.arange(n) / machine.truth.control_rate
    qr, vr, ar = trajectory.at(t, machine.axes)
    na = len(machine.axes)
    encoder, chatter = np.zeros((n, na)), np.zeros((1, na))
    if rng is not None:
        specs = [machine.truth.axes[name] for name in machine.axes]
        encoder = rng.standard_normal((n, na)) * [a.encoder.noise or 0.0 for a in specs]
        if any(a.friction.chatter > 0.0 for a in specs):
            chatter = rng.standard_normal((n, na))
    body, point, load = load_arrays(machine, loads, t + 0.5 / machine.truth.control_rate)
    return Drive(qr, vr, ar, encoder, chatter, body, point, load)


def load_arrays(machine: Runnable, loads: Sequence[Pulse], t: Floats) -> tuple[np.ndarray, Floats, Floats]:
    """Return bodies, points and world-axes loads at times ``t``: shapes (k,), (k, 3), (n, k, 6)."""
    links = sorted({p.link for p in loads})
    body = np.zeros(len(links), dtype=np.intp)
    point, load = np.zeros((len(links), 3)), np.zeros((len(t), len(links), 6))
    for k, link in enumerate(links):
        if link not in machine.links:
            raise MachineError(f"external load: no link {link!r}; {nearest(link, machine.links)}")
        body[k], _, point[k] = machine.links[link]
        for pulse in loads:
            if pulse.link == link:
                phase = np.clip((t - pulse.time) / pulse.duration, 0.0, 1.0)
                load[:, k] += np.outer(np.sin(np.pi * phase), [*pulse.force, *pulse.moment])
    return body, point, load


def equilibrium(machine: Runnable, axes: Axes, drive: Drive) -> State:
    """Return the state at rest at the first command, springs and integral parts loaded.

    The motors hold gravity, ripple and tables; friction is not loaded. (Motors that held gravity alone
    would let the axes jump into their bristles at the first instant.)
    """
    nv, na = len(machine.joints), len(machine.axes)
    q = np.zeros(nv)
    q[axes.joint] = drive.qr[0]
    stiffness = axes.springs[:, c.STIFFNESS]
    hold = gravity_at(machine.tree, q)
    for _ in range(50):
        q[axes.sprung] = -hold[axes.sprung] / stiffness if len(stiffness) else 0.0
        hold = gravity_at(machine.tree, q)
    u = hold[axes.joint]
    for i in range(na):
        u[i] += position_effort(axes.ripple, axes.table, axes.grid, i, q[axes.joint[i]], 0.0, 0.0)
    qm = q[axes.joint].copy()
    for i in range(na):
        P = axes.P[i]
        if P[c.FLEXIBLE] > 0.5:
            twist = u[i] / P[c.SPRING] + np.sign(u[i]) * P[c.BACKLASH]
            if P[c.LOAD_ENCODER] > 0.5:
                qm[i] += twist
            else:
                q[axes.joint[i]] -= twist
    control = np.zeros((na, N_STATE))
    control[:, INTEGRAL] = u
    for i in range(na):
        if axes.P[i, c.PID] < 0.5:
            reading = q[axes.joint[i]] if axes.P[i, c.LOAD_ENCODER] > 0.5 else qm[i]
            control[i, PREVIOUS] = reading
    z = np.zeros
    queue = np.repeat(u[:, None], c.MAX_DELAY, axis=1)
    return State(
        q,
        z(nv),
        z(nv),
        qm,
        z(na),
        z((na, c.N_STATES)),
        z(len(axes.sprung)),
        u.copy(),
        z(na),
        control,
        queue,
        np.zeros(1, dtype=np.intp),
    )


def empty_record(every: int, rows: int, na: int, nv: int) -> Record:
    """Return room for ``rows`` rows of a record."""
    a, v = (rows, na), (rows, nv)
    z = np.zeros
    return Record(every, z(a), z(a), z(a), z(v), z(v), z(v))


def empty_room(nv: int) -> Room:
    """Return scratch arrays for a tree of ``nv`` joints."""
    z = np.zeros
    m = (nv, nv)
    return Room(empty_pose(nv), z(m), z(m), z(nv), z(nv), z(nv), z(nv), z(nv), z((2, nv)), z(nv))


def _log(
    machine: Runnable,
    truth: Truth,
    drive: Drive,
    record: Record,
    every: int,
    loads: Sequence[Pulse],
    rng: np.random.Generator | None,
) -> dict[str, Floats]:
    rate = truth.log_rate
    rows = slice(None, None, every // record.every)
    t_fine = np.arange(len(record.q)) * record.every / truth.control_rate
    log: dict[str, Floats] = {"t": t_fine[rows]}
    for i, name in enumerate(machine.axes):
        log[f"{name}.qr"] = drive.qr[::every, i]
        log[f"{name}.q"] = record.reading[rows, i]
        effort = truth.axes[name].effort
        log[f"{name}.u"] = measured_effort(log["t"], record.effort[rows, i], effort, rate, rng)
    _, _, load = load_arrays(machine, loads, log["t"])
    for k, link in enumerate(sorted({p.link for p in loads})):
        if any(p.logged for p in loads if p.link == link):
            log |= {f"{link}.{x}": load[:, k, m] for m, x in enumerate(_COMPONENTS)}
    return log


def _sealed(machine: Runnable, record: Record, fine: int) -> SealedTruth:
    rows = slice(None, None, fine // record.every)
    q = record.q[rows]
    links: Mapping[str, tuple[int, Floats, Floats]] = machine.links
    return SealedTruth(
        t=np.arange(len(q)) * fine / machine.truth.control_rate,
        joints=machine.joints,
        q=q,
        v=record.v[rows],
        a=record.a[rows],
        axes=machine.axes,
        u=record.effort[rows],
        friction=record.friction[rows],
        tree=machine.tree,
        links=links,
    )
