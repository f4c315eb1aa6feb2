"""Time of one diagnosis beside what it may take.

    python -m benchmarks diagnosis [arm] [five] [--stages]

``arm``: 25 s of a robot of seven axes at 250 Hz against its twin. ``five``: 24 s of five axes at 500 Hz, two repeats,
the whole catalogue. The second run of each counts: numba has compiled by then. ``--stages`` says where the time goes.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

import pinotwin as pt
from pinotwin.diagnosis import diagnose
from pinotwin.machine.bundled import machines
from pinotwin.virtual import VirtualMachine, random_trajectory


@dataclass(frozen=True)
class Case:
    """A diagnosis to be timed.

    Attributes:
        what: in words.
        must: seconds that it may take. aim: seconds that it should.
        make: returns subject, logs and validation logs.
    """

    what: str
    must: float
    aim: float
    make: Callable[[], tuple[Any, list[Any], list[Any] | None]]


def arm() -> tuple[Any, list[Any], list[Any] | None]:
    """Return the twin of a robot of seven axes and a later log, in which one axis has twice its viscous friction."""
    machine = pt.Machine.load("panda")
    axes = list(machine.axes)[:7]
    machine = pt.Machine.from_model(machine.model, axes, name="arm")
    healthy = np.full(len(axes), 2.0)
    worn = np.where(np.arange(len(axes)) == 3, 4.0, healthy)
    logs = [_moved(machine, seed, viscous) for seed, viscous in ((1, healthy), (2, worn))]
    return pt.identify(machine, logs[0], loop=False), [logs[1]], None


def _moved(
    machine: pt.Machine, seed: int, viscous: np.ndarray, seconds: float = 25.0, rate: float = 250.0
) -> pt.Log:
    """Return a log of sines that no two axes share, by rigid-body dynamics, friction and noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / rate)
    n = machine.nv
    q, v, a = np.zeros((3, len(t), n))
    for j in range(n):
        for k in range(4):
            w, phase = 2.0 * np.pi * (0.1 + 0.17 * k + 0.013 * j), rng.uniform(0.0, 2.0 * np.pi)
            size = 0.35 / (k + 1)
            q[:, j] += size * np.sin(w * t + phase)
            v[:, j] += size * w * np.cos(w * t + phase)
            a[:, j] -= size * w * w * np.sin(w * t + phase)
    data = machine.model.createData()
    u = np.array([pin.rnea(machine.model, data, *x) for x in zip(q, v, a, strict=True)])
    u += viscous * v + 1.0 * np.tanh(v / 0.01)
    u += 0.02 * u.std(axis=0) * rng.normal(size=u.shape)
    channels = {"t": t}
    for axis in machine.axes.values():
        channels |= {f"{axis.name}.q": q[:, axis.index], f"{axis.name}.u": u[:, axis.index]}
    return pt.Log(channels, source=f"arm {seed}")


def five() -> tuple[Any, list[Any], list[Any] | None]:
    """Return a machine whose model lacks a flexible frame, and two repeats."""
    virtual = VirtualMachine.load(machines()["laser_driller"], withhold=["joint_flexibility"])
    path = random_trajectory(virtual, 24.0, 3)
    return pt.Machine.load("laser_driller"), [virtual.record(path, seed=s).to_log() for s in (1, 2)], None


CASES = {
    "arm": Case("one diagnosis, 7-axis robot, 25 s at 250 Hz [s]", 10.0, 5.0, arm),
    "five": Case("one diagnosis, five axes, 24 s at 500 Hz, two repeats [s]", 25.0, 12.0, five),
}


def timed(case: Case, *, stages: bool = False) -> float:
    """Return the time of the second of two diagnoses [s]."""
    subject, logs, validation = case.make()
    seconds = 0.0
    for k in range(2):
        start = last = time.perf_counter()
        stage = "start"

        def report(name: str, done: float, k: int = k) -> None:
            nonlocal last, stage
            now = time.perf_counter()
            if stages and k:
                print(f"{now - last:8.2f} s  {stage}")
            last, stage = now, name
            del done

        found = diagnose(subject, logs, validate=validation, report=report)
        report("end", 1.0)
        seconds = time.perf_counter() - start
    print(f"{seconds:8.2f} s  {case.what}: {found.sentence}")
    return seconds


def main() -> None:
    """Time the cases that are named, all by default."""
    named = [w for w in sys.argv[1:] if w in CASES]
    for name in named or CASES:
        case = CASES[name]
        seconds = timed(case, stages="--stages" in sys.argv)
        print(
            f"{name}: {seconds / case.must:.2f} of what it may take, {seconds / case.aim:.2f} of what it should"
        )


if __name__ == "__main__":
    main()
