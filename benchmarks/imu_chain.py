"""The source's IMU chain (thesis Section 6.3, Fig. 6-5) beside the batch estimate, on the virtual flexure rig.

python -m benchmarks imu_chain [--runs 22] [--seconds 6.12]

Repeats of one command with two MTi-630s, as in the source: each method's velocity and acceleration of the
deflection is averaged over the runs; printed are the RMS difference between the two IMUs (the source's
measure: 0.0474 deg/s and 7.33 deg/s²), and the RMS error against the sealed truth, which the source could not
know. Every method gets the same readings on the servo's clock, its clock and delay from the batch estimate.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks._imu_methods import baselines
from pinotwin.imu.filters import group_delay
from pinotwin.machine import Machine
from pinotwin.machine.bundled import machines
from pinotwin.reconstruction import Vibration, reconstruct_vibration
from pinotwin.trajectories.moves import random_trajectory
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual.imu import record_imu

DEG = 180.0 / np.pi


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=22)
    parser.add_argument("--seconds", type=float, default=6.12)
    args = parser.parse_known_args()[0]
    compare(args.runs, args.seconds)


def compare(runs: int, seconds: float) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Print the comparison and return it: method -> velocity and acceleration, three times [deg/s, deg/s²].

    They are of IMU against IMU, of the mean against the truth, of one run against the truth.
    """
    out = {}
    machine, vm = Machine.load("flexure_rig"), VirtualMachine.load(machines()["flexure_rig"])
    command = random_trajectory(vm, seconds, 3)
    recorded = [vm.record(command, seed=seed, truth_rate=4000.0) for seed in range(runs)]
    imus = [
        [record_imu(r.truth, "C_link", vm.truth.seed, seed, k + 1) for seed, r in enumerate(recorded)]
        for k in (0, 1)
    ]
    found = reconstruct_vibration(machine, [r.to_log() for r in recorded], imus[0], imus[1])
    true = np.mean([np.stack([x[::10] for x in r.truth.joint("delta")]) for r in recorded], axis=0)[1:]
    size = np.sqrt(np.mean(true**2, axis=1)) * DEG
    print(f"{runs} runs of {seconds:g} s; true deflection: {size[0]:.3f} deg/s, {size[1]:.1f} deg/s² RMS")
    print(f"{'method':12s} {'IMU against IMU':>22s} {'against the truth':>22s} {'one run':>18s}")
    for name, signals in _signals(found).items():
        mean = np.nanmean(signals, axis=1)  # (imu, v or a, n)
        n = min(mean.shape[-1], true.shape[-1])
        differ = _rms(mean[0] - mean[1])
        error = _rms(mean.mean(axis=0)[:, :n] - true[:, :n])
        single = _rms(signals[0, 0][:, :n] - true[:, :n])
        cells = (f"{x[0]:8.4f} {x[1]:9.2f}    " for x in (differ, error, single))
        print(f"{name:12s} " + " ".join(cells))
        out[name] = (differ, error, single)
    return out


def _signals(found: Vibration) -> dict[str, np.ndarray]:
    """Return velocity and acceleration by method, shape (imu, run, 2, n)."""
    out: dict[str, list[list[np.ndarray]]] = {}
    delay = group_delay(140.0)
    for sensor in found.sensors:
        own: dict[str, list[np.ndarray]] = {}
        for part in sensor.runs:
            ways = baselines(part.piece.run, part.imu, part.found.clock, delay)
            for method, d in ways.items():
                own.setdefault(method, []).append(np.stack([d.velocity[:, 0], d.acceleration[:, 0]]))
            own.setdefault("batch", []).append(np.stack([part.found.velocity, part.found.acceleration]))
        for method, values in own.items():
            out.setdefault(method, []).append(values)
    return {method: np.array(values) for method, values in out.items()}


def _rms(x: np.ndarray) -> np.ndarray:
    return np.sqrt(np.nanmean(x**2, axis=-1)) * DEG


if __name__ == "__main__":
    main()
