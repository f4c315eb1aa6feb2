"""What a run needs beside the kernel: where it starts, what drives it, and the log of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.signal import lfilter

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import MachineError, require
from pinotwin.trajectories.moves import Trajectory
from pinotwin.virtual import columns as c
from pinotwin.virtual.axis_truth import EffortSensor
from pinotwin.virtual.control import INTEGRAL, N_STATE, PREVIOUS
from pinotwin.virtual.kernel import position_effort
from pinotwin.virtual.rigid import Tree, empty_pose
from pinotwin.virtual.structs import Axes, Drive, Record, Room, State
from pinotwin.virtual.tree import gravity_at, links_of
from pinotwin.virtual.truth import Pulse, Truth


def decimation(control: float, rate: float, what: str) -> int:
    """Return the control periods a sample of a slower rate [Hz], which must divide the control rate."""
    every = round(control / rate)
    if every < 1 or abs(control / rate - every) > 1e-9:
        raise MachineError(f"{what} {rate} Hz does not divide the control rate {control} Hz")
    return every


def drive_of(
    truth: Truth,
    true: pin.Model,
    trajectory: Trajectory,
    loads: Sequence[Pulse],
    n: int,
    rng: np.random.Generator | None,
) -> Drive:
    """Return commands, noise and loads of ``n`` control periods; no noise without ``rng``."""
    t, specs = np.arange(n) / truth.control_rate, list(truth.axes.values())
    qr, vr, ar = trajectory.at(t, list(truth.axes))
    encoder, chatter = np.zeros((n, len(specs))), np.zeros((1, len(specs)))
    if rng is not None:
        encoder = rng.standard_normal((n, len(specs))) * [a.encoder.noise or 0.0 for a in specs]
        if any(a.friction.chatter > 0.0 for a in specs):
            chatter = rng.standard_normal((n, len(specs)))
    return Drive(qr, vr, ar, encoder, chatter, *load_arrays(true, loads, t + 0.5 / truth.control_rate))


def load_arrays(true: pin.Model, loads: Sequence[Pulse], t: Floats) -> tuple[Ints, Floats, Floats]:
    """Return bodies, points and world-axes loads at times ``t``: shapes (k,), (k, 3), (n, k, 6)."""
    links, names = links_of(true), sorted({p.link for p in loads})
    body = np.zeros(len(names), dtype=np.intp)
    point, load = np.zeros((len(names), 3)), np.zeros((len(t), len(names), 6))
    for k, link in enumerate(names):
        require(link, links, "external load: no link", MachineError)
        body[k], point[k] = links[link].parentJoint - 1, links[link].placement.translation
        for pulse in loads:
            if pulse.link == link:
                phase = np.clip((t - pulse.time) / pulse.duration, 0.0, 1.0)
                load[:, k] += np.outer(np.sin(np.pi * phase), [*pulse.force, *pulse.moment])
    return body, point, load


def equilibrium(true: pin.Model, axes: Axes, command: Floats) -> State:
    """Return the state at rest at a command (na,); friction is not loaded, springs and integral parts are."""
    nv, na, P, joint = true.nv, len(axes.joint), axes.P, axes.joint
    q = np.zeros(nv)
    q[joint] = command
    for _ in range(51 if len(axes.sprung) else 1):
        hold = gravity_at(true, q)
        q[axes.sprung] = -hold[axes.sprung] / axes.springs[:, c.STIFFNESS]
    u = hold[joint]
    for i in range(na):
        u[i] += position_effort(axes.ripple, axes.table, axes.grid, i, q[joint[i]], 0.0, 0.0)
    flexible, on_load = P[:, c.FLEXIBLE] > 0.5, P[:, c.LOAD_ENCODER] > 0.5
    twist = np.where(flexible, u / np.maximum(P[:, c.SPRING], 1e-300) + np.sign(u) * P[:, c.BACKLASH], 0.0)
    qm = q[joint] + np.where(on_load, twist, 0.0)
    q[joint] -= np.where(on_load, 0.0, twist)
    control = np.zeros((na, N_STATE))
    control[:, INTEGRAL] = u
    control[:, PREVIOUS] = np.where(P[:, c.PID] < 0.5, np.where(on_load, q[joint], qm), 0.0)
    return State(
        q=q,
        v=np.zeros(nv),
        a=np.zeros(nv),
        qm=qm,
        vm=np.zeros(na),
        z=np.zeros((na, c.N_STATES)),
        zs=np.zeros(len(axes.sprung)),
        u=u.copy(),
        f=np.zeros(na),
        control=control,
        queue=np.repeat(u[:, None], c.MAX_DELAY, axis=1),
        tick=np.zeros(1, dtype=np.intp),
    )


def empty_record(every: int, rows: int, na: int, nv: int) -> Record:
    """Return room for ``rows`` rows of a record."""
    return Record(every, *(np.zeros((rows, k)) for k in (na, na, na, nv, nv, nv)))


def empty_room(tree: Tree) -> Room:
    """Return scratch arrays for a tree."""
    nv = len(tree.mass)
    shapes = {"M": (nv, nv), "inverse": (nv, nv), "extra": (2, nv)}
    return Room(empty_pose(tree), *(np.zeros(shapes.get(name, (nv,))) for name in Room._fields[1:]))


def log_of(
    truth: Truth, drive: Drive, record: Record, t: Floats, every: int, rng: np.random.Generator | None
) -> dict[str, Floats]:
    """Return the channels that a controller logs at times ``t``, every so many control periods."""
    rows = slice(None, None, every // record.every)
    log: dict[str, Floats] = {"t": t}
    for i, (name, axis) in enumerate(truth.axes.items()):
        log[f"{name}.qr"] = drive.qr[::every, i]
        log[f"{name}.q"] = record.reading[rows, i]
        log[f"{name}.u"] = measured_effort(t, record.effort[rows, i], axis.effort, truth.log_rate, rng)
    return log


def load_channels(true: pin.Model, loads: Sequence[Pulse], t: Floats) -> dict[str, Floats]:
    """Return the channels of the links of which a load is logged."""
    logged = {p.link for p in loads if p.logged}
    load = load_arrays(true, [p for p in loads if p.link in logged], t)[2]
    parts = ("fx", "fy", "fz", "mx", "my", "mz")
    return {f"{n}.{x}": load[:, k, m] for k, n in enumerate(sorted(logged)) for m, x in enumerate(parts)}


def measured_effort(
    t: Floats, u: Floats, sensor: EffortSensor, rate: float, rng: np.random.Generator | None
) -> Floats:
    """Return the effort as logged at ``rate`` [Hz], shape (n,); without ``rng`` no noise and no quantisation."""
    out = sensor.scale * (np.interp(t - sensor.lag, t, u) if sensor.lag else u)
    if rng is None:
        return np.array(out)
    out = out + rng.normal(0.0, sensor.white or 0.0, len(t))
    # First-order low-passed noise that is stationary from its first sample.
    phi, rms = np.exp(-2.0 * np.pi * sensor.corner / rate), sensor.coloured or 0.0
    shocks = rng.normal(0.0, rms * np.sqrt(1.0 - phi * phi), len(t))
    shocks[:1] = rng.normal(0.0, rms, len(t[:1]))
    out = out + np.asarray(lfilter([1.0], [1.0, -phi], shocks))
    step = sensor.resolution or 0.0
    return step * np.round(out / step) if step > 0.0 else out
