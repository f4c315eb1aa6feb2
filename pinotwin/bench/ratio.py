"""rho: how much power an effect adds to a signal, over the power of the noise, from the truth alone.

It is that of the difference of two noiseless runs, with and without the effect, in the closed loop; noise is of sensors
and of friction that scatters. What a model fitted to the log takes up by its true columns, :func:`left_of` takes away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.effects import Effect
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.trajectories.moves import Trajectory
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual.withholding import changed

Courses = Mapping[str, Mapping[str, Floats]]  # axis -> signal (``u``, ``e``) -> values [SI], shape (n,)
Powers = Mapping[str, Mapping[str, float]]  # axis -> signal -> power [SI²]


@dataclass(frozen=True)
class Run:
    """Tracking errors and efforts of one run."""

    signals: Courses
    log: Mapping[str, Floats]  # the run itself

    def minus(self, other: Run) -> dict[str, dict[str, Floats]]:
        """Return the difference of every signal."""
        return {a: {s: x - other.signals[a][s] for s, x in of.items()} for a, of in self.signals.items()}


def run(machine: VirtualMachine, path: Trajectory, *, noise: bool = False) -> Run:
    """Return a run with the seed that all runs of a comparison share."""
    log = machine.record(path, seed=1, noise=noise).log
    signals = {a: {"u": log[f"{a}.u"], "e": log[f"{a}.qr"] - log[f"{a}.q"]} for a in machine.axes}
    return Run(signals, log)


def noise_powers(machine: VirtualMachine, path: Trajectory, clean: Run) -> Powers:
    """Return the noise of every signal: sensors plus scatter of friction, from the healthy truth."""
    still = replace(machine, truth=replace(machine.truth, scatter=0.0))
    sensors = run(still, path, noise=True).minus(clean)
    sigma = machine.truth.scatter
    levels = ("coulomb", "viscous") if sigma > 0.0 else ()
    parts = [sensors, *(run(_scaled(machine, x, 1.0 + sigma), path).minus(clean) for x in levels)]
    return {
        a: {s: float(sum(np.mean(p[a][s] ** 2) for p in parts)) for s in ("u", "e")} for a in machine.axes
    }


def _scaled(machine: VirtualMachine, level: str, factor: float) -> VirtualMachine:
    axes = {
        name: changed(axis, "friction", **{level: (getattr(axis.friction, level) or 0.0) * factor})
        for name, axis in machine.truth.axes.items()
    }
    return replace(machine, truth=replace(machine.truth, axes=axes))


def powers(difference: Courses) -> dict[str, dict[str, float]]:
    """Return the power of every signal of a difference."""
    return {a: {s: float(np.mean(x**2)) for s, x in of.items()} for a, of in difference.items()}


def over(difference: Powers, noise: Powers) -> dict[str, dict[str, float]]:
    """Return power over the noise, per axis and signal."""
    return {a: {s: x / max(noise[a][s], 1e-300) for s, x in of.items()} for a, of in difference.items()}


def left_of(
    difference: Courses, along: Run, machine: Machine, truth: VirtualMachine, noise: Powers
) -> dict[str, float]:
    """Return the power of an effort over the noise [-] that a machine's true columns leave at 1200 rows of a run."""
    # The difference takes the effort's place in the log, so that it goes through the filter of the motion.
    efforts = {f"{a}.u": of["u"] for a, of in difference.items()}
    motion = prepare(machine, Log({**along.log, **efforts}))
    effects = [at_truth(e, truth).fitted_to(motion) for e in machine.effects]
    pick = np.unique(np.linspace(0, len(motion) - 1, 1200).astype(int))
    joints = np.array([motion.index(a) for a in difference], dtype=np.intp)
    weight = np.repeat([1.0 / np.sqrt(max(noise[a]["u"], 1e-300)) for a in difference], len(pick))
    A = _design(motion, effects, pick, joints) * weight[:, None]
    y = np.nan_to_num(motion.u[np.ix_(pick, joints)]).T.reshape(-1) * weight
    size = np.linalg.norm(A, axis=0)
    A = A[:, size > 0.0] / size[size > 0.0]
    solved = np.linalg.solve(A.T @ A + 1e-9 * np.eye(A.shape[1]), A.T @ y)
    left = (y - A @ solved).reshape(len(joints), -1)
    return {a: float(np.mean(x**2)) for a, x in zip(difference, left, strict=True)}


def _design(motion: Motion, effects: Sequence[Effect], pick: Ints, joints: Ints) -> Floats:
    """Return the columns of all effects at some samples, joint after joint, shape (k m, p)."""
    parts = []
    for effect in effects:
        columns = effect.columns(motion)
        wide = np.zeros((len(motion.names), len(pick), columns.values.shape[2]))
        for k, j in enumerate(columns.joints):
            wide[j] = columns.values[pick, k]
        parts.append(wide[joints])
    whole = np.concatenate(parts, axis=2)
    return whole.reshape(-1, whole.shape[2])


def at_truth(effect: Effect, truth: VirtualMachine) -> Effect:
    """Return an effect with the shapes that the truth has, where it has them."""
    if effect.axis is None or effect.axis not in truth.truth.axes:
        return effect
    axis = truth.truth.axes[effect.axis]
    f, waves = axis.friction, axis.ripple
    true: dict[str, float | None] = {}
    if effect.name == "presliding":
        true = {"x_s": f.presliding, "v_s": f.stribeck_speed}
    if effect.name in ("ripple", "ripple_modulated") and waves:
        true = {"period": waves[0].period}
    if effect.name == "ripple_modulated" and waves:
        true["eps"] = waves[0].modulation_phase
    return replace(effect, **{k: x for k, x in true.items() if x})  # type: ignore[type-var]
