"""Logs of a case from the virtual machine, and how much there is to see; nothing else leaves it."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.bench.cases import Case
from pinotwin.bench.catalogue import LOOP_ONLY
from pinotwin.bench.plants import Placed, public_machine, virtual
from pinotwin.bench.ratio import Run, left_of, noise_powers, powers, run
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.trajectories.moves import Trajectory
from pinotwin.twin import Twin
from pinotwin.virtual import VirtualMachine, random_trajectory

DWELL = (0.03, 0.25)  # shortest and longest rest between moves [s]: short logs have no time to waste


@dataclass(frozen=True)
class Sealed:
    """What a diagnosis may see of a case."""

    machine: Machine  # a copy of the machine folder without its truth
    logs: tuple[Log, ...]  # two repeats of one command
    validation: tuple[Log, ...]  # one run of another command


@dataclass(frozen=True)
class Produced:
    """A case with what is known about it."""

    sealed: Sealed  # for the diagnosis
    # power over the noise of each effect alone, in the signal and axis where it shows most; for a model that is
    # fitted to the log, what that model cannot take up
    sizes: tuple[float, ...]
    # of every effect, if all are of the plant: a run with it alone, without noise, each effort what it
    # adds; empty otherwise
    courses: tuple[Log, ...] = ()


def produce(case: Case, *, seconds: float = 8.0) -> Produced:
    """Run the machine of a case."""
    fit, check = (path_of(case.machine, seconds, case.seed % 99991 + k) for k in range(2))
    off = case.effects if case.situation == "structure" else ()
    ill = virtual(case.machine, off=off, on=case.effects, seed=case.seed)
    first = case.seed % 9973
    logs = tuple(replace(ill.record(fit, seed=first + r).to_log(), source=f"A{r}") for r in (1, 2))
    validation = (replace(_later(ill, case.seed).record(check, seed=first + 31).to_log(), source="B"),)
    sealed = Sealed(public_machine(case.machine, off), logs, validation)
    if not case.effects:
        return Produced(sealed, ())
    return _measured(case, sealed, ill, fit, off)


def path_of(machine: str, seconds: float, seed: int, tries: int = 6) -> Trajectory:
    """Return the command with a seed: of a few of this machine, the one whose laziest axis moves most."""
    healthy = virtual(machine)
    drawn = [random_trajectory(healthy, seconds, seed + 100_003 * k, dwell=DWELL) for k in range(tries)]
    return max(drawn, key=lambda path: _way(healthy, path))


def _way(machine: VirtualMachine, path: Trajectory) -> float:
    """Return the way that the laziest axis goes, in travels."""
    q, _, _ = path.at(np.arange(0.0, path.seconds, 0.02), machine.axes)
    spans = [np.ptp(machine.limits[a].travel or (-1.0, 1.0)) for a in machine.axes]
    return float(np.min(np.abs(np.diff(q, axis=0)).sum(axis=0) / spans))


def _later(ill: VirtualMachine, seed: int) -> VirtualMachine:
    """Return the machine with its unlogged loads at other times: they follow no command."""
    shift = float(np.random.default_rng([seed, 5]).uniform(0.3, 0.9))
    loads = tuple(p if p.logged else replace(p, time=p.time + shift) for p in ill.truth.external)
    return replace(ill, truth=replace(ill.truth, external=loads))


def _measured(case: Case, sealed: Sealed, ill: VirtualMachine, path: Trajectory, off: Placed) -> Produced:
    well = virtual(case.machine, off=off)
    clean = run(well, path)
    noise = noise_powers(well, path, clean)
    # An effect made of noise would not be in a clean run.
    seen = run(ill, path, noise=any(effect == "chatter" for effect, _, _ in case.effects))
    alone = [seen]
    if len(case.effects) > 1:
        every = (
            virtual(case.machine, off=off, on=(one,), seed=case.seed + k)
            for k, one in enumerate(case.effects)
        )
        alone = [run(one, path) for one in every]
    machine = sealed.machine if case.situation == "structure" else None
    pairs = zip(case.effects, alone, strict=True)
    sizes = tuple(_size(one[0], r, clean, noise, (machine, well)) for one, r in pairs)
    plant = not any(effect in LOOP_ONLY for effect, _, _ in case.effects)
    courses = tuple(one.with_efforts(one.signals[0] - clean.signals[0]) for one in alone) if plant else ()
    return Produced(sealed, sizes, courses)


def _size(
    effect: str, ill: Run, clean: Run, noise: Floats, model: tuple[Machine | None, VirtualMachine]
) -> float:
    """Return the size of one effect, of the ``noise`` (2, axes) [SI²]: what is left to see of it."""
    difference = ill.signals - clean.signals
    machine, truth = model
    if machine is None or effect in LOOP_ONLY:
        rho = powers(difference) / np.maximum(noise, 1e-300)
        return float(rho[1 if effect in LOOP_ONLY else 0].max())
    return float(left_of(difference[0], ill, machine, truth, noise[0]).max())


def make_twin(folder: Path, pair: tuple[str, int], seconds: float = 12.0) -> Path:
    """Return the folder of the healthy twin of a machine and a seed, identified on two logs if it is not there."""
    from pinotwin.identification import identify

    machine, seed = pair
    target = folder / f"{machine.replace(':', '-').replace('/', '_')}-{seed}"
    if not (target / "twin.json").is_file():
        well = virtual(machine)
        seeds = [10 * seed + k for k in range(2)]
        logs = [well.record(path_of(machine, seconds, 1000 + k), seed=500 + k).to_log() for k in seeds]
        public = public_machine(machine)
        identify(public, logs, loop=False).save(target)  # simulating its error takes most of a case's time
    return target


@functools.lru_cache(maxsize=16)
def healthy_twin(folder: Path, machine: str, seed: int) -> Twin:
    """Return the twin of a healthy machine as it is read from disk."""
    return Twin.load(make_twin(folder, (machine, seed)))
