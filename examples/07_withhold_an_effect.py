"""07: what one effect is worth: the same log with and without dry friction in the model.

Run: .venv/bin/python examples/07_withhold_an_effect.py.

You see the residual effort on a motion that was not fitted: below 1 N with Coulomb friction, some 20
N without.
"""

from __future__ import annotations

import pinotwin as pt
from pinotwin.studies.overlay import with_and_without
from pinotwin.virtual import VirtualMachine, random_trajectory


def main(axis: str = "X", effect: str = "coulomb", seconds: float = 10.0) -> tuple[float, float]:
    """Return the RMS error [N or N·m] with all effects, and without the one."""
    virtual = VirtualMachine.load(pt.machines()["emps"])
    log, unseen = (virtual.record(random_trajectory(virtual, seconds, k), seed=k).to_log() for k in (1, 2))
    twin = pt.identify(pt.Machine.load("emps"), log, loop=False)
    ((_, complete, without),) = with_and_without(twin, unseen, axis, [effect]).rows
    print(f"{axis}: {complete:.3g} N with {effect}, {without:.3g} N without, on a motion that was not fitted")
    return complete, without


if __name__ == "__main__":
    main()
