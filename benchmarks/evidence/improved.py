"""The bundled laser driller, as described and after `pinotwin improve`: another command of 20 s simulated.

Five seeds, the machine's own friction; a log of 20 s is fitted, a second one of 20 s judges the steps, and a third
command is simulated; RMS error over RMS of tracking error and effort. Every axis counts.
"""

from __future__ import annotations

import numpy as np

import pinotwin as pt
from benchmarks.evidence import virtual
from benchmarks.evidence.store import Figure
from pinotwin.studies.improvement import improve
from pinotwin.virtual import VirtualMachine

NAME = "laser_driller"
SEEDS = "50 to 54; sealed commands 2050 to 2054, unseen ones 1050 to 1054"
SLOW = True


def figures() -> list[Figure]:
    """Measure."""
    source, machine = VirtualMachine.load(pt.machines()[NAME]), pt.Machine.load(NAME)
    rows: dict[str, list[dict[str, dict[str, dict[str, float]]]]] = {"bundled": [], "improved": []}
    for seed in virtual.SEEDS:
        log, unseen, sealed = (virtual.recorded(source, seed + k) for k in (0, 1000, 2000))
        rows["bundled"].append(virtual.missed(pt.identify(machine, log), unseen))
        rows["improved"].append(virtual.missed(improve(machine, log, validate=sealed).twin, unseen))
    out = []
    for how, each in rows.items():
        means = [float(np.mean([row[a][s]["nrmse"] for a in row for s in "eu"])) for row in each]
        of_x = [row["X"]["e"]["nrmse"] for row in each]
        out.append(_figure(how, f"{how}: mean of e and u of all axes", means))
        out.append(_figure(f"{how}_X_e", f"{how}: e of X", of_x))
    return out


def _figure(name: str, what: str, errors: list[float]) -> Figure:
    shares = 100.0 * np.array(errors)
    note = {"improved": "must ≤ 2.4, aim ≤ 1.8", "improved_X_e": "must ≤ 4"}.get(name, "")
    low, high = float(shares.min()), float(shares.max())
    return Figure(name, f"{what}, mean of the seeds", float(shares.mean()), low=low, high=high, note=note)
