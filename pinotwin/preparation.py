"""From a log to a motion: SI names, joint coordinates, one filter for every channel, rows chosen.

Positions are low-passed without phase shift and differentiated by central differences; commands,
efforts and external loads go through the same filter, so that no channel leads another. Nothing is
repaired: a hole or a jump of the clock splits the log into stretches, and a NaN does too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.columns import bind
from pinotwin.dynamics.frames import external_effort
from pinotwin.errors import DataError, LogError, nearest
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.signals import differentiate, edge_samples, low_pass, segments, suggest_cutoff

_WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
SHORTEST = 20  # samples: a stretch must be longer than the filter's own memory to be of use


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
        cutoff: corner of the low-pass [Hz], 0 for none; from machine.yaml, else from the spectra of the log.
        decimate: fit one row in so many; from machine.yaml, else four rows a period of the corner.

    Raises:
        LogError: a channel is missing or unusable; the message names it.
        DataError: too little of the log can be used.
    """
    logs = [log] if isinstance(log, Log) else list(log)
    bound = [bind(item, machine.columns) for item in logs]
    corner = cutoff if cutoff is not None else machine.data.cutoff
    if corner is None:
        corner = min(_corner(machine, item) for item in bound)
    parts = [_prepare_one(machine, item, corner, decimate) for item in bound]
    steps = {round(p.step, 9) for p in parts}
    if len(steps) > 1:
        raise LogError(
            f"logs of one call are sampled differently ({', '.join(f'{1 / s:g} Hz' for s in steps)}); "
            "resample them first"
        )
    return Motion.join(parts) if len(parts) > 1 else parts[0]


def _corner(machine: Machine, log: Log) -> float:
    t = log.t
    pieces = _stretches(machine, log)
    longest = max(pieces, key=lambda s: s.stop - s.start)
    step = _step(t, [longest])
    names = [name for name in machine.axes if f"{name}.q" in log]
    q = np.stack([log[f"{name}.q"][longest] for name in names], axis=1)
    return suggest_cutoff(q, 1.0 / step)


def _step(t: Floats, stretches: Sequence[slice]) -> float:
    """Return the mean sampling interval [s]: rounded stamps spoil the median, not the mean."""
    duration = sum(float(t[s.stop - 1] - t[s.start]) for s in stretches)
    return duration / sum(s.stop - s.start - 1 for s in stretches)


def _prepare_one(machine: Machine, log: Log, cutoff: float, decimate: int | None) -> Motion:
    stretches = _stretches(machine, log)
    step = _step(log.t, stretches)
    rate, settings = 1.0 / step, machine.data
    corner = cutoff if 0.0 < cutoff < 0.45 * rate else np.inf
    smoother = Smoother(step, corner, settings.order, tuple(stretches))
    q, v, a = smoother.derivatives(_joint_positions(machine, log, "q"))
    v, a = _measured_derivatives(machine, log, v, a, smoother)
    u, external = _efforts(machine, log), _external(machine, log)
    if settings.filter_effort:
        u = np.where(np.isfinite(u), smoother.smooth(np.nan_to_num(u)), np.nan)
        external = None if external is None else smoother.smooth(external)
    qr = vr = ar = None
    if _has_commands(machine, log):
        qr, vr, ar = smoother.derivatives(_joint_positions(machine, log, "qr"))
    return Motion(
        names=machine.names, rotary=machine.rotary, t=log.t, q=q, v=v, a=a, u=u,
        qr=qr, vr=vr, ar=ar, external=external,
        segments=_trimmed(stretches, settings.drop, edge_samples(corner, rate, settings.order), log),
        step=step, use=_fast_enough(machine, v),
        decimation=_decimation(decimate or settings.decimate, corner, rate),
        cutoff=corner, source=log.source,
    )  # fmt: skip


@dataclass(frozen=True)
class Smoother:
    """The one filter that every channel of a log goes through."""

    step: float
    cutoff: float
    order: int
    stretches: tuple[slice, ...]

    def smooth(self, x: Floats) -> Floats:
        """Return ``x`` low-passed; rows outside the stretches pass."""
        return low_pass(x, 1.0 / self.step, self.cutoff, self.order, self.stretches)

    def slope(self, x: Floats) -> Floats:
        """Return the time derivative; zero outside the stretches."""
        return np.nan_to_num(differentiate(x, self.step, self.stretches))

    def derivatives(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Return ``x`` smoothed, and its first and second derivative."""
        x = self.smooth(x)
        v = self.slope(x)
        return x, v, self.slope(v)


def _trimmed(
    stretches: Sequence[slice], drop: tuple[int, int] | None, edge: int, log: Log
) -> tuple[slice, ...]:
    """Return the stretches without the samples that the filter's start-up touches."""
    head, tail = drop if drop is not None else (edge, edge)
    out = [slice(s.start + head, s.stop - tail) for s in stretches]
    out = [s for s in out if s.stop - s.start >= SHORTEST]
    if not out:
        raise DataError(
            f"{log.source}: nothing left after cutting {head} + {tail} samples at the ends of each "
            "stretch; record longer, or raise `data.cutoff`"
        )
    return tuple(out)


def _decimation(given: int | None, cutoff: float, rate: float) -> int:
    if given is not None:
        return int(given)
    if not np.isfinite(cutoff):
        return 1
    return max(1, int(rate / (5.0 * cutoff)))


def _stretches(machine: Machine, log: Log) -> list[slice]:
    """Return the stretches of regular sampling in which every needed channel is a number."""
    for name in machine.axes:
        if f"{name}.q" not in log:
            raise LogError(
                f"{log.source}: no channel {name}.q (position of axis {name}); name its column under "
                f"`columns` in machine.yaml, or drop the axis; {nearest(f'{name}.q', log.channels)}"
            )
    if "t" not in log:
        raise LogError(
            f"{log.source}: no time channel t; name its column under `columns` in machine.yaml, or "
            "give `t: {rate: ...}`"
        )
    good = np.isfinite(log.t)
    for name in machine.axes:
        for kind in ("q", "u", "qr"):
            channel = f"{name}.{kind}"
            if channel in log:
                good &= np.isfinite(log[channel])
    out = [s for s in segments(log.t, valid=good) if s.stop - s.start >= SHORTEST]
    if not out:
        raise DataError(
            f"{log.source}: no stretch of {SHORTEST} regular samples without NaN; see `pinotwin check`"
        )
    return out


def _joint_positions(machine: Machine, log: Log, kind: str) -> Floats:
    """Return positions in joint coordinates: ``q = N^-1 q_motor + zero``."""
    x = np.zeros((len(log), machine.nv))
    for name, axis in machine.axes.items():
        x[:, axis.index] = np.nan_to_num(log[f"{name}.{kind}"])
    if machine.transmission is not None:
        x = np.linalg.solve(machine.transmission, x.T).T
    for axis in machine.axes.values():
        x[:, axis.index] += axis.zero
    if kind == "q":
        for name, part in machine.passive.items():
            if f"{name}.q" in log:
                x[:, part.index] = np.nan_to_num(log[f"{name}.q"])
    return x


def _has_commands(machine: Machine, log: Log) -> bool:
    present = [f"{name}.qr" in log for name in machine.axes]
    if any(present) and not all(present):
        missing = [n for n, there in zip(machine.axes, present, strict=True) if not there]
        raise LogError(
            f"{log.source}: command missing for axis {', '.join(missing)} (channel "
            f"{missing[0]}.qr) while other axes have theirs; give all of them or none"
        )
    return all(present)


def _efforts(machine: Machine, log: Log) -> Floats:
    """Return joint efforts ``tau = N^T tau_motor``; NaN without a channel, 0 for a passive joint."""
    u = np.full((len(log), machine.nv), np.nan)
    for name, axis in machine.axes.items():
        if f"{name}.u" in log:
            u[:, axis.index] = log[f"{name}.u"]
    if machine.transmission is not None:
        u = u @ machine.transmission
    for name, part in machine.passive.items():
        if f"{name}.q" in log or f"{name}.a" in log:
            u[:, part.index] = 0.0
    return u


def _external(machine: Machine, log: Log) -> Floats | None:
    """Return the joint effort of the logged external loads, or None where there is none."""
    total = None
    frames = {frame.name for frame in machine.model.frames}
    for link in sorted({c.rsplit(".", 1)[0] for c in log.channels if c.rsplit(".", 1)[-1] in _WRENCH}):
        if link not in frames:
            raise LogError(
                f"{log.source}: external load on {link!r}, which is no link of {machine.name}; "
                f"{nearest(link, frames)}"
            )
        wrench = np.zeros((len(log), 6))
        for k, part in enumerate(_WRENCH):
            if f"{link}.{part}" in log:
                wrench[:, k] = np.nan_to_num(log[f"{link}.{part}"])
        q = _joint_positions(machine, log, "q")
        effort = external_effort(machine.model, link, q, wrench)
        total = effort if total is None else total + effort
    return total


def _measured_derivatives(
    machine: Machine, log: Log, v: Floats, a: Floats, smoother: Smoother
) -> tuple[Floats, Floats]:
    """Use the velocity and acceleration of a passive joint where its angle was not measured."""
    v, a = v.copy(), a.copy()
    for name, part in machine.passive.items():
        if f"{name}.v" in log:
            v[:, part.index] = smoother.smooth(np.nan_to_num(log[f"{name}.v"]))
            a[:, part.index] = smoother.slope(v[:, part.index])
        if f"{name}.a" in log:
            a[:, part.index] = smoother.smooth(np.nan_to_num(log[f"{name}.a"]))
    return v, a


def _fast_enough(machine: Machine, v: Floats) -> Mask:
    """Return the rows above each axis' speed threshold (thesis Section 3.3).

    Below it dry friction is not a function of the velocity (presliding). Where the YAML gives no
    ``min_speed``, rows slower than 1 % of the axis' own top speed are left out; for a motor geared to
    two joints, also the rows in which that motor stands.
    """
    use = np.ones(v.shape, dtype=bool)
    for axis in machine.axes.values():
        if not any(effect.uses_standstill for effect in axis.effects):
            use[:, axis.index] &= _moving(v[:, axis.index], axis.min_speed)
        for effect in axis.effects:
            partner = getattr(effect, "partner", None)
            if partner is not None:
                other = machine.axes[partner].index
                both = _moving(v[:, axis.index] + v[:, other], None)
                use[:, axis.index] &= both
                use[:, other] &= both
    return use


def _moving(v: Floats, limit: float | None) -> Mask:
    """Return the rows that move; none of an axis that stands still throughout."""
    speed = np.abs(v)
    top = float(speed.max(initial=0.0))
    return (speed > 0.0) & (speed >= (0.01 * top if limit is None else limit))


def with_rows(motion: Motion, use: Mask) -> Motion:
    """Return the motion with other rows to identify from."""
    return replace(motion, use=use)
