"""Turn the resolved truth into the flat tables that the kernel reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.virtual import columns as c
from pinotwin.virtual.axis_truth import AxisTruth, Bend, Friction
from pinotwin.virtual.structs import Axes
from pinotwin.virtual.tree import inertia_at
from pinotwin.virtual.truth import Passive, Truth

_LAWS = {"none": c.NONE, "lugre": c.LUGRE, "gms": c.GMS, "elastoplastic": c.ELASTOPLASTIC}


@dataclass(frozen=True)
class Layout:
    """Where the names of a machine sit in its true model; joints counted from 0."""

    drive: Mapping[str, int]  # axis -> joint that the motor drives, in the order of the axes
    passive: Mapping[str, int]  # passive joint -> its index
    bend: Mapping[str, int]  # axis -> index of its hidden joint
    home: Floats  # position at which frequencies are stated, shape (nv,)
    # number of the axis to which each joint belongs, shape (nv,): a bend to its own, a passive joint to the
    # one that carries it (-1 for the ground)
    group: Ints


class Timing(NamedTuple):
    """Rates of the kernel: control period [s], updates per period, substeps per update."""

    period: float
    updates: int
    substeps: int


def _friction_row(row: Floats, f: Friction, inertia: float) -> None:
    coulomb, width = f.coulomb or 0.0, f.presliding or 1e-6
    row[c.LAW] = _LAWS[f.kind] if coulomb > 0.0 else c.NONE
    row[c.BRISTLE] = max(coulomb, 1e-12) / width
    row[c.BRISTLE_DAMPER] = 2.0 * f.damping * np.sqrt(row[c.BRISTLE] * inertia)
    row[c.LEVEL_P] = coulomb * (1.0 + 0.5 * f.asymmetry)
    row[c.LEVEL_N] = coulomb * (1.0 - 0.5 * f.asymmetry)
    row[c.STATIC], row[c.STRIBECK] = f.static, f.stribeck_speed or 1e-3
    row[c.VISCOUS], row[c.QUADRATIC], row[c.BY_LOAD] = f.viscous or 0.0, f.quadratic, f.load
    row[c.WARMING], row[c.WARMING_TIME] = f.warming, f.warming_time
    row[c.WANDER], row[c.WANDER_RATE] = f.wander, 2.0 * np.pi / f.wander_period
    row[c.CHATTER] = f.chatter
    row[c.DRAG], row[c.DRAG_RATE], row[c.DRAG_SHARP] = f.drag, 1.0 / f.drag_distance, f.drag_sharpness


def _control_row(row: Floats, axis: AxisTruth, aff: float, timing: Timing) -> None:
    k = axis.controller
    row[c.PID] = float(k.kind == "pid")
    row[c.KP], row[c.KV], row[c.KI] = k.kp or 0.0, k.kv or 0.0, k.ki or 0.0
    row[c.VFF], row[c.AFF] = k.velocity_feedforward, k.acceleration_feedforward * aff
    row[c.V_ALPHA] = 1.0 - np.exp(-2.0 * np.pi * k.velocity_filter * timing.period)
    row[c.I_LIMIT], row[c.U_LIMIT] = k.integral_limit or np.inf, k.effort_limit or np.inf
    row[c.DELAY] = k.delay
    dt = timing.period / timing.updates / timing.substeps
    fast = 2.0 * np.pi * k.current_bandwidth * dt
    row[c.U_ALPHA], row[c.U_MEAN] = 1.0 - np.exp(-fast), (1.0 - np.exp(-fast)) / fast
    e = axis.encoder
    row[c.RESOLUTION], row[c.PITCH] = e.resolution or 0.0, e.pitch
    row[c.ERROR], row[c.ERROR_RATE], row[c.ERROR_PHASE] = e.error, 2 * np.pi / e.period, e.phase


def _drive_row(row: Floats, axis: AxisTruth, load: float) -> None:
    d = axis.drive
    if d.frequency <= 0.0:
        return
    rotor = d.rotor or 1e-3 * load
    reduced = rotor * load / (rotor + load)
    w = 2.0 * np.pi * d.frequency
    row[c.FLEXIBLE], row[c.INV_ROTOR] = 1.0, 1.0 / rotor
    row[c.SPRING], row[c.DAMPER] = reduced * w * w, 2.0 * d.damping * w * reduced
    row[c.BACKLASH] = 0.5 * d.backlash
    row[c.LOAD_ENCODER] = float(d.encoder == "load")


def _ripple_table(axes: Sequence[AxisTruth]) -> Floats:
    table = np.zeros((len(axes), max(1, *(len(a.ripple) for a in axes)), c.N_RIPPLE))
    for i, axis in enumerate(axes):
        for k, r in enumerate(axis.ripple):
            wave = 2.0 * np.pi / r.period
            table[i, k] = (r.amplitude, wave, r.phase, r.modulation, r.modulation_phase, r.speed, r.rate)
    return table


def cable_curve(axis: AxisTruth, q: Floats) -> Floats:
    """Return the irregular position-dependent effort of an axis at positions ``q``, shape (n,)."""
    cable, (low, high) = axis.cable, axis.limits.travel or (-1.0, 1.0)
    rng = np.random.default_rng([cable.seed, 77])
    curve = np.zeros_like(q)
    if cable.amplitude > 0.0:
        waves = np.exp(rng.uniform(np.log(0.5 / (high - low)), np.log(1.0 / cable.length), 24))
        sizes = rng.rayleigh(1.0, 24) * (waves / waves.min()) ** -0.5
        phases = rng.uniform(0.0, 2.0 * np.pi, 24)
        raw = np.sin(2.0 * np.pi * np.outer(q, waves) + phases) @ sizes
        curve = cable.amplitude * (raw - raw.mean()) / max(float(raw.std()), 1e-12)
    if cable.end != 0.0:
        width = 0.06 * (high - low)
        curve = curve + cable.end * np.exp(np.minimum(q - high, 0.1) / width)
        curve = curve - 0.7 * cable.end * np.exp(np.minimum(low - q, 0.1) / width)
    return curve


def _tables(axes: Sequence[AxisTruth], points: int = 4096) -> tuple[Floats, Floats]:
    """Return position tables: fine against any grid that an identification would choose."""
    table, grid = np.zeros((len(axes), points)), np.zeros((len(axes), 2))
    for i, axis in enumerate(axes):
        if axis.cable.amplitude == 0.0 and axis.cable.end == 0.0:
            continue
        low, high = axis.limits.travel or (-1.0, 1.0)
        q = np.linspace(low - 0.1 * (high - low), high + 0.1 * (high - low), points)
        table[i], grid[i] = cable_curve(axis, q), (q[0], 1.0 / (q[1] - q[0]))
    return table, grid


def _spring_row(spec: Passive | Bend, inertia: float) -> tuple[float, ...]:
    if isinstance(spec, Bend):
        w = 2.0 * np.pi * spec.frequency
        return (inertia * w * w, 2.0 * spec.damping * w * inertia, 0.0, 0.0, 1.0)
    w = 2.0 * np.pi * (spec.frequency or 0.0)
    k = inertia * w * w if spec.stiffness is None else spec.stiffness
    d = 2.0 * spec.damping_ratio * np.sqrt(k * inertia) if spec.damping is None else spec.damping
    slip = spec.hysteresis / spec.hysteresis_width
    return (k, d, spec.hardening, spec.hysteresis, max(slip, 1e-12))


def tables(truth: Truth, layout: Layout, true: pin.Model, timing: Timing, cad: Mapping[str, float]) -> Axes:
    """Return the kernel's tables of a machine; ``cad`` is what the feed-forward knows of inertia [kg or kg·m²]."""
    M = np.diag(inertia_at(true, layout.home))
    specs = [truth.axes[name] for name in layout.drive]
    P = np.zeros((len(specs), c.N_COLUMNS))
    for row, name, axis in zip(P, layout.drive, specs, strict=True):
        inertia = float(M[layout.drive[name]])
        moved = axis.drive.rotor or inertia if axis.drive.frequency > 0.0 else inertia
        _friction_row(row, axis.friction, moved)
        _control_row(row, axis, cad[name], timing)
        _drive_row(row, axis, inertia)
    table, grid = _tables(specs)
    springs: dict[int, Passive | Bend] = {j: truth.passive[name] for name, j in layout.passive.items()}
    springs |= {j: b for n, j in layout.bend.items() if (b := truth.axes[n].bend) is not None}
    every = sorted(springs)
    rows = [_spring_row(springs[j], float(M[j])) for j in every]
    return Axes(
        joint=np.array(list(layout.drive.values()), dtype=np.intp),
        P=P,
        ripple=_ripple_table(specs),
        table=table,
        grid=grid,
        sprung=np.array(every, dtype=np.intp),
        springs=np.array(rows, dtype=float).reshape(-1, c.N_SPRING),
        coupled=int(truth.coupled),
        group=layout.group,
    )


def stiffest(axes: Axes, M: Floats) -> float:
    """Return the highest angular frequency in the plant [rad/s]; ``M`` is the mass matrix at home, (nv, nv)."""
    light = np.diag(np.linalg.inv(M))
    squares = [0.0]
    for P, mobile in zip(axes.P, light[axes.joint], strict=True):
        motor = P[c.INV_ROTOR] if P[c.FLEXIBLE] > 0.5 else mobile
        bristle = P[c.BRISTLE] * motor if P[c.LAW] != c.NONE else 0.0
        squares += [bristle, P[c.SPRING] * (P[c.INV_ROTOR] + mobile)]
    for S, mobile in zip(axes.springs, light[axes.sprung], strict=True):
        squares.append((S[c.STIFFNESS] + S[c.SLIP_STIFFNESS]) * mobile)
    return float(np.sqrt(max(squares)))
