"""03: identify a drive from one log, predict another motion from its command alone.

Run: .venv/bin/python examples/03_identify_and_predict.py.

You see mass, viscous and dry friction of the drive, then how far off the prediction of the unseen motion
is: well below 1 % of the tracking error's RMS, some 7 % of the effort's.
"""

from __future__ import annotations

import numpy as np

import pinotwin as pt
from pinotwin.virtual import VirtualMachine, random_trajectory


def main(seconds: float = 12.0) -> dict[str, float]:
    """Return RMS error over RMS of tracking error and effort on the unseen motion."""
    virtual = VirtualMachine.load(pt.machines()["emps"])
    log, unseen = (virtual.record(random_trajectory(virtual, seconds, k), seed=k).to_log() for k in (1, 2))
    twin = pt.identify(pt.Machine.load("emps"), log)
    for row in twin.parameters[:4]:
        print(f"{row.name:<24}{row.value:12.4g}")
    predicted = twin.simulate(unseen)
    out = {}
    for signal, true in (("e", unseen["X.qr"] - unseen["X.q"]), ("u", unseen["X.u"])):
        off = predicted[f"X.{signal}"] - true
        out[signal] = float(np.sqrt(np.mean(off**2) / np.mean(true**2)))
        print(f"unseen {signal}: {out[signal]:.1%} of its RMS")
    return out


if __name__ == "__main__":
    main()
