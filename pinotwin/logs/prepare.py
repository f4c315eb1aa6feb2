"""From a log to a motion: SI names, joint coordinates, one filter for every channel, rows chosen.

Positions are low-passed without phase shift and differentiated by central differences; commands,
efforts and external loads go through the same filter, so that no channel leads another. The clock is made
even and holes of a sample or two are bridged (:mod:`pinotwin.logs.clock`, said in the motion's notes); nothing
else is repaired: a longer hole or a jump of the clock splits the log into stretches, and missing values do
too. An axis that only trembles with the noise of its encoder is taken as standing still.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.errors import DataError, LogError
from pinotwin.log import Log
from pinotwin.logs.channels import (
    SHORTEST,
    efforts,
    external,
    has_commands,
    joint_positions,
    stretches,
    usable,
)
from pinotwin.logs.clock import even_clock
from pinotwin.logs.columns import bind
from pinotwin.logs.quality.axes import inspect_axes
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.signals import differentiate, edge_samples, low_pass, suggest_cutoff

_DECIMATOR = 25  # samples that the filter of `decimate_zero_phase` needs
_SAME_RATE = 0.01  # logs whose rates differ by less are the same clock, measured twice


def prepare(
    machine: Machine,
    log: Log | Sequence[Log],
    *,
    cutoff: float | None = None,
    decimate: int | None = None,
) -> Motion:
    """Return one log, or several of the same machine, ready for identification and prediction.

    Args:
        machine: whose log it is.
        log: servo log(s), raw or in the names of the contract.
        cutoff: corner of the low-pass [Hz], 0 for none; from machine.yaml, else from the spectra.
        decimate: fit one row in so many; from machine.yaml, else four rows a period of the corner.

    Raises:
        LogError: a channel is missing or unusable; the message names it.
        DataError: too little of the log can be used.
    """
    logs = [log] if isinstance(log, Log) else list(log)
    if not logs:
        raise DataError(f"{machine.name}: no log given; give at least one")
    bound, notes = zip(*(_regular(machine, item) for item in logs), strict=True)
    corner = cutoff if cutoff is not None else machine.data.cutoff
    if corner is None:
        corner = min(_corner(machine, item) for item in bound)
    pairs = zip(bound, notes, strict=True)
    parts = [replace(_prepare_one(machine, item, corner, decimate), notes=said) for item, said in pairs]
    steps = [part.step for part in parts]
    if max(steps) > (1.0 + _SAME_RATE) * min(steps):
        each = ", ".join(f"{part.source} at {1.0 / part.step:.4g} Hz" for part in parts)
        raise LogError(f"logs are sampled differently ({each}); resample them with pt.resample")
    return Motion.join(parts) if len(parts) > 1 else parts[0]


def _regular(machine: Machine, log: Log) -> tuple[Log, tuple[str, ...]]:
    """Return a log in the names and units of the contract on an even clock, and what was done to it."""
    bound = usable(machine, bind(log, machine.columns))
    even = even_clock(bound, list(machine.axes))
    return even, tuple(f"{log.source}: {note}" for note in even.notes[len(bound.notes) :])


def _corner(machine: Machine, log: Log) -> float:
    parts = stretches(machine, log)
    q = np.stack([log[f"{name}.q"] for name in machine.axes], axis=1)
    return suggest_cutoff(q, 1.0 / _step(log.t, parts), parts)


def _step(t: Floats, parts: Sequence[slice]) -> float:
    """Return the mean sampling interval [s]: rounded stamps spoil the median, not the mean."""
    duration = sum(float(t[s.stop - 1] - t[s.start]) for s in parts)
    return duration / sum(s.stop - s.start - 1 for s in parts)


def _prepare_one(machine: Machine, log: Log, cutoff: float, decimate: int | None) -> Motion:
    settings = machine.data
    parts = stretches(machine, log, max(SHORTEST, 3 * settings.order + 1))
    step = _step(log.t, parts)
    rate = 1.0 / step
    corner = cutoff if 0.0 < cutoff < 0.45 * rate else np.inf
    vibrates = any(f"{name}.v" in log for name in machine.passive)
    smoother = Smoother(step, corner, settings.order, tuple(parts), vibrates)
    q, v, a = smoother.derivatives(joint_positions(machine, log, "q"))
    moves = _moves(machine, log, parts)
    q[:, ~moves], v[:, ~moves], a[:, ~moves] = q[_rows_of(parts)][:, ~moves].mean(axis=0), 0.0, 0.0
    v, a = _measured_derivatives(machine, log, v, a, smoother)
    u, load = efforts(machine, log), external(machine, log)
    if settings.filter_effort:
        u = np.where(np.isfinite(u), smoother.smooth(np.nan_to_num(u)), np.nan)
        load = None if load is None else smoother.smooth(load)
    qr = vr = ar = None
    if has_commands(machine, log):
        qr, vr, ar = smoother.derivatives(joint_positions(machine, log, "qr"))
    thin = _decimation(decimate or settings.decimate, corner, rate)
    edge = edge_samples(corner, rate, settings.order)
    head, tail = settings.drop if settings.drop is not None else (edge, edge)
    return Motion(
        names=machine.names,
        rotary=machine.rotary,
        t=log.t,
        q=q,
        v=v,
        a=a,
        u=u,
        qr=qr,
        vr=vr,
        ar=ar,
        external=load,
        segments=_trimmed(parts, head, tail, SHORTEST if thin == 1 else _DECIMATOR, log.source),
        step=step,
        use=_fast_enough(machine, v, a) & moves,
        decimation=thin,
        cutoff=corner,
        source=log.source,
    )


@dataclass(frozen=True)
class Smoother:
    """The one filter that every channel of a log goes through.

    With ``sharp`` derivatives are differences of fourth order: the usual ones lose 3 % of a 20 Hz
    acceleration that is sampled at 400 Hz, which a structural mode does not forgive.
    """

    step: float
    cutoff: float
    order: int
    stretches: tuple[slice, ...]
    sharp: bool = False

    def smooth(self, x: Floats) -> Floats:
        """Return ``x`` low-passed; rows outside the stretches pass."""
        return low_pass(x, 1.0 / self.step, self.cutoff, self.order, self.stretches)

    def slope(self, x: Floats) -> Floats:
        """Return the time derivative; zero outside the stretches."""
        out = np.nan_to_num(differentiate(x, self.step, self.stretches))
        if self.sharp:
            for s in self.stretches:
                y = x[s]
                out[s][2:-2] = (8.0 * (y[3:-1] - y[1:-3]) - (y[4:] - y[:-4])) / (12.0 * self.step)
        return out

    def derivatives(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Return ``x`` smoothed, and its first and second derivative."""
        x = self.smooth(x)
        v = self.slope(x)
        return x, v, self.slope(v)


def _trimmed(parts: Sequence[slice], head: int, tail: int, shortest: int, source: str) -> tuple[slice, ...]:
    """Return the stretches without the samples that the filter's start-up touches."""
    out = [slice(s.start + head, s.stop - tail) for s in parts]
    out = [s for s in out if s.stop - s.start >= shortest]
    if not out:
        longest = max(s.stop - s.start for s in parts)
        raise DataError(
            f"{source}: the longest of {len(parts)} unbroken stretches has {longest} samples, of "
            f"which the filter's start-up spoils {head} + {tail}; record longer or without breaks "
            "of the clock, or raise the cutoff"
        )
    return tuple(out)


def _decimation(given: int | None, cutoff: float, rate: float) -> int:
    if given is not None:
        return int(given)
    if not np.isfinite(cutoff):
        return 1
    return max(1, int(rate / (5.0 * cutoff)))


def _measured_derivatives(
    machine: Machine, log: Log, v: Floats, a: Floats, smoother: Smoother
) -> tuple[Floats, Floats]:
    """Use the measured velocity of a passive joint, or its acceleration where that is all there is.

    The acceleration comes from the velocity like that of every axis: what a difference loses at the
    joint's frequency must be lost on both sides of its equation.
    """
    v, a = v.copy(), a.copy()
    for name, part in machine.passive.items():
        if f"{name}.v" in log:
            v[:, part.index] = smoother.smooth(np.nan_to_num(log[f"{name}.v"]))
            a[:, part.index] = smoother.slope(v[:, part.index])
        elif f"{name}.a" in log:
            a[:, part.index] = smoother.smooth(np.nan_to_num(log[f"{name}.a"]))
    return v, a


def _fast_enough(machine: Machine, v: Floats, a: Floats) -> Mask:
    """Return the rows above each axis' speed or acceleration threshold (thesis Section 3.3).

    Below it dry friction is not a function of the velocity (presliding). Where the YAML gives no
    ``min_speed``, rows slower than 1 % of the axis' own top speed are left out; for a motor geared
    to two joints, also the rows in which that motor stands.
    """
    use = np.ones(v.shape, dtype=bool)
    for axis in machine.axes.values():
        if not any(effect.uses_standstill for effect in axis.effects):
            fast = _moving(v[:, axis.index], axis.min_speed)
            use[:, axis.index] &= fast | (np.abs(a[:, axis.index]) >= axis.min_acceleration)
        for effect in axis.effects:
            partner = getattr(effect, "partner", None)
            if partner is not None:
                other = machine.axes[partner].index
                both = _moving(v[:, axis.index] + v[:, other], None)
                use[:, axis.index] &= both
                use[:, other] &= both
    return use


def _rows_of(parts: Sequence[slice]) -> Ints:
    return np.concatenate([np.arange(s.start, s.stop) for s in parts])


def _moves(machine: Machine, log: Log, parts: Sequence[slice]) -> Mask:
    """Return which joints move at all, shape (nv,): an encoder's noise at rest is no motion."""
    rotary = {name: axis.rotary for name, axis in machine.axes.items()}
    rows = _rows_of(parts)
    inside = log.with_channels({name: x[rows] for name, x in log.channels.items()})
    table, _ = inspect_axes(inside, rotary, None)
    out = np.ones(machine.nv, dtype=bool)
    for name, axis in machine.axes.items():
        out[axis.index] = name in table and table[name].moves
    return out


def _moving(v: Floats, limit: float | None) -> Mask:
    """Return the rows that move; none of an axis that stands still throughout."""
    speed = np.abs(v)
    top = float(speed.max(initial=0.0))
    return (speed > 0.0) & (speed >= (0.01 * top if limit is None else limit))
