"""``pinotwin new AXES|URDF|NAME [LOG] --out DIR``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pinotwin.cli.output import add_common, say, write_json

if TYPE_CHECKING:
    from pinotwin.scaffold.chain import Sizes
    from pinotwin.scaffold.start import Start


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    source = (
        "axes (XYZAC; XYZ-BC: tool side - table side; 0-YAC), a .urdf, a bundled name, a robot's name (ur10)"
    )
    parser.add_argument("source", metavar="AXES|URDF|NAME", help=source)
    parser.add_argument(
        "log", nargs="?", metavar="LOG", help="a log of it: its columns are guessed, each guess is said"
    )
    text = "what rotary axes carry where AXES has no '-' (table)"
    parser.add_argument("--rotary", choices=("table", "head"), default="table", help=text)
    parser.add_argument(
        "--rate", type=float, metavar="HZ", help="sampling rate of a log without a time column"
    )
    parser.add_argument(
        "--mass", nargs="+", default=[], metavar="AXIS=KG", help="mass that the axis alone moves"
    )
    text = "effort [N, N·m] of one unit of the axis' effort column: torque constant x gear, e.g. Y=35"
    parser.add_argument("--factor", nargs="+", default=[], metavar="AXIS=NUMBER", help=text)
    text = "limits of an axis [m or rad], e.g. X=-0.3,0.3"
    parser.add_argument("--travel", nargs="+", default=[], metavar="AXIS=LOW,HIGH", help=text)
    text = "place of its joint in the frame of the one before [m]"
    parser.add_argument("--offset", nargs="+", default=[], metavar="AXIS=X,Y,Z", help=text)
    parser.add_argument("--meshes", metavar="DIR", help="folder of the mesh packages of a URDF")
    add_common(parser, out="machine folder to write", required=True)


def run(args: argparse.Namespace) -> int:
    """Write the folder and say every assumption and guess."""
    from pinotwin.cli.inputs import read_logs
    from pinotwin.errors import InputError
    from pinotwin.scaffold import new

    if args.rate is not None and not args.rate > 0:
        raise InputError(f"--rate: {args.rate:g} Hz must be positive")
    log = read_logs([args.log])[0] if args.log else None
    start = new(
        args.source,
        log,
        out=args.out,
        rotary=args.rotary,
        sizes=_sizes(args),
        rate=args.rate,
        meshes=args.meshes,
    )
    for line in summary(start, log.notes if log else (), args.log or "LOG"):
        say(line)
    if args.json:
        write_json(args.json, as_dict(start))
    return 0


def _sizes(args: argparse.Namespace) -> Sizes:
    from pinotwin.scaffold.chain import Sizes

    mass = {axis: x[0] for axis, x in _numbers(args.mass, "mass", 1).items()}
    travel = {axis: (x[0], x[1]) for axis, x in _numbers(args.travel, "travel", 2).items()}
    offset = {axis: (x[0], x[1], x[2]) for axis, x in _numbers(args.offset, "offset", 3).items()}
    factor = {axis: x[0] for axis, x in _numbers(args.factor, "factor", 1).items()}
    return Sizes(mass, travel, offset, factor)


def _numbers(given: Sequence[str], option: str, count: int) -> dict[str, list[float]]:
    """Return axis -> numbers of an option such as ``--travel X=-0.3,0.3``."""
    from pinotwin.errors import InputError

    out = {}
    for text in given:
        axis, equals, rest = text.partition("=")
        try:
            values = [float(x) for x in rest.split(",")]
        except ValueError:
            values = []
        if not equals or len(values) != count:
            form = ",".join(["NUMBER"] * count)
            raise InputError(f"--{option}: {text!r} is not AXIS={form}")
        out[axis] = values
    return out


def summary(start: Start, notes: Sequence[str], log: str = "LOG") -> list[str]:
    """Return what was assumed, what was guessed and why, what is open, and the command to go on with."""
    lines = [f"machine {start.machine.name}: axes {', '.join(start.machine.axes)}"]
    lines += [f"  {text}" for text in start.said]
    lines += [f"log: {note}" for note in notes]
    guesses = start.guesses
    if guesses is not None:
        if guesses.named:
            shown = ", ".join(guesses.named[:8]) + (" ..." if len(guesses.named) > 8 else "")
            lines.append(f"channels with standard names: {shown}")
        lines += [f"guess: {g.channel} = {g.column or f'{g.rate:g} Hz'}: {g.reason}" for g in guesses.found]
        lines += [f"open: {question}" for question in guesses.open]
        lines += [f"not used: {', '.join(guesses.unused)}"] if guesses.unused else []
    return [*lines, f"written to {start.folder}; next: pinotwin check {start.folder} {log}"]


def as_dict(start: Start) -> dict[str, object]:
    """Return the result in JSON's types."""
    guesses = start.guesses
    found = (
        []
        if guesses is None
        else [
            {
                "channel": g.channel,
                "column": g.column,
                "unit": g.unit,
                "factor": g.factor,
                "rate": g.rate,
                "reason": g.reason,
            }
            for g in guesses.found
        ]
    )
    return {
        "machine": start.machine.name,
        "folder": str(start.folder),
        "axes": list(start.machine.axes),
        "assumed": list(start.said),
        "columns": found,
        "named": [] if guesses is None else list(guesses.named),
        "open": [] if guesses is None else list(guesses.open),
        "unused": [] if guesses is None else list(guesses.unused),
    }
