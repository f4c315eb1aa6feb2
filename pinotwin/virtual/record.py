"""Field data from a virtual machine: what ``pt.record`` and ``pinotwin record`` make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pinotwin.errors import InputError, require
from pinotwin.log import Log
from pinotwin.logs.files import LogLike, as_log
from pinotwin.logs.write import write_log
from pinotwin.machine.bundled import machines
from pinotwin.trajectories import moves as trajectories
from pinotwin.virtual.machine import VirtualMachine
from pinotwin.virtual.recording import Recording

TRAJECTORIES = ("random", "multisine", "slow_reversals", "constant_speeds")


@dataclass(frozen=True, repr=False, kw_only=True)
class Recorded(Log):
    """A log of a virtual machine."""

    recording: Recording  # the run, with its sealed truth
    withheld: tuple[str, ...] = ()  # effects that the truth did not have
    injected: tuple[str, ...] = ()  # effects that it had beside its own

    def to_dict(self) -> dict[str, Any]:
        """Return what ``pinotwin record --json`` writes."""
        return {
            "machine": self.recording.machine,
            "seed": self.recording.seed,
            "rows": len(self),
            "channels": list(self.channels),
            "withheld": list(self.withheld),
            "injected": list(self.injected),
        }

    def save(self, path: str | Path) -> Path:
        """Write the log (.csv or .parquet, SI) and return its path."""
        return write_log(path, self.channels)


def record(  # noqa: PLR0913, the public call: every option is a keyword
    machine: str | Path,
    *,
    seconds: float = 20.0,
    seed: int = 1,
    trajectory: str = "random",
    trajectory_seed: int | None = None,
    withhold: Sequence[str] = (),
    inject: Sequence[str] = (),
    axis: str | None = None,
    command: LogLike | None = None,
    truth_at_control_rate: bool = False,
    longest: float = 3600.0,
) -> Recorded:
    """Record field data from a virtual machine.

    Args:
        machine: machine folder, machine.yaml, or a bundled name.
        seconds: length of the log [s].
        seed: of the noise, and of the trajectory where that has none of its own.
        trajectory: one of :data:`TRAJECTORIES`.
        trajectory_seed: the same one with another ``seed`` is a repeat of the same command.
        withhold: effects to leave out of the truth, ``effect`` or ``effect:axis``.
        inject: effects to add to it, ``effect:axis=size``.
        axis: the one that moves, where the trajectory moves one.
        command: a log whose command is run again.
        truth_at_control_rate: keep the truth at the controller's rate, as a virtual IMU needs it.
        longest: longest recording allowed [s]: an hour at 4 kHz already takes gigabytes.

    Raises:
        InputError: an argument is unknown or out of range.
    """
    if not 0.1 <= seconds <= longest:
        raise InputError(f"--seconds: {seconds:g}: expected 0.1 to {longest:g}")
    for name, value in (("seed", seed), ("trajectory-seed", trajectory_seed)):
        if (value or 0) < 0:
            raise InputError(f"--{name}: must not be negative")
    virtual = VirtualMachine.load(folder_of(machine), withhold=withhold, inject=inject)
    if command is not None:
        moves = trajectories.replay(as_log(command).channels, virtual.axes)
    else:
        own = seed if trajectory_seed is None else trajectory_seed
        moves = _trajectory(virtual, trajectory, seconds, own, axis)
    rate = virtual.truth.control_rate if truth_at_control_rate else None
    made = virtual.record(moves, seed=seed, truth_rate=rate)
    log = made.to_log()
    return Recorded(
        log.channels, log.source, recording=made, withheld=tuple(withhold), injected=tuple(inject)
    )


def folder_of(machine: str | Path) -> Path:
    """Return the folder of a machine, by its path or its name."""
    bundled = not Path(machine).exists() and str(machine) in machines()
    return machines()[str(machine)] if bundled else Path(machine)


def _trajectory(
    machine: VirtualMachine, kind: str, seconds: float, seed: int, axis: str | None
) -> trajectories.Trajectory:
    require(kind, TRAJECTORIES, "trajectory: no kind", InputError)
    if kind == "random":
        return trajectories.random_trajectory(machine, seconds, seed)
    if kind == "multisine":
        return trajectories.multisine(machine, seconds, seed)
    if axis is None:
        raise InputError(f"--trajectory {kind}: say which axis, e.g. --axis {machine.axes[0]}")
    require(axis, machine.axes, "--axis: no axis", InputError)
    made: trajectories.Trajectory = getattr(trajectories, kind)(machine, axis)
    return made
