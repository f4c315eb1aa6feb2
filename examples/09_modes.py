"""09: a structure's modes, motors held and free: what an elastic joint does to the machine.

Run: .venv/bin/python examples/09_modes.py.

You see some 21 Hz with the motors held, 35 Hz with the motors free.
"""

from __future__ import annotations

import pinotwin as pt
from pinotwin.analysis.modal import modes


def main() -> dict[str, float]:
    """Return the frequency of the elastic mode [Hz] with the motors held and free."""
    machine = pt.Machine.load("flexure_rig")
    out = {}
    for name, locked in (("held", list(machine.axes)), ("free", [])):
        found = modes(machine, {}, locked=locked)
        elastic = max(found.modes, key=lambda mode: mode.frequency)  # the others swing under gravity
        out[name] = elastic.frequency
        print(f"motors {name}: {out[name]:.2f} Hz, damping {elastic.damping:.3f}")
    return out


if __name__ == "__main__":
    main()
