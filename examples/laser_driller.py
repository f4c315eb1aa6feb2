"""The five-axis laser driller of Sections 3.4 and 4.3.1: open loop, closed loop, and what coupling costs.

Run: .venv/bin/python examples/laser_driller.py. The log comes from the virtual driller (every effect of
Section 3.2, X and Y with a 29 Hz mode); the source's figures are from the real machine in Wang (2023).
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
import yaml

import pinotwin as pt
from pinotwin.studies.coupling import coupled_against_decoupled
from pinotwin.virtual import VirtualMachine, random_trajectory

SOURCE = {"X": (8, 26), "Y": (8, 26), "Z": (4, 22), "B": (7, 27), "C": (7, 26)}
"""Parameters searched and solved, Table 4-3: 34 + 127 = 161."""
COUPLED = ("Z", "B", "C")


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


def alone(machine: pt.Machine, axis: str, folder: Path) -> pt.Machine:
    """Return the machine as if an axis were on its own, the others standing at zero."""
    source = pt.machines()[machine.name]
    content = yaml.safe_load((source / "machine.yaml").read_text())
    content["axes"] = {axis: content["axes"][axis]}
    content["loop"] = {k: v for k, v in content.get("loop", {}).items() if k == axis}
    content["urdf"] = str((source / f"{machine.name}.urdf").resolve())
    (folder / "machine.yaml").write_text(yaml.safe_dump(content))
    return pt.Machine.load(folder)


def without_coupling(machine: pt.Machine, log: pt.Log, unseen: pt.Log) -> dict[str, float]:
    """Return the errors on the unseen log of models that know one axis each."""
    out: dict[str, float] = {}
    for axis in COUPLED:
        with tempfile.TemporaryDirectory() as folder:
            one = pt.identify(alone(machine, axis, Path(folder)), log)
            out.update(closed_loop_errors(unseen, one))
    return out


def print_counts(twin: pt.Twin) -> None:
    """Print how many numbers were searched and solved, beside Table 4-3 (sums to 161)."""
    shared = sum(row.effect == "rigid_body" for row in twin.parameters)
    print(f"\nparameters searched + solved (source); {shared} rigid-body ones are shared by the axes")
    total = shared
    for axis, loop in twin.loops.items():
        own = [row for row in twin.parameters if row.effect.startswith(f"{axis}.")]
        assert loop.fit is not None
        searched = sum(row.kind == "shape" for row in own) + len(loop.fit.parameters)
        numerators = sum(len(loop.numerator(o, i)[0]) for o in loop.outputs for i in loop.inputs)
        solved = sum(row.kind != "shape" for row in own) + numerators
        total += searched + solved
        print(f"  {axis}: {searched} + {solved}   ({SOURCE[axis][0]} + {SOURCE[axis][1]})")
    print(f"  in all {total}   (161)")


def main(seconds: float = 20.0, unseen_seconds: float = 12.0) -> dict[str, float]:
    """Identify, predict, compare with the source, print the tables."""
    log, unseen = record(seconds, 1), record(unseen_seconds, 2)
    machine = pt.Machine.load("laser_driller")
    start = time.perf_counter()
    twin = pt.identify(machine, log, validate=unseen)
    print(f"identified in {time.perf_counter() - start:.1f} s (source: 623 s)")
    print_counts(twin)
    open_loop = twin.quality["relative_error"]
    print(f"\nopen loop, 2-norm of the effort error: {open_loop:.2%} (source 3.4 %)")
    for name, with_, without, *_ in coupled_against_decoupled(machine, log).rows:
        print(f"  {name}: with coupling {with_:.2%}, left out {without:.2%}")
    fitted, new = closed_loop_errors(log, twin), closed_loop_errors(unseen, twin)
    bare = without_coupling(machine, log, unseen)
    print("\nclosed loop, from the command alone: RMS error over RMS magnitude")
    for name in fitted:
        last = f"   unseen, coupling left out {bare[name]:7.2%}" if name in bare else ""
        print(f"  {name}  fitted {fitted[name]:7.2%}   unseen {new[name]:7.2%}{last}")
    means = {k: float(np.mean(list(x.values()))) for k, x in (("fitted", fitted), ("unseen", new))}
    print(f"mean: fitted {means['fitted']:.2%} (source 2.38 %), unseen {means['unseen']:.2%}")
    return {**means, **{f"alone {k}": x for k, x in bare.items()}}


if __name__ == "__main__":
    main()
