"""Clocks, gyro scale and alignment of an IMU over random mountings, against the sealed truth.

python -m benchmarks.imu_mountings [--cases 50] [--seconds 20] [--command lively] [--rough] [--each]

Every case has its own command, mounting, place, clock (offset, skew, jitter, 1 % of the samples
lost, a hole of 0.2 s), tilted foundation and errors of the sensor (Tables 6-3, 6-4 and B-1). What is
asked: clock within 0.05 ms and 3 ppm, gyro scale within 2e-4, alignment within 0.05 deg, each inside
its stated interval. How well the scale is known depends on how much every axis turns: "lively" goes
from move to move, "drilling" dwells and often moves one axis alone. "rough" has a joint with
hysteresis and hardening. The same sensors then see logs that cannot tell: nothing turns, only the
vertical axis turns, the machine stands. Those must be refused.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.vibration import rig as rough_rig
from pinotwin.errors import InputError
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.reconstruction import reconstruct_vibration
from pinotwin.trajectories.moves import Trajectory, random_trajectory
from pinotwin.trajectories.profiles import chain
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual.imu import channels, link_motion, sensor
from pinotwin.virtual.imu_sensor import GRAVITY, ImuSensor
from pinotwin.virtual.recording import Recording

DEG = np.pi / 180.0
LINK = "C_link"
FAULTS = {"drop": 0.01, "holes": ((8.0, 8.2),)}
TILT = 3.0 * DEG
SILENT: Mapping[str, tuple[str, ...]] = {
    "nothing turns": ("Y",),
    "only the vertical axis turns": ("C",),
    "it stands": (),
}
"""Logs that do not say how the IMU sits, and the axes that move in them."""

COMMANDS: Mapping[str, Any] = {
    "lively": {"synchronised": 0.0, "dwell": (0.02, 0.1)},
    "drilling": {},
}

LIMITS = {"clock": 0.05, "skew": 3.0, "scale": 2e-4, "mounting": 0.05, "upward": 0.05}
UNITS = {"clock": "ms", "skew": "ppm", "scale": "-", "mounting": "deg", "upward": "deg"}


@dataclass(frozen=True)
class Outcome:
    """Errors and their stated standard deviations by quantity, in UNITS; arrays (k,)."""

    error: Mapping[str, np.ndarray]
    sd: Mapping[str, np.ndarray]


@cache
def rig() -> tuple[Machine, VirtualMachine]:
    return Machine.load("flexure_rig"), VirtualMachine.load("urdf/flexure_rig")


def mounted(case: int) -> ImuSensor:
    """Return the sensor of a case on a foundation that is tilted by up to 3 deg."""
    rng = np.random.default_rng([case, 3])
    lean = rng.uniform(0.0, TILT) * np.array([*_unit(rng.normal(size=2)), 0.0])
    gravity = Rotation.from_rotvec(lean).apply(GRAVITY)
    return replace(sensor(7000 + case, 1 + case % 2, case, **FAULTS), gravity=gravity)


def _unit(x: np.ndarray) -> np.ndarray:
    return x / np.linalg.norm(x)


def read(own: ImuSensor, recording: Recording, case: int) -> Log:
    """Return the IMU's log of a recording."""
    rng = np.random.default_rng([case, 4])
    return Log(channels(own.measure(link_motion(recording.truth, LINK), rng)), source="imu")


def moving(axes: Sequence[str], seconds: float, command: int) -> Trajectory:
    """Return a random command in which only some axes move."""
    _, vm = rig()
    whole = random_trajectory(vm, seconds, command)
    still = {n: chain(float(p(np.zeros(1), 0)[0]), []) for n, p in whole.profiles.items() if n not in axes}
    return replace(whole, profiles={**whole.profiles, **still})


def study(
    case: int, seconds: float = 20.0, command: str = "lively", vm: VirtualMachine | None = None
) -> Outcome:
    """Return what is found for one random mounting and clock, less the truth."""
    machine, vm = rig()[0], vm or rig()[1]
    moves = random_trajectory(vm, seconds, 100 + case, **COMMANDS[command])
    recording = vm.record(moves, seed=100 + case, truth_rate=4000.0)
    own = mounted(case)
    found = reconstruct_vibration(machine, recording.to_log(), read(own, recording, case))
    batch, run = found.sensors[0].batch, found.sensors[0].runs[0].found
    s, c = run.clock.segments[0], own.clock
    turn = Rotation.from_matrix(batch.R_ST @ own.mounting).as_rotvec()
    g, g_se = batch.shared("gravity")
    size = np.linalg.norm(own.gravity)
    error = {
        "clock": 1e3 * np.array([s.at_pivot - (c.offset + (1.0 + c.skew) * s.pivot)]),
        "skew": 1e6 * np.array([run.clock.skew - c.skew]),
        "scale": run.scale - own.gyro.scale,
        "mounting": turn / DEG,
        "upward": (g - own.gravity)[:2] / size / DEG,
    }
    sd = {
        "clock": 1e3 * np.array([s.se]),
        "skew": 1e6 * np.array([run.clock.se_skew]),
        "scale": run.scale_se,
        "mounting": np.sqrt(np.diag(batch.R_ST_cov)) / DEG,
        "upward": g_se[:2] / size / DEG,
    }
    return Outcome(error, sd)


@cache
def silent(kind: str, seconds: float = 8.0) -> Recording:
    """Return the recording of a log that cannot tell how the IMU sits."""
    _, vm = rig()
    return vm.record(moving(SILENT[kind], seconds, 5), seed=5, truth_rate=2000.0)


def refusal(case: int, kind: str) -> str | None:
    """Return the message with which a log is refused that cannot tell; None if it is not."""
    recording = silent(kind)
    log = recording.to_log()
    try:
        reconstruct_vibration(rig()[0], log, read(mounted(case), recording, case))
    except InputError as error:
        return str(error)
    return None


def table(outcomes: Sequence[Outcome]) -> str:
    """Return worst and RMS error, their limit, and the share of 95 % intervals with the truth."""
    lines = [f"{'':<10}{'worst':>11}{'RMS':>11}{'limit':>9}      failed   in 95 %   RMS z   worst z"]
    for name, limit in LIMITS.items():
        x = summary(name, outcomes)
        failed = f"{x.failed:.0f}/{len(outcomes)}"
        lines.append(
            f"{name:<10}{x.worst:>11.3g}{x.rms:>11.3g}{limit:>9.3g} {UNITS[name]:<4} {failed:>8}"
            f"{x.held / x.of:>11.1%}{x.z_rms:>8.2f}{x.z_worst:>9.1f}"
        )
    return "\n".join(lines)


@dataclass(frozen=True)
class Summary:
    """Errors of one quantity over all cases: worst and RMS in UNITS, cases beyond LIMITS, 95 % intervals that hold."""

    worst: float
    rms: float
    failed: int
    held: int
    of: int
    z_rms: float
    z_worst: float


def summary(name: str, outcomes: Sequence[Outcome]) -> Summary:
    """Return what is said of one quantity."""
    turned = name in ("mounting", "upward")
    each = [np.linalg.norm(o.error[name]) if turned else np.abs(o.error[name]).max() for o in outcomes]
    z = np.abs(np.concatenate([o.error[name] / o.sd[name] for o in outcomes]))
    every = np.concatenate([o.error[name] for o in outcomes])
    return Summary(
        worst=float(max(each)),
        rms=float(np.sqrt(np.mean(every**2))),
        failed=int(np.sum(np.array(each) > LIMITS[name])),
        held=int(np.sum(z < 1.96)),
        of=len(z),
        z_rms=float(np.sqrt(np.mean(z**2))),
        z_worst=float(z.max()),
    )


def outcomes_of(cases: int, seconds: float, command: str, rough: bool, each: bool = False) -> list[Outcome]:
    """Return what is found in each case, printed if ``each``; ``rough``: hysteresis and hardening in the joint."""
    vm = rough_rig(0.05, 0.10) if rough else None
    out = []
    for case in range(cases):
        out.append(one := study(case, seconds, command, vm))
        if each:
            pairs = (f"{n} {e.round(5)} z {(e / one.sd[n]).round(1)}" for n, e in one.error.items())
            print(case, *pairs, flush=True)
    return out


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--command", choices=tuple(COMMANDS), default="lively")
    parser.add_argument("--rough", action="store_true", help="hysteresis, hardening")
    parser.add_argument("--each", action="store_true", help="print every case")
    args, _ = parser.parse_known_args()
    start = time.perf_counter()
    outcomes = outcomes_of(args.cases, args.seconds, args.command, args.rough, args.each)
    print(table(outcomes))
    print(f"{args.cases} cases of {args.seconds:g} s: {time.perf_counter() - start:.0f} s")
    for kind in SILENT:
        said = [refusal(case, kind) for case in range(args.cases)]
        print(f"{kind}: refused {sum(x is not None for x in said)} of {len(said)}; {said[0]}")


if __name__ == "__main__":
    main()
