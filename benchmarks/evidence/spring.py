"""Stiffness and damping of the virtual rig's joint, by `identify_flexible`, against the sealed truth.

Eight logs of 14 s, each another command, with the reconstructed vibration; friction of the axes is LuGre, which the
model's `presliding` does not hold exactly. The plain joint, and one with 5 % hysteresis and 10 % hardening: its
bristle has a quarter of the spring's stiffness, so that the joint is stiffer than k wherever it moves by less than
the bristle's width.
"""

from __future__ import annotations

import numpy as np

from benchmarks.evidence.store import Figure
from benchmarks.vibration import rig
from pinotwin.machine import Machine
from pinotwin.reconstruction import identify_flexible, reconstruct_vibration
from pinotwin.trajectories.moves import random_trajectory
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual.imu import record_imu

SEEDS = "1 to 8, commands 201 to 208; looked at"
SLOW = True
JOINTS = {"plain": (0.0, 0.0), "rough": (0.05, 0.10)}
WORDS = {"k": "stiffness", "c": "damping"}
LEVEL = 1.959964


def figures() -> list[Figure]:
    """Measure."""
    out = []
    for joint, (hysteresis, hardening) in JOINTS.items():
        virtual = rig(hysteresis, hardening)
        rows = [off(virtual, seed) for seed in range(1, 9)]
        for name, words in WORDS.items():
            relative, z = np.array([row[name] for row in rows]).T
            print(joint, name, relative.round(4), z.round(1), flush=True)
            size, held = np.abs(relative), float(np.sum(np.abs(z) < LEVEL))
            out += [
                Figure(f"{joint}_{name}", f"{joint} joint: {words}, median error", 100.0 * float(np.median(size)),
                       kind="development", low=100.0 * float(size.min()), high=100.0 * float(size.max())),
                Figure(f"{joint}_{name}_covered", f"{joint} joint: 95 % intervals that hold the {words}", held, "",
                       "development", of=len(rows)),
            ]  # fmt: skip
    return out


def off(virtual: VirtualMachine, seed: int) -> dict[str, tuple[float, float]]:
    """Return by how much k and c are off, as shares of the truth and in standard errors."""
    machine, truth = Machine.load("flexure_rig"), virtual.tables().springs[0, :2]
    run = virtual.record(random_trajectory(virtual, 14.0, 200 + seed), seed=seed, truth_rate=2000.0)
    log, imu = run.to_log(), record_imu(run.truth, "C_link", virtual.truth.seed, seed)
    found = reconstruct_vibration(machine, log, imu)
    spring = identify_flexible(machine, log, found)
    both = zip("kc", (spring.stiffness, spring.damping), truth, strict=True)
    return {name: (x.value / true - 1.0, (x.value - true) / x.error) for name, x, true in both}
