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


@dataclass(frozen=True)
class Run:
    """Efforts and tracking errors of one run."""

    axes: Sequence[str]  # names
    signals: Floats  # effort u, then tracking error e, of every axis [N or N·m, m or rad], shape (2, axes, n)
    log: Mapping[str, Floats]  # the run itself

    def with_efforts(self, efforts: Floats) -> Log:
        """Return the run with other efforts [N or N·m], shape (axes, n)."""
        names = [f"{axis}.u" for axis in self.axes]
        return Log({**self.log, **dict(zip(names, efforts, strict=True))}, source="course")


def run(machine: VirtualMachine, path: Trajectory, *, noise: bool = False) -> Run:
    """Return a run with the seed that all runs of a comparison share."""
    log = machine.record(path, seed=1, noise=noise).log
    efforts = [log[f"{a}.u"] for a in machine.axes]
    errors = [log[f"{a}.qr"] - log[f"{a}.q"] for a in machine.axes]
    return Run(machine.axes, np.array([efforts, errors]), log)


def powers(signals: Floats) -> Floats:
    """Return the power of every signal, shape (2, axes, n) [SI], as an array (2, axes) [SI²]."""
    return np.asarray(np.mean(signals**2, axis=-1))


def noise_powers(machine: VirtualMachine, path: Trajectory, clean: Run) -> Floats:
    """Return the noise (2, axes) [SI²]: sensors plus scatter of friction, from the healthy truth."""
    still, sigma = replace(machine, truth=replace(machine.truth, scatter=0.0)), machine.truth.scatter
    noisy = [run(still, path, noise=True)]
    if sigma > 0.0:
        noisy += [run(_scaled(machine, level, 1.0 + sigma), path) for level in ("coulomb", "viscous")]
    return np.sum([powers(x.signals - clean.signals) for x in noisy], axis=0)


def _scaled(machine: VirtualMachine, level: str, factor: float) -> VirtualMachine:
    axes = {
        name: changed(axis, "friction", **{level: (getattr(axis.friction, level) or 0.0) * factor})
        for name, axis in machine.truth.axes.items()
    }
    return replace(machine, truth=replace(machine.truth, axes=axes))


def left_of(efforts: Floats, along: Run, machine: Machine, truth: VirtualMachine, noise: Floats) -> Floats:
    """Return what of the power of efforts over the noise a machine's true columns leave, at 1200 rows of a run.

    ``efforts`` (axes, n) [N or N·m] and the power of their ``noise`` (axes,) give shape (axes,) [-].
    """
    # The efforts take their place in the log, so that they go through the filter of the motion.
    motion = prepare(machine, along.with_efforts(efforts))
    effects = [at_truth(e, truth).fitted_to(motion) for e in machine.effects]
    pick = np.unique(np.linspace(0, len(motion) - 1, 1200).astype(int))
    joints = np.array([motion.index(a) for a in along.axes], dtype=np.intp)
    weight = np.repeat(1.0 / np.sqrt(np.maximum(noise, 1e-300)), len(pick))
    A = _design(motion, effects, pick, joints) * weight[:, None]
    y = np.nan_to_num(motion.u[np.ix_(pick, joints)]).T.reshape(-1) * weight
    size = np.linalg.norm(A, axis=0)
    A = A[:, size > 0.0] / size[size > 0.0]
    solved = np.linalg.solve(A.T @ A + 1e-9 * np.eye(A.shape[1]), A.T @ y)
    return np.asarray(np.mean((y - A @ solved).reshape(len(joints), -1) ** 2, axis=1))


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
