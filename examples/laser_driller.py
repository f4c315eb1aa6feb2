"""The five-axis laser driller of Sections 3.4 and 4.3.1: open loop, closed loop, and what coupling costs.

Run: .venv/bin/python examples/laser_driller.py. The log comes from the virtual driller (every effect of
Section 3.2, X and Y with a 29 Hz mode); the source's figures are from the real machine in Wang (2023).
"""

from __future__ import annotations

import time

import numpy as np

import pinotwin as pt
from pinotwin.identification.studies import coupled_against_decoupled
from pinotwin.virtual import VirtualMachine, random_trajectory


def record(seconds: float, seed: int) -> pt.Log:
    """Return a log of the virtual driller in a drilling cycle."""
    virtual = VirtualMachine.load(pt.machines()["laser_driller"])
    path = random_trajectory(virtual, seconds, seed, dwell=(0.0, 0.1), synchronised=0.3)
    return virtual.record(path, seed=seed).to_log()


def closed_loop_errors(log: pt.Log, twin: pt.Twin) -> dict[str, float]:
    """Return RMS error over RMS magnitude of every e and u, simulated from the command alone."""
    predicted = twin.simulate(log)
    out = {}
    for axis in twin.machine.axes:
        measured = {"e": log[f"{axis}.qr"] - log[f"{axis}.q"], "u": log[f"{axis}.u"]}
        for signal, x in measured.items():
            error = predicted[f"{axis}.{signal}"] - x
            out[f"{axis}.{signal}"] = float(np.sqrt(np.mean(error**2) / np.mean(x**2)))
    return out


def main(seconds: float = 20.0) -> dict[str, float]:
    """Identify, predict, compare with the source, print the tables."""
    log, unseen = record(seconds, 1), record(12.0, 2)
    machine = pt.Machine.load("laser_driller")
    start = time.perf_counter()
    twin = pt.identify(machine, log, validate=unseen)
    took = time.perf_counter() - start
    shapes = sum(row.kind == "shape" for row in twin.parameters)
    numbers = len(twin.theta) + shapes
    print(
        f"{numbers} parameters of the plant ({shapes} searched) and {len(twin.loops)} loops: {took:.1f} s"
    )
    print("source: 161 parameters in all, 623 s\n")
    open_loop = twin.quality["relative_error"]
    print(f"open loop, normalised 2-norm of the effort error: {open_loop:.2%} (source 3.4 %)")
    for name, row in coupled_against_decoupled(machine, log).axes.items():
        with_, without = row.coupled_error["nrmse"], row.decoupled_error["nrmse"]
        print(f"  {name}: with coupling {with_:.2%}, left out {without:.2%}")
    errors = {"fitted": closed_loop_errors(log, twin), "unseen": closed_loop_errors(unseen, twin)}
    print("\nclosed loop, from the command alone: RMS error over RMS magnitude")
    for name in errors["fitted"]:
        print(
            f"  {name}  fitted {errors['fitted'][name]:7.2%}   unseen {errors['unseen'][name]:7.2%}"
        )
    means = {name: float(np.mean(list(row.values()))) for name, row in errors.items()}
    print(f"mean: fitted {means['fitted']:.2%} (source 2.38 %), unseen {means['unseen']:.2%}")
    return means


if __name__ == "__main__":
    main()
