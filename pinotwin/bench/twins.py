"""Twins of healthy machines, identified once and kept on disk: what a change is seen against."""

from __future__ import annotations

import functools
from pathlib import Path

from pinotwin.bench.plants import public_machine, virtual
from pinotwin.bench.produce import path_of
from pinotwin.twin import Twin


def make_twin(folder: Path, pair: tuple[str, int], seconds: float = 12.0) -> Path:
    """Identify the twin of a healthy machine and a seed on two logs, unless it is there; return its folder.

    Its closed loops are left out: simulating the tracking error takes most of the time of a case, and the law
    of the servo is held against the logs alone.
    """
    from pinotwin.identification import identify

    machine, seed = pair
    target = folder / f"{machine.replace(':', '-').replace('/', '_')}-{seed}"
    if not (target / "twin.json").is_file():
        well = virtual(machine)
        seeds = [10 * seed + k for k in range(2)]
        logs = [well.record(path_of(machine, seconds, 1000 + k), seed=500 + k).to_log() for k in seeds]
        public = public_machine(machine)
        identify(public, logs, loop=False).save(target)
    return target


@functools.lru_cache(maxsize=16)
def healthy_twin(folder: Path, machine: str, seed: int) -> Twin:
    """Return the twin of a healthy machine as it is read from disk."""
    return Twin.load(make_twin(folder, (machine, seed)))
