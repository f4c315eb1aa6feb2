"""10: where the tracking error of a drive comes from, cause by cause, from the command alone.

Run: .venv/bin/python examples/10_tracking_error_by_cause.py.

You see the share of each cause in micrometres; nearly all of it is the command itself, some 13 µm are
friction.
"""

from __future__ import annotations

import numpy as np

import pinotwin as pt
from pinotwin.virtual import VirtualMachine, random_trajectory


def main(seconds: float = 12.0) -> dict[str, float]:
    """Return the RMS tracking error [m] that each cause makes on an unseen motion."""
    virtual = VirtualMachine.load(pt.machines()["emps"])
    log, unseen = (virtual.record(random_trajectory(virtual, seconds, k), seed=k).to_log() for k in (1, 2))
    twin = pt.identify(pt.Machine.load("emps"), log)
    parts = pt.decompose(twin, unseen).errors["X"]
    out = {cause: float(np.sqrt(np.mean(x**2))) for cause, x in parts.items()}
    for cause, size in sorted(out.items(), key=lambda item: -item[1]):
        print(f"{cause:<16}{1e6 * size:10.2f} µm")
    return out


if __name__ == "__main__":
    main()
