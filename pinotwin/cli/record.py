"""``pinotwin record MACHINE --out LOG.csv [--seconds T] [--seed N] [--withhold ...]``."""

from __future__ import annotations

import argparse
from pathlib import Path

from pinotwin.cli.output import add_common, say, write_json
from pinotwin.system.writing import check_file

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


def run(args: argparse.Namespace) -> int:
    """Run the virtual machine and write what its controller would log."""
    from pinotwin.errors import InputError
    from pinotwin.logs.write import write_log
    from pinotwin.machine.bundled import bundled_path, machines
    from pinotwin.virtual import VirtualMachine

    out = Path(args.out)
    if not 0.1 <= args.seconds <= LONGEST:
        raise InputError(f"--seconds: {args.seconds:g}: expected 0.1 to {LONGEST:g}")
    for name in ("seed", "trajectory_seed"):
        if (getattr(args, name) or 0) < 0:
            raise InputError(f"--{name.replace('_', '-')}: must not be negative")
    if out.suffix not in (".csv", ".parquet"):
        raise InputError(f"--out: {out.name}: a log ends in .csv or .parquet")
    for path in args.imu:
        if Path(path).suffix not in (".csv", ".parquet"):
            raise InputError(f"--imu: {path}: a log ends in .csv or .parquet")
        check_file(path)
    folder = Path(args.machine)
    if not folder.exists() and args.machine in machines():
        folder = bundled_path(args.machine)
    machine = VirtualMachine.load(folder, withhold=args.withhold, inject=args.inject)
    links = _imu_links(args, folder)
    fine = machine.truth.control_rate if links else None  # an IMU filters what it samples
    recording = machine.record(_trajectory(args, machine), seed=args.seed, truth_rate=fine)
    write_log(out, recording.log)
    for number, (path, link) in enumerate(zip(args.imu, links, strict=True), 1):
        from pinotwin.virtual.imu import record_imu

        imu = record_imu(recording.truth, link, machine.truth.seed, args.seed, number)
        write_log(path, imu.channels)
        say(f"{machine.name}: {len(imu)} rows of imu{number} on {link}, its own clock: {path}")
    if args.json:
        write_json(args.json, _facts(args, recording))
    rows = len(recording.log["t"])
    say(f"{machine.name}: {rows} rows, {recording.log['t'][-1]:.4g} s, seed {args.seed}: {out}")
    return 0


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


def _trajectory(args, machine):  # type: ignore[no-untyped-def]
    from pinotwin.errors import InputError, nearest
    from pinotwin.virtual import trajectories

    if args.command:
        from pinotwin.cli.inputs import read_logs

        (log,) = read_logs([args.command])
        return trajectories.replay(log.channels, machine.axes)
    seed = args.seed if args.trajectory_seed is None else args.trajectory_seed
    if args.trajectory == "random":
        return trajectories.random_trajectory(machine, args.seconds, seed)
    if args.trajectory == "multisine":
        return trajectories.multisine(machine, args.seconds, seed)
    if args.axis is None:
        raise InputError(f"--trajectory {args.trajectory}: say which axis, e.g. --axis {machine.axes[0]}")
    if args.axis not in machine.axes:
        raise InputError(f"--axis: no axis {args.axis!r}; {nearest(args.axis, machine.axes)}")
    return getattr(trajectories, args.trajectory)(machine, args.axis)


def _facts(args, recording):  # type: ignore[no-untyped-def]
    return {
        "machine": recording.machine,
        "seed": recording.seed,
        "rows": len(recording.log["t"]),
        "channels": list(recording.log),
        "withheld": list(args.withhold),
        "injected": list(args.inject),
    }
