"""Bodies of real robots: masses over the URDF's, and unseen torque beside that of plain least squares.

    python -m benchmarks bodies [LWR4 Panda KR300 TX40 UR10] [--dummies] [--quick]

Every split is fitted on one part of the recordings and judged on the other. `free` is the same fit without bodies
(`--inconsistent`), `floor` is :mod:`benchmarks._plain`, `best` the least error at any weight of the URDF.
Masses are over the URDF's, the centre is in units of the URDF's box of equal inertia (1: its wall), the price is
what `identify` itself says. With ``--dummies`` all inertials are 1 kg and masses still compared with the URDF's; with
``--quick`` `best` is not searched. The spread is that of the same body's mass over the fits of one robot.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

import pinotwin as pt
from benchmarks._plain import plain_error, share_of_torque
from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import parameters, pseudo_inertia, with_parameters
from pinotwin.identification.settings import USUAL
from pinotwin.machine.from_model import with_bodies

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("PINOTWIN_DATA", ROOT.parent / "shared" / "data"))
WEIGHTS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
MUST = {"mass": (0.3, 3.0), "centre": 1.0, "best": 1.035}
FLOOR = {"LWR4": 1.07, "Panda": 1.07}
"""Unseen error over the floor's, for the same kind of motion; 1 for others, 0.4 for another motion."""


@dataclass(frozen=True)
class Split:
    """Logs to fit, the one to judge on, and whether that is another kind of motion."""

    name: str
    machine: pt.Machine
    fitted: Sequence[pt.Log]
    judged: pt.Log
    other: bool = False


def lwr4() -> Iterator[Split]:
    folder = DATA / "kuka_lwr4"
    machine = pt.Machine.load(folder)
    logs = {k: pt.read(folder / f"measurements_{k}.csv") for k in (1, 2, 3)}
    for fitted, judged in (((2, 3), 1), ((1, 3), 2), ((1, 2), 3), ((3,), 1), ((3,), 2), ((1,), 2), ((2,), 3)):
        name = f"{','.join(map(str, fitted))} > {judged}"
        yield Split(name, machine, [logs[k] for k in fitted], logs[judged], judged == 3)
    # Its base leans by one degree: gravity pulls on the upright first axis as a sine of its angle.
    leaning = machine.listing({"lwr_0": ["geometric_error"]})
    for fitted, judged in (((2, 3), 1), ((1, 2), 3), ((1,), 2)):
        name = f"{','.join(map(str, fitted))} > {judged} leaning"
        yield Split(name, leaning, [logs[k] for k in fitted], logs[judged], judged == 3)


def panda() -> Iterator[Split]:
    folder = DATA / "franka_panda"
    yield from _parts(pt.Machine.load(folder), pt.read(folder / "exciting_traj.csv"), (0.6, -0.6, 0.5, -0.5))


def tx40() -> Iterator[Split]:
    folder = DATA / "staubli_tx40"
    log = pt.read(folder / "pos_read_data.csv", folder / "curr_data.csv")
    yield from _parts(pt.Machine.load("tx40"), log, (0.5, -0.5, 0.6))


def kr300() -> Iterator[Split]:
    machine = pt.Machine.load(ROOT / "examples" / "machines" / "kr300")
    log = pt.read(DATA / "kuka_kr300" / "FF_A_08ms.mat")
    yield from _parts(machine, log, (0.6, -0.6, 0.5))
    # The hydraulic counterbalance of axis 2 is a sine of its angle.
    balanced = machine.listing({"A2": ["geometric_error"]})
    yield from _parts(balanced, log, (0.6, -0.6), " balanced")


def ur10() -> Iterator[Split]:
    machine = pt.Machine.load("ur10")
    machine = machine.listing({name: ["offset"] for name in machine.axes})
    log = pt.read(DATA / "ur10_rosbag" / "ur10_exciting_trajectory.db3")
    yield from _parts(machine, log, (0.6, -0.6, 0.5))


def _parts(machine: pt.Machine, log: pt.Log, shares: Sequence[float], more: str = "") -> Iterator[Split]:
    """Yield the first share of a log to fit, or the last where it is negative, and the rest to judge on."""
    for share in shares:
        cut = int((share if share > 0.0 else 1.0 + share) * len(log))
        first, last = log.rows(slice(0, cut)), log.rows(slice(cut, None))
        fitted, judged = (first, last) if share > 0.0 else (last, first)
        yield Split(f"{'first' if share > 0.0 else 'last'} {abs(share):.0%}{more}", machine, [fitted], judged)


ROBOTS = {"LWR4": lwr4, "Panda": panda, "KR300": kr300, "TX40": tx40, "UR10": ur10}


def unseen(twin: pt.Twin, log: pt.Log) -> float:
    """Return the error of a twin's torque on a log, over the torque."""
    motion = twin.motion(log)
    return share_of_torque(motion, motion.u - twin.effort(motion))


def centres(machine: pt.Machine, pi: Floats) -> Floats:
    """Return how far each centre is from the URDF's, over half the box that has the URDF's inertia, shape (bodies,)."""
    count = machine.model.njoints - 1
    out = []
    for p, p0 in zip(
        *(x[: 10 * count].reshape(-1, 10) for x in (pi, parameters(machine.model))), strict=True
    ):
        centre = p0[1:4] / p0[0]
        spread, axes = np.linalg.eigh(pseudo_inertia(p0)[:3, :3] / p0[0] - np.outer(centre, centre))
        half = np.sqrt(3.0 * np.maximum(spread, 1e-12))
        out.append(np.max(np.abs(axes.T @ (p[1:4] / p[0] - centre)) / half))
    return np.array(out)


def dummies(machine: pt.Machine) -> pt.Machine:
    """Return the machine with bodies of 1 kg at their joints."""
    pi, one = parameters(machine.model), pin.Inertia(1.0, np.zeros(3), 0.01 * np.eye(3)).toDynamicParameters()
    count = machine.model.njoints - 1
    pi[: 10 * count] = np.tile(one, count)
    return with_bodies(machine, with_parameters(machine.model, pi))


def judged(robot: str, split: Split, *, dummy: bool, quick: bool) -> Floats:
    """Print one row; return the masses over the URDF's, shape (bodies,)."""
    machine = dummies(split.machine) if dummy else split.machine
    free = unseen(pt.identify(machine, split.fitted, loop=False, consistent=False), split.judged)
    start = time.process_time()
    twin = pt.identify(machine, split.fitted, loop=False)
    seconds = time.process_time() - start
    error, plain = unseen(twin, split.judged), plain_error(twin, split.fitted, split.judged)
    tried = [
        unseen(pt.identify(machine, split.fitted, loop=False, settings=settings), split.judged)
        for settings in (replace(USUAL, urdf_rows=(w,), other_rows=()) for w in (() if quick else WEIGHTS))
    ]
    ratio = (
        twin.pi[: 10 * len(twin.bodies) : 10] / parameters(split.machine.model)[: 10 * len(twin.bodies) : 10]
    )
    place, best = centres(split.machine, twin.pi).max(), error / min([error, *tried])
    price = twin.quality["consistency"]
    limit = 0.4 if split.other else FLOOR.get(robot, 1.0)
    missed = [
        word
        for word, bad in (
            ("mass", ratio.min() < MUST["mass"][0] or ratio.max() > MUST["mass"][1]),
            ("centre", place > MUST["centre"]),
            ("best", best > MUST["best"]),
            ("floor", error / plain > limit),
        )
        if bad and not (dummy and word in ("mass", "centre"))
    ]
    own = f"{price['unseen_over_free']:6.3f} {price['unseen_over_best']:6.3f}"
    print(
        f"{robot + ' ' + split.name:<28}{free:7.2%}{error / free:7.3f}{error / plain:7.3f}{best:7.3f}"
        f"{ratio.min():7.2f}{ratio.max():6.2f}{place:7.2f}   {own}{price['urdf_rows']:5.0f}{seconds:6.2f}  "
        + (f"missed: {', '.join(missed)}" if missed else ""),
        flush=True,
    )
    return np.asarray(ratio)


def main() -> None:
    """Print a row a split, and the spread of each robot's masses."""
    named = [name for name in ROBOTS if name in sys.argv[1:]] or list(ROBOTS)
    print(
        f"{'':28}{'free':>7}{'/free':>7}{'/floor':>7}{'/best':>7}{'masses':>13}{'centre':>7}   "
        f"{'price':>6} {'':6}{'rows':>5}{'CPU s':>6}"
    )
    for robot in named:
        flags = {"dummy": "--dummies" in sys.argv, "quick": "--quick" in sys.argv}
        found = np.array([judged(robot, split, **flags) for split in ROBOTS[robot]()])
        spread = ", ".join(f"{x:.2f}" for x in found.max(axis=0) / found.min(axis=0))
        print(f"{robot}: largest over smallest mass of each body: {spread}")


if __name__ == "__main__":
    main()
