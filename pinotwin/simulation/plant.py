"""The nonlinear side of a simulated machine: rigid body on a tape, effects in tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import parameter_count
from pinotwin.dynamics.tape import record
from pinotwin.effects import Effect
from pinotwin.effects.layout import rigid_body_of
from pinotwin.simulation.state import Lookup, Modes, Parts
from pinotwin.simulation.tables import tabulate
from pinotwin.twin.open_loop import OpenLoop


@dataclass(frozen=True, eq=False)
class Plant:
    """What the generalised disturbance is made of; loads on springs get states from the coupled machine alone."""

    parts: Parts  # the rigid body, and M_D, C and K
    start: Floats  # values of its tape before a step
    tables: Lookup  # effects that are functions of position or of speed and direction
    other: tuple[tuple[Effect, Floats], ...]  # effects that are neither, nor a load on a spring
    modes: tuple[tuple[int, float, float, float], ...]  # joint, inertia share, f [Hz], damping ratio of loads
    limit: Floats  # largest tracking error that is still believed, shape (nv,)

    def substeps(self, sampling: float, step: float, shortest: float = 1e-5) -> int:
        """Return the internal steps a sample, none longer than ``step`` or shorter than ``shortest`` [s].

        Stable for (slope of friction over speed) h / M < 1 and, for presliding, h sqrt(stiffness / M) well below 2.
        """
        longest = min(step, sampling)
        tables, M = self.tables, np.maximum(self.parts.inertia, 1e-12)
        for k, j in enumerate(tables.directions[:, 0]):
            slope = max(float(np.abs(tables.dry[k]).max()) * tables.slope[k], 1e-12)
            longest = min(longest, max(0.3 * M[j] / slope, shortest))
        for k, j in enumerate(tables.slips):
            slope = max(float(np.abs(tables.slip[k]).max() * np.mean(tables.give[k])), 1e-12)
            longest = min(longest, max(0.3 * np.sqrt(M[j] / slope), shortest))
        return int(np.ceil(sampling / longest - 1e-9))

    def hanging(self, h: float) -> Modes:
        """Return the loads on springs at the internal step h [s], exact for an acceleration a that is held within it.

        The twist x of a spring, by which the load lags behind its joint, follows ``x'' + 2 zeta w x' + w^2 x = a``.
        """
        joint, share, frequency, damping = np.array(self.modes, dtype=float).reshape(-1, 4).T.copy()
        w = 2.0 * np.pi * frequency
        pull = np.stack([w * w, 2.0 * damping * w], axis=1)
        system = np.zeros((len(joint), 3, 3))
        system[:, 0, 1], system[:, 1, :2], system[:, 1, 2] = 1.0, -pull, 1.0
        step = np.ascontiguousarray(scipy.linalg.expm(h * system)[:, :2])
        return Modes(joint.astype(np.int64), share, pull, step)


def plant_of(plant: OpenLoop, qr: Floats, vr: Floats) -> Plant:
    """Return an identified plant laid out for stepping, for the travel and speeds of a command, shape (n, nv)."""
    machine = plant.machine
    low, high = qr.min(axis=0), qr.max(axis=0)
    some = np.where(machine.rotary, 0.2, 0.02)
    margin = 0.25 * (high - low) + some
    speed = 2.0 * np.abs(vr).max(axis=0) + some
    tables = tabulate(machine, plant.pairs, np.stack([low - margin, high + margin]), speed)
    other = tuple(plant.pairs[k] for k in tables.other if plant.effects[k].mode() is None)
    modes = tuple(
        (machine.names.index(str(effect.axis)), float(theta[0]), *mode)
        for effect, theta in plant.pairs
        if (mode := effect.mode()) is not None
    )
    M, C, K = (np.array(plant.diagonal[k], dtype=float) for k in ("inertia", "viscous", "stiffness"))
    ground = np.array(plant.diagonal.get("ground", M), dtype=float)
    tree, where = rigid_body_of(plant.effects)
    pi = np.zeros(parameter_count(machine.model))
    pi[tree.base.independent] = plant.theta[where]  # see :mod:`pinotwin.dynamics.tape`
    tape = record(machine.model, pi, tables.coupled)
    parts = Parts(tape.revolute, tape.ops, tape.sign, tape.mass, tape.bias, M, C, K, ground)
    start = np.zeros(tape.size)
    start[: len(tape.start)] = tape.start
    return Plant(parts, start, tables.lookup, other, modes, margin)
