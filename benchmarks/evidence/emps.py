"""EMPS, a real ball-screw drive (Janot, Gautier, Brunot 2019): simulated from its command alone.

By halves: identified on one half of the recording, cut where the axis rests, and simulated along the other,
both ways; the figure is the mean of both. Published figures are of the log that was fitted; ours of that
stand beside them. Errors are norms over the measured signal's, derivatives through a low-pass of 100 Hz.
"""

from __future__ import annotations

import numpy as np

import pinotwin as pt
from benchmarks.evidence.real import folder, percent
from benchmarks.evidence.store import Figure
from pinotwin.columns import bind
from pinotwin.signals import derivatives

SEEDS = "none: a recording"
PUBLISHED = {"position": 0.013752, "velocity": 0.22911, "acceleration": 8.6036, "force": 5.848}
EDGE = 49  # rows at either end, which the low-pass' start-up touches


def figures() -> list[Figure]:
    """Measure."""
    machine = pt.Machine.load("emps")
    log = bind(pt.read(folder("emps") / "DATA_EMPS.mat"), machine.columns)
    middle = _at_rest(log)
    halves = [log.rows(slice(0, middle)), log.rows(slice(middle, len(log)))]
    twins = [pt.identify(machine, half) for half in halves]
    ways = [errors(twins[0], halves[1]), errors(twins[1], halves[0])]
    own = errors(pt.identify(machine, log), log)
    out = []
    for name, published in PUBLISHED.items():
        a, b = (way[name] for way in ways)
        out.append(
            Figure(
                name, f"{name}, the other half simulated", 0.5 * (a + b), low=min(a, b), high=max(a, b),
                published=published, note="" if out else "published on the log that was fitted",
            )
        )  # fmt: skip
        out.append(
            Figure(f"{name}_fitted", f"{name}, whole log", own[name], kind="fitted", published=published)
        )
    return out


def errors(twin: pt.Twin, log: pt.Log) -> dict[str, float]:
    """Return the errors of a log that is simulated from its command [%]."""
    predicted = twin.simulate(log.with_channels({"t": log.t, "X.qr": log["X.qr"]}))
    model, truth = (derivatives(x["X.q"][:, None], 1000.0, 100.0) for x in (predicted, log))
    inside = slice(EDGE, -EDGE)
    out = {
        name: percent(m[inside, 0], x[inside, 0])
        for name, m, x in zip(("position", "velocity", "acceleration"), model, truth, strict=True)
    }
    return {**out, "force": percent(predicted["X.u"][inside], log["X.u"][inside])}


def _at_rest(log: pt.Log) -> int:
    """Return the row nearest to the middle at which the command has rested for 50 ms."""
    still = np.abs(np.diff(log["X.qr"], prepend=log["X.qr"][0])) < 1e-9
    rested = np.convolve(still, np.ones(50), mode="full")[: len(still)] >= 49.5
    rows = np.flatnonzero(rested) if rested.any() else np.arange(len(log))
    return int(rows[np.argmin(np.abs(rows - len(log) // 2))])
