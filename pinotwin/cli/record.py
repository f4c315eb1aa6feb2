"""``pinotwin record MACHINE --out LOG.csv [--seconds T] [--seed N] [--withhold ...]``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinotwin.cli.inputs import read_logs
from pinotwin.cli.output import add_common, say, write_json
from pinotwin.errors import InputError, nearest
from pinotwin.log import Log
from pinotwin.logs.files.given import LogLike, as_log
from pinotwin.logs.write import write_log
from pinotwin.machine.bundled import bundled_path, machines
from pinotwin.system.writing import check_file
from pinotwin.virtual import trajectories

if TYPE_CHECKING:
    from pinotwin.virtual import VirtualMachine
    from pinotwin.virtual.recording import Recording

LONGEST = 3600.0
"""Longest recording [s]: an hour at 4 kHz already takes gigabytes."""

TRAJECTORIES = ("random", "multisine", "slow_reversals", "constant_speeds")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    from pinotwin.virtual.doses import INJECT, INJECT_MACHINE

    parser.add_argument("machine", help="machine folder, machine.yaml, or a bundled name")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of the log (20)")
    text = "of the noise, and of the trajectory unless --trajectory-seed is given"
    parser.add_argument("--seed", type=int, default=1, help=text)
    parser.add_argument(
        "--trajectory",
        choices=TRAJECTORIES,
        default="random",
        metavar="KIND",
        help=f"{', '.join(TRAJECTORIES)} (random)",
    )
    parser.add_argument(
        "--trajectory-seed", type=int, metavar="N", help="same N, other --seed: a repeat of the same command"
    )
    parser.add_argument(
        "--withhold", nargs="+", default=[], metavar="EFFECT[:AXIS]", help="effects to leave out of the truth"
    )
    parser.add_argument(
        "--inject",
        nargs="+",
        default=[],
        metavar="EFFECT:AXIS=SIZE",
        help="effects to add to the truth; SIZE is relative, 0.1 being a tenth of the axis' rated effort where "
        f"the effect is an effort. Of an axis: {', '.join(INJECT)}; of the machine: {', '.join(INJECT_MACHINE)}",
    )
    parser.add_argument("--axis", help="axis that slow_reversals and constant_speeds move")
    parser.add_argument("--command", metavar="LOG", help="run the command of this log again")
    parser.add_argument(
        "--imu",
        action="append",
        default=[],
        metavar="FILE",
        help="also write the log of a virtual IMU; may be given several times",
    )
    parser.add_argument(
        "--imu-link",
        action="append",
        default=[],
        metavar="LINK",
        help="link that carries it, in the order of --imu (from machine.yaml)",
    )
    add_common(parser, out="log to write (.csv or .parquet)", required=True, file=True)


@dataclass(frozen=True, repr=False, kw_only=True)
class Recorded(Log):
    """A log of a virtual machine.

    Attributes:
        recording: the run, with its sealed truth.
        withheld: effects that the truth did not have.
        injected: effects that it had beside its own.
    """

    recording: Recording
    withheld: tuple[str, ...] = ()
    injected: tuple[str, ...] = ()

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
        write_log(path, self.channels)
        return Path(path)


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

    Raises:
        InputError: an argument is unknown or out of range.
    """
    from pinotwin.virtual import VirtualMachine

    if not 0.1 <= seconds <= LONGEST:
        raise InputError(f"--seconds: {seconds:g}: expected 0.1 to {LONGEST:g}")
    for name, value in (("seed", seed), ("trajectory-seed", trajectory_seed)):
        if (value or 0) < 0:
            raise InputError(f"--{name}: must not be negative")
    virtual = VirtualMachine.load(_folder(machine), withhold=withhold, inject=inject)
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


def run(args: argparse.Namespace) -> int:
    """Run the virtual machine and write what its controller would log."""
    out = Path(args.out)
    if out.suffix not in (".csv", ".parquet"):
        raise InputError(f"--out: {out.name}: a log ends in .csv or .parquet")
    for path in args.imu:
        if Path(path).suffix not in (".csv", ".parquet"):
            raise InputError(f"--imu: {path}: a log ends in .csv or .parquet")
        check_file(path)
    links = _imu_links(args, _folder(args.machine))
    made = record(
        args.machine,
        seconds=args.seconds,
        seed=args.seed,
        trajectory=args.trajectory,
        trajectory_seed=args.trajectory_seed,
        withhold=args.withhold,
        inject=args.inject,
        axis=args.axis,
        command=read_logs([args.command])[0] if args.command else None,
        truth_at_control_rate=bool(links),  # an IMU filters what it samples
    )
    made.save(out)
    _write_imus(args, made.recording, links)
    if args.json:
        write_json(args.json, made.to_dict())
    say(f"{made.recording.machine}: {len(made)} rows, {made.t[-1]:.4g} s, seed {args.seed}: {out}")
    return 0


def _folder(machine: str | Path) -> Path:
    """Return the folder of a machine, by its path or its name."""
    bundled = not Path(machine).exists() and str(machine) in machines()
    return bundled_path(str(machine)) if bundled else Path(machine)


def _write_imus(args: argparse.Namespace, recording: Recording, links: Sequence[str]) -> None:
    """Write the logs of the virtual IMUs that were asked for."""
    from pinotwin.virtual import VirtualMachine
    from pinotwin.virtual.imu import record_imu

    for number, (path, link) in enumerate(zip(args.imu, links, strict=True), 1):
        maker = VirtualMachine.load(_folder(args.machine)).truth.seed
        imu = record_imu(recording.truth, link, maker, args.seed, number)
        write_log(path, imu.channels)
        say(f"{recording.machine}: {len(imu)} rows of imu{number} on {link}, its own clock: {path}")


def _imu_links(args, folder):  # type: ignore[no-untyped-def]
    """Return the link of every virtual IMU that was asked for."""
    from pinotwin.errors import InputError
    from pinotwin.machine import Machine

    if not args.imu:
        return []
    stated = [imu.link for imu in Machine.load(folder).imus.values()]
    if not stated and len(args.imu_link) < len(args.imu):
        raise InputError(
            "--imu: machine.yaml has no `imus`; say which link carries the sensor with --imu-link"
        )
    given = args.imu_link[: len(args.imu)]
    return given + [stated[min(k, len(stated) - 1)] for k in range(len(given), len(args.imu))]


def _trajectory(
    machine: VirtualMachine, kind: str, seconds: float, seed: int, axis: str | None
) -> trajectories.Trajectory:
    if kind not in TRAJECTORIES:
        raise InputError(f"trajectory: no kind {kind!r}; {nearest(kind, TRAJECTORIES)}")
    if kind == "random":
        return trajectories.random_trajectory(machine, seconds, seed)
    if kind == "multisine":
        return trajectories.multisine(machine, seconds, seed)
    if axis is None:
        raise InputError(f"--trajectory {kind}: say which axis, e.g. --axis {machine.axes[0]}")
    if axis not in machine.axes:
        raise InputError(f"--axis: no axis {axis!r}; {nearest(axis, machine.axes)}")
    made: trajectories.Trajectory = getattr(trajectories, kind)(machine, axis)
    return made
