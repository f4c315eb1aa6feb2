"""``pinotwin new XYZAC log.csv --out mymachine``: a machine folder to start from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from pinotwin.cli.arguments import Answer, Folder, Several
from pinotwin.cli.inputs import by_axis, read_logs
from pinotwin.errors import InputError

if TYPE_CHECKING:
    from pinotwin.scaffold.start import Start


def run(
    source: str,
    log: str | None = None,
    *,
    rotary: Literal["table", "head"] = "table",
    rate: float | None = None,
    mass: Several = (),
    factor: Several = (),
    travel: Several = (),
    offset: Several = (),
    meshes: str | None = None,
    out: Folder,
) -> Answer:
    """Write the folder and say every assumption and guess.

    Args:
        source (AXES|URDF|NAME): axes (XYZAC; XYZ-BC: tool side - table side; 0-YAC), a .urdf, a bundled name, a
            robot's name (ur10)
        log (LOG): a log of it: its columns are guessed, each guess is printed
        rotary: what rotary axes carry where AXES has no '-' (table)
        rate (HZ): sampling rate of a log without a time column
        mass (AXIS=KG): mass that the axis alone moves
        factor (AXIS=NUMBER): effort [N, N·m] of one unit of the axis' effort column: torque constant x gear, e.g. Y=35
        travel (AXIS=LOW,HIGH): limits of an axis [m or rad], e.g. X=-0.3,0.3
        offset (AXIS=X,Y,Z): place of its joint in the frame of the one before [m]
        meshes (DIR): folder of the mesh packages of a URDF
        out (PATH): machine folder to write
    """
    from pinotwin.scaffold import new
    from pinotwin.scaffold.chain import Sizes

    if rate is not None and not rate > 0:
        raise InputError(f"--rate: {rate:g} Hz must be positive")
    sizes = Sizes(
        {axis: x for axis, (x,) in by_axis("mass", mass).items()},
        {axis: (low, high) for axis, (low, high) in by_axis("travel", travel, 2).items()},
        {axis: (x, y, z) for axis, (x, y, z) in by_axis("offset", offset, 3).items()},
        {axis: x for axis, (x,) in by_axis("factor", factor).items()},
    )
    (given,) = read_logs([log]) if log else (None,)
    start = new(source, given, out=out, rotary=rotary, sizes=sizes, rate=rate, meshes=meshes)
    return Answer(summary(start, given.notes if given else (), log or "LOG"), as_dict(start))


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
    keys = ("channel", "column", "unit", "factor", "rate", "reason")
    return {
        "machine": start.machine.name,
        "folder": str(start.folder),
        "axes": list(start.machine.axes),
        "assumed": list(start.said),
        "columns": [{key: getattr(g, key) for key in keys} for g in (guesses.found if guesses else ())],
        "named": list(guesses.named) if guesses else [],
        "open": list(guesses.open) if guesses else [],
        "unused": list(guesses.unused) if guesses else [],
    }
