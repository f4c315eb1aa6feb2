"""Accuracy of the reconstructed vibration against the sealed truth of the virtual flexure rig.

python benchmarks/vibration.py [--seeds N] [--runs 22] [--seconds 20]

Single runs: the plain joint, one with hysteresis and hardening that the estimator does not know.
Then so many repeats with two IMUs. CAD inertias are 10 to 20 % off throughout.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from pinotwin.imu.reconstruct import high_passed
from pinotwin.machine import Machine
from pinotwin.reconstruction import Settings, Vibration, reconstruct_vibration
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual.imu import record_imu, sensor
from pinotwin.virtual.trajectories import random_trajectory

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


def show(name: str, e: dict[str, float], extra: str = "") -> None:
    print(
        f"{name:<24} angle {e['angle']:.5f} of {e['of']:.5f} deg  velocity {e['velocity']:.4f} "
        f"deg/s  acceleration {e['acceleration']:.2f} deg/s²  slow {e['slow']:.5f} of "
        f"{e['slow_of']:.5f}  {extra}"
    )


def single(machine: Machine, vm, name: str, seed: int, seconds: float) -> None:
    log, imu, true = run(vm, seed, seed, seconds)
    found = reconstruct_vibration(machine, log, imu[0], settings=Settings(methods=False))
    e = errors(found, true)
    part, own = found.sensors[0].runs[0].found, sensor(vm.truth.seed, 1, seed)
    z_scale = (part.scale - own.gyro.scale) / part.scale_se
    s = part.clock.segments[0]
    at = own.clock.offset + (1 + own.clock.skew) * s.pivot
    show(
        f"{name} {seed}",
        e,
        f"f {found.frequency[0]:.2f} zeta {found.damping[0]:.4f} slow sd "
        f"{part.quasi_static_sd * DEG:.5f} scale {np.abs(part.scale - own.gyro.scale).max():.1e} "
        f"(z {np.abs(z_scale).max():.1f}) clock {1e6 * (s.at_pivot - at):+.0f} us (se "
        f"{1e6 * s.se:.0f}) skew {1e6 * (part.clock.skew - own.clock.skew):+.1f} ppm (se "
        f"{1e6 * part.clock.se_skew:.1f})",
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--runs", type=int, default=22)
    parser.add_argument("--seconds", type=float, default=20.0)
    args, _ = parser.parse_known_args()
    machine = Machine.load("flexure_rig")
    plain, rough = rig(), rig(0.05, 0.10)
    for seed in range(1, args.seeds + 1):
        single(machine, plain, "plain", seed, args.seconds)
    for seed in range(1, args.seeds + 1):
        single(machine, rough, "hysteresis, hardening", seed, args.seconds)
    for name, vm in (("plain", plain), ("hysteresis", rough)):
        if args.runs < 2:
            break
        start = time.perf_counter()
        runs = [run(vm, 3, seed, args.seconds, 2) for seed in range(1, args.runs + 1)]
        true = np.mean([r[2] for r in runs], axis=0)
        found = reconstruct_vibration(
            machine, [r[0] for r in runs], [r[1][0] for r in runs], [r[1][1] for r in runs]
        )
        took = time.perf_counter() - start
        show(f"{name}, {args.runs} runs, 2 IMUs", errors(found, true), f"{took:.0f} s")
        for u in found.unused:
            print("   ", u)
        for m in found.methods:
            print(f"    {m.method:<12} IMUs differ by", " ".join(f"{x * DEG:.4g}" for x in m.differ))


if __name__ == "__main__":
    main()
