"""02: what is wrong with a log, and what it can identify, before anything is fitted.

Run: .venv/bin/python examples/02_check.py. One log as it should be, and the same with the position in millimetres.

You see 11 of 11 base parameters for the first; for the second a line per doubt, the first "looks like mm,
set unit: mm".
"""

from __future__ import annotations

import pinotwin as pt
from pinotwin.virtual import VirtualMachine, random_trajectory


def main(seconds: float = 10.0) -> tuple[int, list[str]]:
    """Return how many parameters the good log determines, and the warnings about the spoiled one."""
    machine = pt.Machine.load("trunnion")
    virtual = VirtualMachine.load(pt.machines()["trunnion"])
    log = virtual.record(random_trajectory(virtual, seconds, 1), seed=1).to_log()
    good = pt.check(machine, log)
    known = sum(good.determined.values())
    print(f"as logged: {known} of {len(good.determined)} base parameters can be identified")
    in_mm = log.with_channels({**log.channels, "Y.q": 1e3 * log["Y.q"]})
    said = [
        f"{f.channel}: {f.message}".removeprefix(": ")
        for f in pt.check(machine, in_mm).findings
        if f.severity != "info"
    ]
    print("Y.q in millimetres:", *said, sep="\n  ")
    return known, said


if __name__ == "__main__":
    main()
