"""``pinotwin check MACHINE [LOG] [--out DIR]``."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import TYPE_CHECKING

from pinotwin.cli.inputs import add_effects, add_resample, read_logs, resampled
from pinotwin.cli.output import add_common, say, write_json
from pinotwin.system.writing import whole_folder, write_text

if TYPE_CHECKING:
    from pinotwin.logs.check import Check


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("machine", help="machine folder, machine.yaml, .urdf, or a bundled name")
    parser.add_argument("log", nargs="?", help="servo log; a.csv+b.csv joins columns")
    add_resample(parser)
    add_effects(parser)
    add_common(parser, out="folder for check.json and check.txt, what is printed")


def run(args: argparse.Namespace) -> int:
    """Examine and say what was found; 1 if something forbids going on."""
    from pinotwin.logs.check import check
    from pinotwin.machine import Machine

    machine = resampled(Machine.load(args.machine), args.resample)
    log = None if args.log is None else read_logs([args.log])[0]
    result = check(machine, log)
    lines = _lines(result)
    if args.out:
        with whole_folder(args.out) as folder:
            write_json(folder / "check.json", result.as_dict())
            write_text(folder / "check.txt", "\n".join(lines) + "\n")
    if args.json:
        write_json(args.json, result.as_dict())
    for line in lines:
        say(line)
    return 0 if result.ok else 1


def _lines(result: Check) -> list[str]:
    machine = result.machine
    lines = [f"{machine.name}: {len(machine.axes)} axes, {len(machine.base)} base parameters"]
    wide = _width(machine.axes, 8)
    for name, axis in machine.axes.items():
        kind = "rotary" if axis.rotary else "linear"
        effects = ", ".join(effect.name for effect in axis.effects)
        lines.append(f"  {name:<{wide}}{kind:<8}{effects}")
    lines += _log_lines(result)
    lines += _base_lines(result)
    lines += [f"{f.severity:<8}{f.channel + ': ' if f.channel else ''}{f.message}" for f in result.findings]
    lines.append("ok" if result.ok else "not usable as it is: see the errors above")
    return lines


def _log_lines(result: Check) -> list[str]:
    quality = result.quality
    if quality is None:
        return []
    wide = _width(quality.axes, 8)
    rate = f"{quality.clock.rate:.6g} Hz" if quality.clock is not None else "no clock"
    lines = [f"log {quality.source}: {quality.rows} rows, {quality.duration:.4g} s, {rate}"]
    for name, axis in quality.axes.items():
        x = "rad" if axis.rotary else "m"
        moves = "moves" if axis.moves else "stands still"
        lines.append(
            f"  {name:<{wide}}{moves:<14}{axis.low:.4g} to {axis.high:.4g} {x}, up to {axis.speed:.3g} "
            f"{x}/s and {axis.acceleration:.3g} {x}/s²{_lead(axis.lead)}"
        )
    return lines


def _lead(lead: float | None) -> str:
    if lead is None or abs(lead) < 1e-4:
        return ""
    side = "ahead of" if lead > 0 else "behind"
    return f", effort {abs(lead) * 1e3:.2g} ms {side} position"


def _base_lines(result: Check) -> list[str]:
    """Return the base parameters of a machine alone, or those that a log does not tell."""
    base, known = result.machine.base, result.determined
    asked = [row for row in zip(base.labels, base.names, base.units, strict=True) if not known.get(row[0])]
    if not asked:
        return []
    wide = _width((label for label, _, _ in asked), 12)
    title = f"{len(asked)} of {len(known)} base parameters that this log does not excite" if known else ""
    lines = [title or "base parameters"]
    return lines + [f"  {label:<{wide}}{name} [{unit}]" for label, name, unit in asked]


def _width(words: Iterable[str], least: int) -> int:
    """Return the width of a column that holds every word."""
    return max([least, *(len(word) + 2 for word in words)])
