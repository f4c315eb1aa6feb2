"""Speed of the virtual laser driller beside a ``pin.aba`` loop and a ``mj_step`` loop, in one run.

    python -m benchmarks.simulation [seconds]

All three simulate the same five axes at 4 kHz under the same controllers (numba). The virtual
machine also has friction that sticks, ripple, sensors, the bends of X and Y, and four substeps a
period; the other two take one step a period with viscous friction only, which flatters them.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin

from benchmarks._timing import best
from pinotwin.trajectories.moves import Trajectory
from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual import columns as c
from pinotwin.virtual.control import N_STATE, control_step

FOLDER = Path(__file__).resolve().parents[1] / "urdf" / "laser_driller"
PERIOD = 1.0 / 4000.0


def controllers(machine: VirtualMachine, trajectory: Trajectory, n: int):
    """Return a function that gives the efforts of all axes in period ``k`` at positions ``q``."""
    P = machine.tables().P
    qr, vr, ar = trajectory.at(np.arange(n) * PERIOD, machine.axes)
    state = np.zeros((len(machine.axes), N_STATE))
    state[:, 2] = qr[0]

    def efforts(k: int, q: np.ndarray) -> list[float]:
        return [
            control_step(P, i, state, (qr[k, i], vr[k, i], ar[k, i]), q[i], PERIOD) for i in range(len(q))
        ]

    return efforts, qr[0], P[:, c.VISCOUS].copy()


def pinocchio_loop(machine: VirtualMachine, trajectory: Trajectory, n: int) -> float:
    """Return the wall time of ``n`` periods with ``pin.aba`` and semi-implicit Euler [s]."""
    model = machine.model
    data = model.createData()
    efforts, q, viscous = controllers(machine, trajectory, n)
    q, v = q.copy(), np.zeros(model.nv)

    def work() -> None:
        nonlocal q, v
        for k in range(n):
            a = pin.aba(model, data, q, v, np.array(efforts(k, q)) - viscous * v)
            v = v + PERIOD * a
            q = q + PERIOD * v

    return best(work, 1)


def mujoco_loop(machine: VirtualMachine, trajectory: Trajectory, n: int) -> float:
    """Return the wall time of ``n`` periods with ``mj_step`` [s]."""
    text = (FOLDER / "laser_driller.urdf").read_text()
    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", text, flags=re.DOTALL)
    options = '<mujoco><compiler fusestatic="true"/></mujoco>'
    text = re.sub(r"(<robot [^>]*>)", r"\1" + options, text, count=1)
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = PERIOD
    model.dof_frictionloss[:] = 0.0
    model.jnt_limited[:] = 0
    data = mujoco.MjData(model)
    names = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, a) for a in machine.axes]
    efforts, q, viscous = controllers(machine, trajectory, n)
    model.dof_damping[names] = viscous
    data.qpos[names] = q

    def work() -> None:
        for k in range(n):
            data.qfrc_applied[names] = efforts(k, data.qpos[names])
            mujoco.mj_step(model, data)

    return best(work, 1)


def main(seconds: float = 20.0) -> None:
    """Print the table."""
    machine = VirtualMachine.load(FOLDER)
    trajectory = random_trajectory(machine, seconds, 1)
    machine.record(random_trajectory(machine, 1.0, 1), seed=0)  # compile or load the cache
    ours = best(lambda: machine.record(trajectory, seed=0))
    n = int(min(seconds, 5.0) / PERIOD)
    share = seconds / (n * PERIOD)
    rows = {
        "virtual machine, record()": ours,
        "pin.aba loop, numba control": share * pinocchio_loop(machine, trajectory, n),
        "mj_step loop, numba control": share * mujoco_loop(machine, trajectory, n),
    }
    print(f"laser driller, 5 axes (7 joints), {seconds:g} s at 4 kHz")
    for name, wall in rows.items():
        rates = f"{seconds / PERIOD / wall:10.0f} periods/s  {seconds / wall:6.1f} x real time"
        print(f"{name:30s} {wall:7.3f} s  {rates}")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 20.0)
