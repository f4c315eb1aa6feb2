"""06: a twin of the healthy drive, then more viscous friction: where, which, how far the residual falls.

Run: .venv/bin/python examples/06_diagnose_a_fault.py. ``quick`` screens only; leave it out for the full diagnosis.

You see that the viscous friction of X rose about four times, with residual, noise and confidence.
"""

from __future__ import annotations

import pinotwin as pt
from pinotwin.virtual import VirtualMachine, random_trajectory


def main(seconds: float = 12.0, quick: bool = True) -> pt.Diagnosis:
    """Return the diagnosis of two repeats with a fault, against a twin of the healthy drive."""
    folder = pt.machines()["emps"]
    healthy, worn = VirtualMachine.load(folder), VirtualMachine.load(folder, inject=["viscous:X=0.8"])
    motion = random_trajectory(healthy, seconds, 1)
    twin = pt.identify(pt.Machine.load("emps"), healthy.record(motion, seed=1).to_log())
    repeats = [worn.record(motion, seed=seed).to_log() for seed in (2, 3)]
    found = pt.diagnose(twin, repeats, quick=quick)
    print(found.sentence)
    for axis, row in found.gap.items():
        for signal, residual in row.items():
            print(f"{axis}.{signal}: residual {residual.rms:.3g}, noise {residual.noise:.3g}")
    for effect in found.effects:
        print(f"{effect.axis}.{effect.effect}: confidence {effect.confidence:.0%}")
    return found


if __name__ == "__main__":
    main(quick=False)
