"""What every exported file says of itself: machine, units, order, range, and what it leaves out."""

from __future__ import annotations

from pinotwin.export.inverse import Inverse
from pinotwin.version import __version__

LARGE = 0.01
"""A file that differs from its twin by more than this says so."""


def header(inverse: Inverse) -> list[str]:
    """Return the lines of the comment at the top of a file."""
    lines = [
        f"Inverse model of {inverse.name}: motor effort from position, velocity and acceleration.",
        "",
        f"Written by pinotwin {__version__}. SI: m, rad, N, N·m, s. Positions are the URDF's joint positions.",
        "",
        "Joint, its effort, and the range that the curves cover (beyond it their last value holds):",
    ]
    for k, (name, unit) in enumerate(zip(inverse.names, inverse.units, strict=True)):
        x = "rad" if unit == "N·m" else "m"
        low, high = inverse.travel[:, k]
        lines.append(
            f"    {k}  {name} [{unit}]: {low:.4g} to {high:.4g} {x}, up to {inverse.speed[k]:.4g} {x}/s"
        )
    return [*lines, *left_out(inverse)]


def left_out(inverse: Inverse) -> list[str]:
    """Return a line for the effects that the file does not hold, none where it holds all."""
    lines = []
    if inverse.omitted:
        lines.append(f"left out, for no curve holds them: {', '.join(inverse.omitted)}")
    off = [
        f"{name} {error:.1%}"
        for name, error in zip(inverse.names, inverse.error, strict=True)
        if error > LARGE
    ]
    if off:
        lines.append(f"differs from the twin on a motion through the range by: {', '.join(off)} (RMS)")
    return lines
