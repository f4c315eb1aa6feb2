"""Accuracy of the reconstructed vibration against the sealed truth of the virtual flexure rig.

python -m benchmarks vibration [--seeds 5] [--runs 22] [--seconds 20]

Single runs: the plain joint, one with hysteresis and hardening that the estimator does not know.
Then so many repeats with two IMUs. CAD inertias are 10 to 20 % off throughout.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from benchmarks._imu_methods import methods
from pinotwin.imu.filters import high_passed
from pinotwin.machine import Machine
from pinotwin.reconstruction import Vibration, reconstruct_vibration
from pinotwin.trajectories.moves import random_trajectory
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual.imu import record_imu, sensor

DEG = 180.0 / np.pi
FAULTS = {"drop": 0.01, "holes": ((8.0, 8.2),)}


def rig(hysteresis: float = 0.0, hardening: float = 0.0) -> VirtualMachine:
    """The virtual rig; shares of the spring's torque at the largest deflection of 0.03 deg."""
    from pinotwin.virtual.folder import read_folder

    folder = read_folder("urdf/flexure_rig")
    peak, k = 0.03 / DEG, 61490.0
    spring = replace(
        folder.truth.passive["delta"],
        hardening=hardening * k / peak**2,
        hysteresis=hysteresis * k * peak,
        hysteresis_width=0.2 * peak,
    )
    return VirtualMachine.build(replace(folder, truth=replace(folder.truth, passive={"delta": spring})))


def run(vm, command: int, seed: int, seconds: float, imus: int = 1):
    recording = vm.record(random_trajectory(vm, seconds, command), seed=seed, truth_rate=4000.0)
    imu = [record_imu(recording.truth, "C_link", vm.truth.seed, seed, k + 1, **FAULTS) for k in range(imus)]
    true = np.stack([x[::10] for x in recording.truth.joint("delta")])
    return recording.to_log(), imu, true


def errors(found: Vibration, true: np.ndarray) -> dict[str, float]:
    """RMS errors in degrees; the angle above 0.5 Hz, and below with its mean removed."""
    m = found.motion
    rms = lambda x: float(np.sqrt(np.mean(x[m.known] ** 2)))  # noqa: E731
    fast = [high_passed(m.t, x, 0.5) for x in (m.q, true[0])]
    slow = [x - x.mean() - f for x, f in zip((m.q, true[0]), fast, strict=True)]
    return {
        "angle": rms(fast[0] - fast[1]) * DEG,
        "of": rms(fast[1]) * DEG,
        "velocity": rms(m.v - true[1]) * DEG,
        "acceleration": rms(m.a - true[2]) * DEG,
        "slow": rms(slow[0] - slow[1]) * DEG,
        "slow_of": rms(slow[1]) * DEG,
    }


def show(name: str, e: Mapping[str, float], extra: str = "") -> None:
    print(
        f"{name:<24} angle {e['angle']:.5f} of {e['of']:.5f} deg  velocity {e['velocity']:.4f} "
        f"deg/s  acceleration {e['acceleration']:.2f} deg/s²  slow {e['slow']:.5f} of "
        f"{e['slow_of']:.5f}  {extra}",
        flush=True,
    )


def single(machine: Machine, vm: VirtualMachine, name: str, seed: int, seconds: float) -> dict[str, float]:
    """Print and return what one run with one IMU is off by: see :func:`errors`; clock [us], skew [ppm], gyro scale."""
    log, imu, true = run(vm, seed, seed, seconds)
    found = reconstruct_vibration(machine, log, imu[0])
    part, own = found.sensors[0].runs[0].found, sensor(vm.truth.seed, 1, seed)
    z_scale = (part.scale - own.gyro.scale) / part.scale_se
    s = part.clock.segments[0]
    at = own.clock.offset + (1 + own.clock.skew) * s.pivot
    e = {
        **errors(found, true),
        "clock": 1e6 * (s.at_pivot - at),
        "skew": 1e6 * (part.clock.skew - own.clock.skew),
        "scale": float(np.abs(part.scale - own.gyro.scale).max()),
    }
    show(
        f"{name} {seed}",
        e,
        f"f {found.frequency[0]:.2f} zeta {found.damping[0]:.4f} slow sd "
        f"{part.quasi_static_sd * DEG:.5f} scale {e['scale']:.1e} "
        f"(z {np.abs(z_scale).max():.1f}) clock {e['clock']:+.0f} us (se "
        f"{1e6 * s.se:.0f}) skew {e['skew']:+.1f} ppm (se "
        f"{1e6 * part.clock.se_skew:.1f})",
    )
    return e


def repeated(machine: Machine, vm: VirtualMachine, name: str, runs: int, seconds: float) -> dict[str, float]:
    """Print and return what the mean of some repeats with two IMUs is off by."""
    start = time.perf_counter()
    made = [run(vm, 3, seed, seconds, 2) for seed in range(1, runs + 1)]
    true = np.mean([r[2] for r in made], axis=0)
    found = reconstruct_vibration(machine, [r[0] for r in made], *([r[1][k] for r in made] for k in (0, 1)))
    e = errors(found, true)
    show(f"{name}, {runs} runs, 2 IMUs", e, f"{time.perf_counter() - start:.0f} s")
    for u in found.unused:
        print(
            f"    {u.predicted} from {u.fitted}: gyro {u.gyro:.5f} rad/s (noise {u.gyro_noise:.5f}, no "
            f"deflection {u.gyro_rigid:.5f}), accelerometer {u.accel:.4f} m/s² (noise {u.accel_noise:.4f}, "
            f"no deflection {u.accel_rigid:.4f})"
        )
    for m in methods(found.sensors):
        print(f"    {m.method:<12} IMUs differ by", " ".join(f"{x * DEG:.4g}" for x in m.differ))
    return e


def compare(seeds: int, runs: int, seconds: float) -> dict[str, list[dict[str, float]]]:
    """Print and return the errors of single runs and of the mean of repeats, by kind of joint."""
    machine, out = Machine.load("flexure_rig"), {}
    joints = {"plain": rig(), "rough": rig(0.05, 0.10)}
    for name, vm in joints.items():
        out[f"{name}_single"] = [single(machine, vm, name, s, seconds) for s in range(1, seeds + 1)]
    for name, vm in joints.items():
        if runs > 1:
            out[f"{name}_mean"] = [repeated(machine, vm, name, runs, seconds)]
    return out


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--runs", type=int, default=22)
    parser.add_argument("--seconds", type=float, default=20.0)
    args, _ = parser.parse_known_args()
    compare(args.seeds, args.runs, args.seconds)


if __name__ == "__main__":
    main()
