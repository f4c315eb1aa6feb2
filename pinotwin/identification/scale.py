"""What one unit of an effort is where the log states no factor: u_j = (W_j P pi + F_j phi_j) / s_j, s_j [N or N·m].

What axes share, a given factor and the URDF's masses tell s_j: Gauss-Newton steps in log s, of which each finds the
bodies by :func:`pinotwin.solve.bodies.near`. A rotor may have as much inertia as the URDF's bodies put on its axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from pinotwin.arrays import Floats
from pinotwin.columns import Column, unsized
from pinotwin.dynamics import mass_matrix
from pinotwin.effects.layout import rigid_body_of
from pinotwin.identification.assemble import assemble, choose_rows
from pinotwin.identification.bodies import bodies_of
from pinotwin.identification.settings import Settings
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.signals import autocorrelation
from pinotwin.solve.bodies import Bodies, Evidence, near
from pinotwin.solve.rank import r_factor
from pinotwin.system.phrases import IDENTIFIED
from pinotwin.twin import OpenLoop, Parameter, Parameters
from pinotwin.units import ELECTRICAL, in_log_unit


@dataclass(frozen=True)
class Sizes:
    """What one unit of the efforts is."""

    # axis -> ``unit`` in the log, ``size`` [N or N·m], its ``interval95``, ``error`` of its logarithm, and
    # ``source``: ``URDF``, ``given`` by the factors of other axes, or ``rod`` where the URDF has dummies
    axes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    # relative standard error that the sizes leave to each base parameter, shape (b,)
    doubt: Floats = field(default_factory=lambda: np.zeros(0))

    def notes(self, machine: Machine) -> list[str]:
        """Return a sentence an axis."""
        out = []
        for name, row in self.axes.items():
            said = {"unit": ELECTRICAL[row["unit"]], "effort": "N·m" if machine.axes[name].rotary else "N"}
            sentence = IDENTIFIED[f"unit_{row['source']}"]
            out.append(sentence.format(axis=name, size=row["size"], ends=row["interval95"], **said))
        return out

    def stated(self, plant: OpenLoop) -> OpenLoop:
        """Return a plant whose axes' coefficients are in the units of the log, and others no surer than the sizes."""
        if not self.axes:
            return plant
        doubts, rows = iter(self.doubt), []
        for row in plant.parameters:
            name, wide = row.effect.split(".")[0], next(doubts, 0.0) if row.effect == "rigid_body" else 0.0
            if name in self.axes:
                row = _in_log_units(row, plant.machine.axes[name].rotary, self.axes[name])
            rows.append(replace(row, error=float(np.hypot(row.error, wide * row.value))))
        bodies = [dict(body) for body in plant.bodies]
        for k, body in enumerate(bodies):
            if body["interval95"] is not None:
                wide = self.doubt[plant.machine.base.P[:, 10 * k : 10 * k + 10].any(axis=1)].min()
                half = np.hypot(np.ptp(body["interval95"]) / 2.0, 1.96 * wide * body["mass"])
                body["interval95"] = [float(body["mass"] + side * half) for side in (-1.0, 1.0)]
        return replace(plant, parameters=Parameters(rows), bodies=tuple(bodies))


def _in_log_units(p: Parameter, rotary: bool, row: Mapping[str, Any]) -> Parameter:
    """Return a coefficient of an axis in the unit of its log; an inertia is no surer than the size of that."""
    unit, size = in_log_unit(p.unit, rotary, row)
    error = p.error if unit != p.unit or "kg" not in unit else np.hypot(p.error, row["error"] * p.value)
    prior = None if p.prior is None else p.prior / size
    return replace(p, unit=unit, value=p.value / size, error=float(error / size), prior=prior)


def with_sizes(machine: Machine, logs: Sequence[Log], settings: Settings) -> tuple[Machine, Sizes]:
    """Return the machine with the size of every unit that the logs leave open, and these sizes."""
    units = {name: log.units[name] for log in logs for name in unsized(log) if name[:-2] in machine.axes}
    if not units or machine.transmission is not None:  # behind a transmission an effort is of several motors
        return machine, Sizes()
    motion, (bodies, dummy) = prepare(machine, logs), bodies_of(machine)
    parts = _rows(machine, motion)
    moved = (j for j, (A, _) in parts.items() if (A @ bodies.P @ bodies.pi0).any())
    open_ = [j for j in moved if f"{machine.names[j]}.u" in units]
    if not open_:
        return machine, Sizes()
    few = motion.q[:: max(1, len(motion) // 100)]
    rotor = np.diagonal(mass_matrix(machine.model, few), axis1=1, axis2=2).mean(axis=0)
    alike = np.array([machine.axes[a].rotary for a in machine.names])
    rotor = np.array([rotor[alike == x].max() for x in alike])
    sizes, errors = _sizes(parts, open_, bodies, np.maximum(rotor, 1e-9), settings.urdf_rows[0])
    told = 1.96 * errors < np.log(100.0)  # else the logs say nothing of the unit, which stays as it is
    open_, sizes, errors = [j for j, x in zip(open_, told, strict=True) if x], sizes[told], errors[told]
    doubts = dict(zip(open_, errors, strict=True))
    acting = [np.where(A.any(axis=0), doubts.get(j, 0.0), np.inf) for j, (A, _) in parts.items()]
    doubt = np.min(acting, axis=0)
    source = "rod" if dummy.any() else "URDF" if len(open_) == len(parts) else "given"
    found, columns, spec = {}, dict(machine.columns), dict(machine.spec.get("columns") or {})
    for joint, size, error in zip(open_, sizes.tolist(), errors.tolist(), strict=True):
        unit = units[channel := f"{machine.names[joint]}.u"]
        ends = None if source == "rod" else [size * math.exp(side * 1.96 * error) for side in (-1.0, 1.0)]
        row = {"unit": unit, "size": size, "interval95": ends, "source": source, "error": error}
        found[machine.names[joint]] = row
        columns[channel] = replace(columns.get(channel, Column()), unit=unit, found=size)
        stated = spec.get(channel, {})
        stated = stated if isinstance(stated, dict) else {"column": stated}
        spec[channel] = {**stated, "unit": unit, "found": size}
    machine = replace(machine, columns=columns, spec={**machine.spec, "columns": spec})
    return machine, Sizes(found, np.where(np.isfinite(doubt), doubt, 0.0))


def _rows(machine: Machine, motion: Motion) -> dict[int, tuple[Floats, Floats]]:
    """Return per joint its rows of the base parameters and its effort, independent and of one sigma, friction out."""
    effects = [effect.fitted_to(motion) for effect in machine.effects if not effect.needs]
    problem = assemble(motion, effects, choose_rows(motion))
    rigid = rigid_body_of(effects)[1]
    lags = round(1.0 / (motion.step * motion.decimation))
    out = {}
    for joint, part in problem.slices.items():
        own, A = problem.dense(part)
        beta = (own >= rigid.start) & (own < rigid.stop)
        W, y = A[:, :-1], A[:, -1]
        left = y - W @ np.linalg.lstsq(W, y, rcond=1e-9)[0]
        rho = autocorrelation(left, min(lags, len(left) - 1))
        memory = 1.0 + 2.0 * rho[1 : 1 + int(np.argmax(rho[1:] < 0.0)) if (rho < 0.0).any() else None].sum()
        R = r_factor(np.column_stack([W[:, ~beta], W[:, beta], y]))[(~beta).sum() :, (~beta).sum() :]
        R /= max(float(np.std(left)) * np.sqrt(memory), 1e-12 * float(np.linalg.norm(y)))
        rows = np.zeros((len(R), rigid.stop - rigid.start))
        rows[:, own[beta] - rigid.start] = R[:, :-1]
        out[joint] = rows, R[:, -1]
    return out


def _sizes(
    parts: Mapping[int, tuple[Floats, Floats]],
    open_: Sequence[int],
    bodies: Bodies,
    rotor: Floats,
    weight: float,
    rounds: int = 100,
) -> tuple[Floats, Floats]:
    """Return the size of one unit of each open joint [N or N·m], and the standard error of its logarithm.

    ``parts`` are independent rows of base parameters and effort, ``rotor`` what a rotor may have [kg or kg·m²].
    """
    believed, count = bodies.pi0, len(bodies.pi0)
    every, free = Bodies(np.eye(count), believed, bodies.count), np.full(count, np.inf)
    rigid = {j: A @ bodies.P for j, (A, _) in parts.items()}
    rotors = np.eye(count)[-len(rotor) :] / rotor[:, None]
    y = np.concatenate([effort for _, effort in parts.values()])
    size = np.array([np.linalg.norm(rigid[j] @ believed) / np.linalg.norm(parts[j][1]) for j in open_])
    found, H = None, np.eye(len(open_))
    for _ in range(rounds):
        unit = dict(zip(open_, size, strict=True))
        blocks = [A / unit.get(j, 1.0) for j, A in rigid.items()]
        A = np.concatenate(blocks)
        rows, right = np.concatenate([A, rotors]), np.append(y, rotors @ believed)
        found = near(Evidence(rows, right, believed, np.arange(count), -free, free), every, weight, found)
        slopes = block_diag(*(-(x @ found.pi)[:, None] for x in blocks))
        slope = slopes[:, [list(rigid).index(j) for j in open_]]
        hidden = solve_triangular(r_factor(found.root), A[:, found.at].T @ slope, trans="T")
        H = slope.T @ slope - hidden.T @ hidden
        step = np.clip(np.linalg.pinv(H, 1e-10, True) @ (slope.T @ (y - A @ found.pi)), -0.5, 0.5)
        size = size * np.exp(step)
        if np.abs(step).max() < 1e-4:
            break
    values, V = np.linalg.eigh(H)  # what nothing determines has a large error, not none
    return size, np.sqrt((V**2 / np.maximum(values, 1e-10 * values.max() + 1e-300)).sum(axis=1))
