"""The true closed loop, linearised: what an identification of poles must find.

The sampled machine itself (controller, filter, current loop, plant; friction only viscous, no
ripple) is run over one control period from states that differ by a little; the eigenvalues ``z``
of that map give ``s = ln(z) / T``. Nothing is written down twice, so nothing can disagree with
the simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.errors import InputError
from pinotwin.virtual import columns as c
from pinotwin.virtual.control import N_STATE
from pinotwin.virtual.kernel import run
from pinotwin.virtual.machine import VirtualMachine
from pinotwin.virtual.run import empty_record, empty_room, equilibrium
from pinotwin.virtual.structs import Axes, Drive, State
from pinotwin.virtual.tree import tree_of

# Perturbations: positions, velocities, efforts are scaled by the machine's own sizes below.
_STEP = 1e-4


def closed_loop_poles(
    machine: VirtualMachine,
    axes: Sequence[str] | None = None,
    *,
    q: Floats | None = None,
    passive: bool = True,
) -> np.ndarray:
    """Return the poles of the true closed loop [rad/s], slowest first, complex.

    Args:
        machine: whose loop.
        axes: axes that move under their controllers; the others are locked. All by default.
        q: posture: command of every axis, shape (na,); the middle of the travels by default.
        passive: whether passive joints move, or are locked as well.
    """
    names = list(machine.axes) if axes is None else list(axes)
    tables = smooth(machine.tables())
    if np.any(tables.P[:, c.DELAY] > 0.0):
        raise InputError(f"{machine.name}: no poles for a loop that is late by whole periods")
    home = machine.layout.home[tables.joint] if q is None else np.asarray(q, dtype=float)
    free = _free(machine, names, passive)
    true = _locked(machine, {index for name, index in free if name == "q"})
    A = _transition(replace(machine, true=true), tables, home, free)
    z = np.linalg.eigvals(A)
    z = z[np.abs(z) > 1e-6]  # the reading of the last period is remembered but not a mode
    s = np.log(z.astype(complex)) / machine.timing.period
    return s[np.argsort(np.abs(s))]


def smooth(tables: Axes) -> Axes:
    """Return the tables without what has no linear part: sticking, ripple, tables, quantisation."""
    P = tables.P.copy()
    P[:, [c.RESOLUTION, c.ERROR, c.QUADRATIC, c.BACKLASH, c.DRAG]] = 0.0
    P[:, c.LAW] = c.NONE
    P[:, [c.U_LIMIT, c.I_LIMIT]] = np.inf
    springs = tables.springs.copy()
    springs[:, [c.HARDENING, c.SLIP_LEVEL]] = 0.0
    grid = np.zeros_like(tables.grid)
    return tables._replace(P=P, ripple=np.zeros_like(tables.ripple), grid=grid, springs=springs)


def _locked(machine: VirtualMachine, joints: set[int]) -> pin.Model:
    """Return the true model with every other joint too heavy to move."""
    heavy, true = 1e6 * np.diag(machine.inertia()), machine.true.copy()
    heavy[sorted(joints)] = 0.0
    true.armature = np.array(true.armature) + heavy
    return true


def _free(machine: VirtualMachine, names: Sequence[str], passive: bool) -> list[tuple[str, int]]:
    """Return the states that move, as (array of the state, flat index)."""
    layout = machine.layout
    joints = [layout.drive[n] for n in names]
    joints += [layout.bend[n] for n in names if n in layout.bend]
    joints += list(layout.passive.values()) if passive else []
    flat = [("q", j) for j in joints] + [("v", j) for j in joints]
    for name in names:
        i = machine.axes.index(name)
        if machine.truth.axes[name].drive.frequency > 0.0:
            flat += [("qm", i), ("vm", i)]
        flat += [("u", i)] + [("control", i * N_STATE + k) for k in range(N_STATE)]
    return flat


def _transition(
    machine: VirtualMachine, tables: Axes, home: Floats, free: Sequence[tuple[str, int]]
) -> Floats:
    """Return the map of the free states over one control period, by central differences."""
    na = len(machine.axes)
    zero, chatter = np.zeros((1, na)), np.zeros((1, na))
    none = np.zeros(0, dtype=np.intp), np.zeros((0, 3)), np.zeros((1, 0, 6))
    drive = Drive(home[None, :].copy(), zero, zero, zero, chatter, *none)
    start = equilibrium(machine.true, tables, home)
    sizes = _sizes(machine, start)
    A = np.zeros((len(free), len(free)))
    for k, (name, index) in enumerate(free):
        step = _STEP * sizes[name].flat[index]
        ends = []
        for sign in (1.0, -1.0):
            state = State._make(x.copy() for x in start)
            getattr(state, name).flat[index] += sign * step
            if name == "q":
                _carry(machine, tables, state)
            ends.append(_one_period(machine, tables, drive, state))
        for m, (other, at) in enumerate(free):
            high, low = (getattr(e, other).flat[at] for e in ends)
            A[m, k] = (high - low) / (2.0 * step)
    return A


def _carry(machine: VirtualMachine, tables: Axes, state: State) -> None:
    """Move rigidly driven motors with their joints."""
    for i, j in enumerate(tables.joint):
        if tables.P[i, c.FLEXIBLE] < 0.5:
            state.qm[i] = state.q[j]


def _sizes(machine: VirtualMachine, state: State) -> dict[str, Floats]:
    rated = np.array([machine.scales[n].rated for n in machine.axes])
    control = np.column_stack([rated, np.full(len(rated), 0.1), np.full(len(rated), 1e-3)])
    q, v = np.full_like(state.q, 1e-3), np.full_like(state.v, 0.1)
    motors = len(rated)
    return {
        "q": q,
        "v": v,
        "qm": np.full(motors, 1e-3),
        "vm": np.full(motors, 0.1),
        "u": rated,
        "control": control,
    }


def _one_period(machine: VirtualMachine, tables: Axes, drive: Drive, state: State) -> State:
    record = empty_record(1, 1, len(machine.axes), len(machine.joints))
    tree = tree_of(machine.true)
    room = empty_room(tree)
    run(tree, tables, drive, state, room, record, machine.timing)
    return state
