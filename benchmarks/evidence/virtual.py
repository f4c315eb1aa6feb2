"""What the parts on virtual machines share: identified on one log, another simulated from its command alone.

Every axis counts, those that mostly stand too; three friction laws, none of which the model holds; machines with
CAD errors, controllers, encoders and noise of their own, which share neither code nor formulas with the model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

import pinotwin as pt
from benchmarks.evidence.store import Figure
from pinotwin.machine.bundled import machines
from pinotwin.simulation import compare
from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual.folder import read_folder

LAWS = {"lugre": "LuGre", "gms": "generalised Maxwell slip", "elastoplastic": "elasto-plastic"}
SEEDS = (50, 51, 52, 53, 54)
SECONDS = 20.0


Record = Callable[[VirtualMachine, int], pt.Log]
"""Make the log of a seed that a twin is identified on."""


def recorded(virtual: VirtualMachine, seed: int) -> pt.Log:
    """Return the servo log of a random trajectory."""
    return virtual.record(random_trajectory(virtual, SECONDS, seed), seed=seed).to_log()


def measure(
    name: str, published: float, record: Record = recorded, machine: pt.Machine | None = None
) -> list[Figure]:
    """Return the errors of e and u over all axes, by friction law and over all laws.

    Args:
        name: bundled machine.
        published: the source's figure [%].
        record: makes the log of a seed that a twin is identified on.
        machine: what is believed of it; as bundled by default.
    """
    believed = pt.Machine.load(name) if machine is None else machine
    rows = {law: [_errors(_virtual(name, law), seed, record, believed) for seed in SEEDS] for law in LAWS}
    what, every = "mean of e and u of all axes, every law and seed", [x for r in rows.values() for x in r]
    out = [_figure("all", what, every, published, note="the source's is of its real machine")]
    for law, found in rows.items():
        out.append(_figure(law, f"the same, {LAWS[law]}", found, published))
    floors = [_floor(_virtual(name, law), seed) for law in LAWS for seed in SEEDS]
    what = "two runs of the true machine, other noise and scatter of friction"
    out.append(Figure("floor", what, float(np.median(floors)), low=min(floors), high=max(floors)))
    for axis in every[0]:
        for signal in "eu":
            values = [100.0 * row[axis][signal]["nrmse"] for row in every]
            what = f"{signal} of {axis}"
            out.append(
                Figure(f"{axis}_{signal}", what, float(np.median(values)), low=min(values), high=max(values))
            )
    return out


def _virtual(name: str, law: str) -> VirtualMachine:
    folder = read_folder(machines()[name])
    axes = {k: replace(a, friction=replace(a.friction, kind=law)) for k, a in folder.truth.axes.items()}
    return VirtualMachine.build(replace(folder, truth=replace(folder.truth, axes=axes)))


def _floor(virtual: VirtualMachine, seed: int) -> float:
    """Return by how much two runs of the true machine differ, mean of e and u of all axes [%]."""
    path = random_trajectory(virtual, SECONDS, 1000 + seed)
    first, other = (virtual.record(path, seed=s).to_log() for s in (1000 + seed, 2000 + seed))
    off = compare(pt.Machine.load(virtual.name), first, _said(other))
    return 100.0 * float(np.mean([row[s]["nrmse"] for row in off.values() for s in "eu"]))


def _said(log: pt.Log) -> pt.Log:
    """Return a log with the tracking errors that a prediction has."""
    axes = [name.removesuffix(".qr") for name in log.channels if name.endswith(".qr")]
    return log.with_channels({**log.channels, **{f"{a}.e": log[f"{a}.qr"] - log[f"{a}.q"] for a in axes}})


def _errors(virtual: VirtualMachine, seed: int, record: Record, machine: pt.Machine) -> dict:  # type: ignore[type-arg]
    return missed(pt.identify(machine, record(virtual, seed)), recorded(virtual, 1000 + seed))


def missed(twin: pt.Twin, unseen: pt.Log) -> dict:  # type: ignore[type-arg]
    """Return the errors of a log simulated from its command alone, by axis and signal."""
    command = unseen.with_channels({k: unseen[k] for k in unseen.channels if k == "t" or k.endswith(".qr")})
    return compare(twin.machine, unseen, twin.simulate(command))


def _figure(name: str, what: str, rows: list, published: float, note: str = "") -> Figure:  # type: ignore[type-arg]
    means = [100.0 * float(np.mean([row[a][s]["nrmse"] for a in row for s in "eu"])) for row in rows]
    return Figure(
        name, what, float(np.median(means)), low=min(means), high=max(means),
        published=published, note=note,
    )  # fmt: skip
