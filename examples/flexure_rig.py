"""Structural flexibility: chapter 6 and Section 7.2 of the source on the virtual flexure rig, side by side.

python examples/flexure_rig.py [--seconds 20] [--repeats 4]

The rig has CAD inertias that are 10 to 20 % off, two MEMS IMUs with their own clocks, and a truth
that only the last column knows. That truth was laid out after the source's figures: agreement of modes
and friction with its Tables 7-1 and 7-3 is by construction, agreement with the truth is not.
Closed loop and hammer pulses follow in ``flexure_twin.py``.
"""

from __future__ import annotations

import argparse

import numpy as np

import pinotwin as pt
from pinotwin.analysis.modal import modes
from pinotwin.imu.filters import high_passed
from pinotwin.reconstruction import identify_flexible
from pinotwin.trajectories.moves import random_trajectory
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual.imu import record_imu

DEG = 180.0 / np.pi


def record(seconds: float, repeats: int):
    """Run one command with the limits of Table 6-2 so many times: logs and the sealed truth."""
    vm = VirtualMachine.load("urdf/flexure_rig")
    command = random_trajectory(vm, seconds, seed=11)
    runs = [vm.record(command, seed=k, truth_rate=2000.0) for k in range(1, repeats + 1)]
    imus = [[record_imu(r.truth, "C_link", vm.truth.seed, r.seed, number) for r in runs] for number in (1, 2)]
    truth = np.mean([[x[::5] for x in r.truth.joint("delta")] for r in runs], axis=0)
    return [r.to_log() for r in runs], imus, truth, vm.tables().springs[0, :2]


def errors(found: pt.Vibration, truth: np.ndarray) -> tuple[float, float, float]:
    """RMS against the truth: angle above 0.5 Hz [deg], velocity [deg/s], acceleration [deg/s²]."""
    m = found.motion
    fast = [high_passed(m.t, q, 0.5) for q in (m.q, truth[0])]
    gaps = (fast[0] - fast[1], m.v - truth[1], m.a - truth[2])
    angle, velocity, acceleration = (DEG * np.sqrt(np.mean(x**2)) for x in gaps)
    return angle, velocity, acceleration


def apart(found: pt.Vibration) -> tuple[float, ...]:
    """RMS between two IMUs on the first run: angle below and above 0.5 Hz [deg], velocity [deg/s]."""
    one, other = (sensor.runs[0].found for sensor in found.sensors)
    fast = [high_passed(x.t, x.angle, 0.5) for x in (one, other)]
    slow = [x.angle - x.angle.mean() - f for x, f in zip((one, other), fast, strict=True)]
    gaps = (slow[0] - slow[1], fast[0] - fast[1], one.velocity - other.velocity)
    return tuple(DEG * float(np.sqrt(np.mean(x**2))) for x in gaps)


def main(seconds: float = 20.0, repeats: int = 4, effects: pt.Machine | None = None) -> dict:
    """Reconstruct, identify, and print beside the source's tables; return the figures."""
    rig = effects or pt.Machine.load("flexure_rig")
    logs, imus, truth, (k_true, c_true) = record(seconds, repeats)
    one = pt.reconstruct_vibration(rig, logs[0], imus[0][0])
    both = pt.reconstruct_vibration(rig, logs, *imus)
    differ = apart(both)
    rows = {"1 run, 1 IMU": errors(one, truth), f"{repeats} runs, 2 IMUs": errors(both, truth)}

    print("Section 6.5, error against the truth    angle [deg]  velocity [deg/s]  accel. [deg/s²]")
    print(f"{'  source: 22 runs, IMU against IMU':<40}{'± 0.04':>11}{0.0474:>18}{7.33:>17}")
    for name, (angle, velocity, acceleration) in rows.items():
        print(f"  {name:<38}{angle:>11.5f}{velocity:>18.4f}{acceleration:>17.2f}")
    print("Two IMUs differ, run 1: slow angle {:.4f}, dynamic angle {:.5f}, velocity {:.4f}".format(*differ))
    print(f"  {both.verdict}")
    for u in both.unused:
        print(
            f"  {u.predicted} (not used) from {u.fitted}: gyro left {DEG * u.gyro:.3f} deg/s, "
            f"without deflection {DEG * u.gyro_rigid:.3f}, noise {DEG * u.gyro_noise:.3f}"
        )

    rigid = pt.identify(rig.with_rigid_joints(), logs[0], loop=False, consistent=False)
    flexible = identify_flexible(rig, logs[0], one)
    effort = [{n: q["rms"] for n, q in t.quality["axes"].items()} for t in (rigid, flexible.twin)]
    print("Table 7-2, effort error        Y [N]   A [N·m]      source: Y [N]   A [N·m]")
    for name, e, source in zip(
        ("rigid", "flexible"), effort, ((8.786, 0.1314), (2.771, 0.1050)), strict=True
    ):
        print(f"  {name:<24}{e['Y']:>10.3f}{e['A']:>10.4f}{source[0]:>19.3f}{source[1]:>10.4f}")
    k, c = flexible.stiffness, flexible.damping
    print("The spring, which the source leaves implicit (truth in brackets)")
    print(f"  stiffness {k.value:.0f} ± {k.error:.0f} N·m/rad ({k_true:.0f})")
    print(f"  damping   {c.value:.2f} ± {c.error:.2f} N·m·s/rad ({c_true:.2f})")
    held, free = modes(flexible.twin)[0], modes(flexible.twin, locked=["A", "C"])[0]
    print(
        f"  modes: motors held {held.frequency:.2f} Hz, damping {held.damping:.3f} (tap test 20 Hz; "
        f"Table 7-3: 19.5 Hz, 0.054); Y free {free.frequency:.2f} Hz (34.6 Hz); the rig is built to have these"
    )
    return {
        "rows": rows,
        "differ": differ,
        "effort": effort,
        "k": k.value / k_true,
        "c": c.value / c_true,
        "held": held.frequency,
        "free": free.frequency,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--repeats", type=int, default=4)
    given = parser.parse_args()
    main(given.seconds, given.repeats)
