"""Logs of a case from the virtual machine; the diagnosing code sees nothing else of it."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinotwin.bench.cases import HEALTHY, Case
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.machine.bundled import machines
from pinotwin.twin import Twin
from pinotwin.virtual import VirtualMachine, random_trajectory

SECONDS = 12.0


@dataclass(frozen=True)
class Produced:
    """A sealed case.

    Attributes:
        logs: two repeats of each of two commands.
        validation: one run of a third command.
        rho: gap-to-noise power ratio per axis, from noise-free simulation.
    """

    logs: list[Log]
    validation: list[Log]
    rho: dict[str, float]


def virtual(name: str, inject: tuple[dict[str, Any], ...] = ()) -> VirtualMachine:
    """Return a bundled machine's virtual twin with what its YAML does not list withheld."""
    folder = machines().get(name, name)
    return VirtualMachine.load(folder, withhold=HEALTHY.get(name, ()), inject=inject)


def produce(case: Case, *, seconds: float = SECONDS) -> Produced:
    """Run the machine of a case."""
    inject = tuple(
        {"effect": e, "axis": a, "size": s, "seed": case.seed % 100003} for e, a, s in case.effects
    )
    ill = virtual(case.machine, inject)
    paths = [random_trajectory(ill, seconds, case.seed % 99991 + k) for k in range(3)]
    logs = [ill.record(p, seed=case.seed % 9973 + 10 * k + r).to_log()
            for k, p in enumerate(paths[:2]) for r in (1, 2)]  # fmt: skip
    validation = [ill.record(paths[2], seed=case.seed % 9973 + 31).to_log()]
    return Produced(logs, validation, _rho(case, ill, paths[0]))


def _rho(case: Case, ill: VirtualMachine, path: Any) -> dict[str, float]:
    """Return how much effort the effect changes along the same command, over the noise power."""
    if not case.effects:
        return dict.fromkeys(ill.axes, 0.0)
    well = virtual(case.machine)
    clean = [m.record(path, seed=1, noise=False).log for m in (well, ill)]
    out = {}
    for axis in ill.axes:
        d = clean[1][f"{axis}.u"] - clean[0][f"{axis}.u"]
        sensor = ill.truth.axes[axis].effort
        noise = (sensor.white or 0.0) ** 2 + (sensor.coloured or 0.0) ** 2
        out[axis] = float(np.mean(d**2) / max(noise, 1e-30))
    return out


@functools.lru_cache(maxsize=4)
def healthy_twin(name: str, seed: int = 1, seconds: float = 24.0) -> Twin:
    """Return the twin of a healthy machine, identified once per process."""
    from pinotwin.identification import identify

    well = virtual(name)
    logs = [well.record(random_trajectory(well, seconds, 1000 + seed + k), seed=seed + k).to_log()
            for k in range(2)]  # fmt: skip
    return identify(Machine.load(name), logs, loop=False)
