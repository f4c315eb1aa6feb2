"""The split of the motor effort into linear terms and the generalised disturbance (thesis Eq. 4.1-4.4).

    u = M_D a + C v + K q + d(q, v, a)                        (Eq. 4.3; with the measured motion Eq. 4.19)

C and K are the coefficients of viscous effects and springs, d is everything else by cause. M_D is diagonal and
constant: the mean of M_ii(q) over 64 postures (a Halton sequence without its corner) in the travel of the identified
logs, where the source keeps its constant term, which depends on how the equation is written. Loops belong to the M_D
with which they were identified: ``twin.diagonal``. The rigid body's effort, with parts of the motion set to zero, is

    gravity               g(q),      coriolis_centrifugal  c(q, v)
    inertial_coupling     M(q) a - M_D a: the other axes' accelerations, and M_ii(q) - M_D_ii
    flexibility           what the motion of passive joints adds to all three
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects import Effect
from pinotwin.errors import DataError
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.twin.open_loop import OpenLoop

CAUSES = (  # Causes of the generalised disturbance; ``position`` is ripple, tables and offsets
    "friction",
    "position",
    "gravity",
    "inertial_coupling",
    "coriolis_centrifugal",
    "flexibility",
    "external",
    "other",
)


def diagonal(plant: OpenLoop, motion: Motion) -> dict[str, Floats]:
    """Return ``inertia``, ``viscous``, ``stiffness`` (and ``ground``, Eq. 5.4) over a motion, diagonals (nv,)."""
    q = np.concatenate([motion.q[s] for s in motion.segments])
    M = mean_inertia(plant, q.min(axis=0), q.max(axis=0))
    found = {"inertia": np.diag(M).copy(), **linear_terms(plant)}
    if plant.machine.passive:
        found["ground"] = ground = np.diag(M).copy()
        for passive, axis in reacting(plant.machine).items():
            p, i = plant.machine.names.index(passive), plant.machine.axes[axis].index
            ground[p] = M[p, p] - 2.0 * M[p, i] + M[i, i]
    return found


def linear_terms(plant: OpenLoop) -> dict[str, Floats]:
    """Return the coefficients of all effects that count as ``viscous`` or ``stiffness`` by joint, (nv,) each."""
    found = {name: np.zeros(plant.machine.nv) for name in ("viscous", "stiffness")}
    for effect, theta in plant.pairs:
        for cause, value in zip(causes(effect), theta, strict=True):
            if cause in found:
                found[cause][plant.machine.names.index(str(effect.axis))] += value
    return found


def reacting(machine: Machine) -> dict[str, str]:
    """Return the axis that sits on each passive joint: its motor's reaction moves the joint."""
    parents = machine.model.parents
    out: dict[str, str] = {}
    for name, axis in machine.axes.items():
        below = int(parents[axis.index + 1]) - 1
        if below >= 0 and machine.names[below] in machine.passive:
            out.setdefault(machine.names[below], name)
    return out


def mean_inertia(plant: OpenLoop, lower: Floats, upper: Floats, postures: int = 64) -> Floats:
    """Return the mean of M(q) over postures between lower and upper, (nv,) each, shape (nv, nv)."""
    from scipy.stats.qmc import Halton  # half a second, which simulating does not need

    q = lower + Halton(len(lower), scramble=False).fast_forward(1).random(postures) * (upper - lower)
    zero = np.zeros_like(q)
    held = plant.rigid_effort(q, zero, zero)
    return np.stack(
        [np.mean(plant.rigid_effort(q, zero, zero + unit) - held, axis=0) for unit in np.eye(len(lower))],
        axis=1,
    )


def generalised_disturbance(
    plant: OpenLoop, motion: Motion, diagonal: Mapping[str, Floats], *, modes: bool = True
) -> Floats:
    """Return the generalised disturbance of a motion, (n, nv) [N or N·m] (Eq. 4.4); ``modes``: loads on springs too."""
    total = plant.rigid_effort(motion.q, motion.v, motion.a)
    motion = plant.scene(motion)
    for effect, theta in plant.pairs:
        if effect.axis is not None and not effect.logged_effort and (modes or effect.mode() is None):
            total += effect.along(motion, theta)
    if motion.external is not None:
        total -= motion.external
    return total - np.sum(list(linear(motion, diagonal).values()), axis=0)


def split(plant: OpenLoop, motion: Motion, *, modes: bool = True) -> dict[str, Floats]:
    """Return the same by its causes; with :func:`linear` they sum to ``twin.effort(motion)``, (n, nv) [N or N·m]."""
    if not plant.diagonal:
        raise DataError(f"{plant.machine.name}: the twin holds no diagonal; identify it again")
    parts: dict[str, Floats] = {}
    motion = plant.scene(motion)
    n, nv = motion.q.shape
    for effect, theta in plant.pairs:
        if effect.axis is None or not (modes or effect.mode() is None):
            continue
        words = causes(effect)
        for cause in dict.fromkeys(words):
            if cause not in ("viscous", "stiffness"):
                own = np.where([w == cause for w in words], theta, 0.0)
                parts[cause] = parts.get(cause, np.zeros((n, nv))) + effect.along(motion, own)
    inertia = linear(motion, plant.diagonal)["inertia"]
    for cause, effort in _rigid_parts(plant, motion, inertia).items():
        parts[cause] = parts[cause] + effort if cause in parts else effort
    if motion.external is not None:
        parts["external"] = -motion.external
    return {c: parts[c] for c in CAUSES if c in parts}


def causes(effect: Effect) -> tuple[str, ...]:
    """Return the cause that each coefficient of an effect counts as."""
    count = len(effect.coefficients())
    words: tuple[str, ...] = effect.causes
    return words * count if len(words) == 1 else words


def _rigid_parts(plant: OpenLoop, motion: Motion, inertia: Floats) -> dict[str, Floats]:
    """Return the parts of the rigid body's effort without M_D a."""
    moving = np.array([name in plant.machine.axes for name in motion.names], dtype=bool)
    q, v, a = (np.where(moving, x, 0.0) for x in (motion.q, motion.v, motion.a))
    zero = np.zeros_like(q)
    g = plant.rigid_effort(q, zero, zero)
    gc = plant.rigid_effort(q, v, zero)
    whole = plant.rigid_effort(q, v, a)
    parts = {
        "gravity": g,
        "inertial_coupling": whole - gc - np.where(moving, inertia, 0.0),
        "coriolis_centrifugal": gc - g,
    }
    if not moving.all():
        full = plant.rigid_effort(motion.q, motion.v, motion.a)
        parts["flexibility"] = full - whole - (inertia - np.where(moving, inertia, 0.0))
    return parts


def linear(motion: Motion, diagonal: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return M_D a, C v and K q of a motion: ``inertia``, ``viscous`` and ``stiffness``, each of shape (n, nv)."""
    pairs = {"inertia": motion.a, "viscous": motion.v, "stiffness": motion.q}
    return {name: x * np.asarray(diagonal[name], dtype=float) for name, x in pairs.items()}
