"""Staubli TX40, a real robot (Gautier, Janot): 61 base parameters, wrist coupling, leads of the efforts.

The error of the fit stands beside the published one, which is of a fit too; the error of the unseen half (fitted
on the other, both ways, mean) is what a user may expect.
"""

from __future__ import annotations

import pinotwin as pt
from benchmarks._plain import plain_error
from benchmarks.evidence.real import folder, halves, unseen_effort
from benchmarks.evidence.store import Figure

SEEDS = "none: a recording"


def figures() -> list[Figure]:
    """Measure."""
    data = folder("staubli_tx40")
    log = pt.read(data / "pos_read_data.csv", data / "curr_data.csv")
    machine = pt.Machine.load("tx40")
    twin = pt.identify(machine, log, loop=False)
    parts = halves(log)
    twins = [pt.identify(machine, part, loop=False) for part in parts]
    a, b = unseen_effort(twins[0], parts[1])[0], unseen_effort(twins[1], parts[0])[0]
    return [
        Figure(
            "fit",
            "error norm of the fit",
            100.0 * twin.quality["relative_error"],
            kind="fitted",
            published=8.4,
        ),
        Figure(
            "unseen",
            "error norm of the other half",
            0.5 * (a + b),
            low=min(a, b),
            high=max(a, b),
            plain=50.0 * sum(plain_error(twins[k], [parts[k]], parts[1 - k]) for k in (0, 1)),
        ),
        Figure("parameters", "base parameters", len(twin.theta), unit="", kind="fitted", published=61),
    ]
