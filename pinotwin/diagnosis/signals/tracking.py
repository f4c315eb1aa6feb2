"""The tracking error's gap: the log's against that of the twin simulated from the command alone.

Before: the twin as it is. After: with the causes that were named, and the gains as they are now. The misfit is the
same difference on the twin's own logs, and what friction that differs from day to day does there. Without a closed
loop, or of a cause that cannot be simulated, nothing is said.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.columns import bind
from pinotwin.diagnosis.data.comparison import Comparison, by_days
from pinotwin.diagnosis.result import Gap, Shrink, shrunk
from pinotwin.errors import PinotwinError
from pinotwin.identification.coupled import with_factors
from pinotwin.log import Log
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.twin import Twin

LONGEST = 120_000  # Samples of the logs in question beyond which the tracking error is not simulated


@dataclass(frozen=True)
class Tracked:
    """What is said of the tracking error."""

    gaps: Mapping[str, Gap] = field(default_factory=dict)  # axis -> gap
    shrinks: Mapping[str, Shrink] = field(default_factory=dict)  # axis -> how far the causes shrink it


def tracked(c: Comparison, changed: Callable[[], tuple[Twin | None, set[str]]]) -> Tracked:
    """Return the same; ``changed`` gives the twin with the causes, and the axes all of whose causes it holds."""
    asked = [name for name in c.machine.axes if c.gate.asks("tracking", name)]
    if not asked or not c.twin.loops or c.new.motion.qr is None or len(c.new.motion) > LONGEST:
        return Tracked()
    # The first log in question promises how far it shrinks, those of validation tell it.
    logs, told = [c.logs[0], *c.validation] if c.validation else c.logs, slice(bool(c.validation), None)
    try:
        before = [_difference(c.twin, one.log, one.motion) for one in logs]
        stretch = own_run(c)
        own = np.full(c.machine.nv, np.nan) if stretch is None else _expected(c, *stretch)
    except PinotwinError:
        return Tracked()
    later, held = changed()
    try:
        after = before if later is None else [_difference(later, one.log, one.motion) for one in logs]
    except PinotwinError:
        later, after = None, before
    gaps, shrinks = {}, {}
    for name in asked:
        j = c.machine.axes[name].index
        x, y = (float(np.sqrt(np.mean([e[0][j] ** 2 for e in part[told]]))) for part in (before, after))
        size = float(np.sqrt(np.mean([e[1][j] ** 2 for e in before[told]])))
        if not np.isfinite(x) or size <= 0.0:
            continue
        gaps[name] = Gap(x, x / size, 0.0, min(x, y), float(own[j]))
        if later is not None and name in held and y < x:
            each = [1.0 - (b[0][j] / max(a[0][j], 1e-300)) ** 2 for a, b in zip(before, after, strict=True)]
            on, share = "validation" if c.validation else "fitted logs", 1.0 - (y / x) ** 2
            promised = each[0] if c.validation and np.isfinite(each[0]) else share
            shrinks[name] = shrunk(x, share, (min(each[told]), max(each[told])), promised, on, None)
    return Tracked(gaps, shrinks)


def _difference(twin: Twin, log: Log, motion: Motion) -> tuple[Floats, Floats]:
    """Return the RMS of measured minus simulated tracking error, and of the measured, shape (nv,) each."""
    nv = len(motion.names)
    off, size = np.full(nv, np.nan), np.full(nv, np.nan)
    for j, (measured, said) in simulated_errors(twin, log, motion).items():
        off[j], size[j] = rms(measured - said), rms(measured)
    return off, size


def _expected(c: Comparison, log: Log, motion: Motion) -> Floats:
    """Return the RMS that the twin leaves of the tracking error of a healthy day, shape (nv,)."""
    shares = {name: 1.0 + by_days(c, axis.index) for name, axis in c.machine.axes.items()}
    other = with_factors(c.twin, {name: (1.0, x, x, x, 1.0) for name, x in shares.items()})
    out, moved = np.full(c.machine.nv, np.nan), simulated_errors(other, log, motion)
    for j, (measured, said) in simulated_errors(c.twin, log, motion).items():
        out[j] = np.hypot(rms(measured - said), rms(moved[j][1] - said))
    return out


def simulated_errors(twin: Twin, log: Log, motion: Motion) -> dict[int, tuple[Floats, Floats]]:
    """Return joint -> measured tracking error and the one simulated from the command, on rows that move, (m,) each."""
    said, out = twin.simulate(log), {}
    for name, axis in twin.machine.axes.items():
        rows = motion.moving(axis.index)
        if f"{name}.e" in said and rows.any():
            guess = np.interp(motion.t, said.t, said[f"{name}.e"])
            out[axis.index] = motion.error[rows, axis.index], guess[rows]
    return out


def own_run(c: Comparison) -> tuple[Log, Motion] | None:
    """Return the longest stretch of the twin's own logs as a log, and its motion; None where it has no command."""
    if c.own is None or c.own.motion.qr is None or len(c.own.motion) > LONGEST:
        return None
    motion = c.own.motion
    longest = max(motion.segments, key=lambda s: s.stop - s.start)
    part = motion.cut(longest.start, longest.stop)
    assert part.qr is not None
    channels = {"t": part.t - part.t[0]}
    channels |= {f"{name}.qr": part.qr[:, a.index] for name, a in c.machine.axes.items()}
    channels |= {f"{name}.q": part.q[:, a.index] for name, a in c.machine.axes.items()}
    log = bind(Log(channels, source="the twin's logs"), {})
    return log, replace(part, t=channels["t"])
