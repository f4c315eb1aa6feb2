"""``pinotwin check trunnion log.csv``: a machine, or a log of it, examined."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from pinotwin.cli.arguments import Answer, Folder
from pinotwin.cli.inputs import check_there, read_logs, resampled
from pinotwin.system.writing import whole_folder, write_json, write_text

if TYPE_CHECKING:
    from pinotwin.logs.check import Check


def run(
    machine: str, log: str | None = None, *, resample: float | None = None, out: Folder | None = None
) -> Answer:
    """Examine and say what was found; 1 if something forbids going on.

    Args:
        log: servo log; a.csv+b.csv joins columns
        out (PATH): folder for check.json and check.txt, what is printed
    """
    check_there(*filter(None, [log]))
    from pinotwin.logs.check import check
    from pinotwin.machine import Machine

    subject = resampled(Machine.load(machine), resample)
    result = check(subject, None if log is None else read_logs([log])[0])
    lines = _lines(result)
    if out:
        with whole_folder(out) as folder:
            write_json(folder / "check.json", result.as_dict())
            write_text(folder / "check.txt", "\n".join(lines) + "\n")
    return Answer(lines, result.as_dict(), 0 if result.ok else 1)


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
    return max([least, *(len(word) + 2 for word in words)])
