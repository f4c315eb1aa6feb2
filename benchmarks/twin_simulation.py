"""Closed-loop simulation of the five-axis driller: times real time, beside MuJoCo and Pinocchio.

    python benchmarks/twin_simulation.py [--seconds 20] [--long 1800]

All in one run, one thread, CPU time, best of three: the twin on a log at 1 kHz with the internal step that
it chooses (dry friction, ripple, five closed loops, full coupling); MuJoCo's ``mj_step`` and a loop over
``pin.aba``, both at 1 ms with the rigid body alone and a P-PI in Python. Then the cost of long logs.
"""

from __future__ import annotations

import argparse
import functools
import resource
import sys
import time
from pathlib import Path

import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks._timing import best
from pinotwin.dynamics.parameters import with_parameters
from pinotwin.simulation import respond, simulate
from tests.simulated import known_twin, plain_machine, smooth_command

cpu = functools.partial(best, clock=time.process_time)


def gains(twin):  # type: ignore[no-untyped-def]
    """Return kp, kv, 1/ti of every joint."""
    laws = {twin.machine.axes[n].index: c.cascade() for n, c in twin.servos.items()}
    return (np.array([laws[j][k] for j in range(len(laws))]) for k in ("kp", "kv", "rate"))


def pinocchio_loop(twin, qr, step):  # type: ignore[no-untyped-def]
    """Return a function that steps pin.aba and a P-PI, semi-implicit Euler."""
    model = with_parameters(twin.machine.model, twin.pi)
    data = model.createData()
    kp, kv, ki = gains(twin)

    def run() -> None:
        q, v, total = qr[0].copy(), np.zeros(model.nv), np.zeros(model.nv)
        for target in qr:
            w = kp * (target - q) - v
            total += step * w
            v = v + step * pin.aba(model, data, q, v, kv * (w + ki * total))
            q = q + step * v

    return run


def mujoco_loop(twin, qr, step):  # type: ignore[no-untyped-def]
    """Return a function that steps mj_step and a P-PI, or None without MuJoCo."""
    try:
        import mujoco
    except ImportError:
        return None
    text = Path(twin.machine.urdf).read_text(encoding="utf-8")
    head = '<mujoco><compiler fusestatic="true" balanceinertia="false"/></mujoco>'
    text = text.replace("</robot>", head + "</robot>")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = step
    data = mujoco.MjData(model)
    order = [
        mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, twin.machine.model.names[j + 1])
        for j in range(twin.machine.nv)
    ]
    kp, kv, ki = gains(twin)

    def run() -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[order] = qr[0]
        total = np.zeros(len(order))
        for target in qr:
            w = kp * (target - data.qpos[order]) - data.qvel[order]
            total += step * w
            data.qfrc_applied[order] = kv * (w + ki * total)
            mujoco.mj_step(model, data)

    return run


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--long", type=float, default=1800.0, help="longest log [s]")
    args = parser.parse_args()
    twin = known_twin(plain_machine("laser_driller"))
    log = smooth_command(twin.machine, args.seconds, 1000.0)
    qr = np.zeros((len(log), twin.machine.nv))
    for name, axis in twin.machine.axes.items():
        qr[:, axis.index] = log[f"{name}.qr"]
    say = sys.stdout.write
    start = time.process_time()
    simulate(twin, log)
    say(f"first call (compiled or from cache): {time.process_time() - start:.2f} s\n")
    steps = respond(twin, log, full=False).substeps
    rows = [(f"twin, {1.0 / steps:.3g} ms steps", cpu(lambda: simulate(twin, log)), float(steps))]
    share = max(len(qr) // 5, 10)  # the loops in Python run a fifth of the log
    pieces = qr[:share]
    rows.append(("pin.aba in Python, 1 ms", cpu(pinocchio_loop(twin, pieces, 1e-3)) * len(qr) / share, 1.0))
    mujoco = mujoco_loop(twin, pieces, 1e-3)
    if mujoco is not None:
        rows.append(("mj_step in Python, 1 ms", cpu(mujoco) * len(qr) / share, 1.0))
    for name, seconds, count in rows:
        say(
            f"{name:<26}{args.seconds / seconds:8.0f} x real time"
            f"{seconds / (len(qr) * count) * 1e6:9.2f} us a step\n"
        )
    for length in (args.long / 16, args.long / 4, args.long):
        long = smooth_command(twin.machine, length, 1000.0)
        seconds = cpu(lambda log=long: simulate(twin, log), 1)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        say(
            f"{length:7.0f} s of log: {seconds:7.2f} s, {seconds / length * 1e3:.2f} ms a second, "
            f"peak memory {peak:.0f} MB\n"
        )


if __name__ == "__main__":
    main()
