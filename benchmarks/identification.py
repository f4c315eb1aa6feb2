"""Identification of the five-axis driller, 43 linear and 15 searched parameters (Table 3-2), without loops and with.

    python -m benchmarks identification [seconds ...] [--open]

A log of each length (12 s by default) at 500 Hz from the virtual machine, whose flexible frame the model lacks; with
the time it took and the most memory the process has had. Before the first a shorter one compiles. The source took
623 s for the whole model of 161 parameters on a 3.6 GHz PC.
"""

from __future__ import annotations

import resource
import sys
import time

import pinotwin as pt
from pinotwin.effects import Coulomb, Ripple, RippleModulated, Stribeck, Viscous
from pinotwin.virtual import VirtualMachine, random_trajectory

SOURCE = 623.0  # s
MUST = {12.0: 10.0, 300.0: 60.0, 1800.0: 360.0}
"""Seconds that a log with closed loops may take, by its length [s]."""


def thesis_machine() -> pt.Machine:
    machine = pt.Machine.load("laser_driller")
    for name, axis in machine.axes.items():
        r = axis.rotary
        effects = [Viscous(name, r), Coulomb(name, r), Stribeck(name, r)]
        if name in "XY":
            effects.append(Ripple(name, r))
        if name in "BC":
            effects.append(RippleModulated(name, r))
        machine = machine.with_effects(name, tuple(effects))
    return machine


def timed(machine: pt.Machine, log: pt.Log, *, loop: bool) -> tuple[float, pt.Twin]:
    start = time.perf_counter()
    twin = pt.identify(machine, log, loop=loop)
    return time.perf_counter() - start, twin


def memory() -> float:
    """Return the most memory that the process has had so far [GB]."""
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size / (1e9 if sys.platform == "darwin" else 1e6)


def main() -> None:
    lengths = [float(x) for x in sys.argv[1:] if not x.startswith("-")] or [12.0]
    virtual = VirtualMachine.load(pt.machines()["laser_driller"])
    machine = thesis_machine()
    loops = (False,) if "--open" in sys.argv else (False, True)
    warm = virtual.record(random_trajectory(virtual, 6.0, 2), seed=2).to_log()
    timed(machine, warm, loop=loops[-1])  # compile
    for length in lengths:
        log = virtual.record(random_trajectory(virtual, length, 1), seed=1).to_log()
        for loop in loops:
            seconds, twin = timed(machine, log, loop=loop)
            shapes = sum(row.kind == "shape" for row in twin.parameters)
            must = f", {seconds / MUST[length]:.2f} of what it may take" if loop and length in MUST else ""
            print(
                f"{length:6.0f} s {'with closed loops' if loop else 'open loop':<18}{seconds:7.1f} s{must}; "
                f"{len(twin.theta)} linear + {shapes} searched + {len(twin.loops)} loops; at most {memory():.1f} GB; "
                f"source {SOURCE:.0f} s: {SOURCE / seconds:.0f} times",
                flush=True,
            )


if __name__ == "__main__":
    main()
