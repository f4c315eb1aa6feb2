"""From a log to a motion: SI names, joint coordinates, one filter for every channel, rows chosen.

Positions are low-passed without phase shift and differentiated; all else goes through the same filter, so that no
channel leads another. Holes that :mod:`pinotwin.logs.clock` does not bridge, and jumps, split the log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.columns import bind
from pinotwin.errors import DataError, LogError
from pinotwin.log import Log
from pinotwin.logs import channels
from pinotwin.logs.clock import even_clock
from pinotwin.logs.files import LogLike, as_logs
from pinotwin.logs.quality.axes import inspect_axes
from pinotwin.logs.quality.sampling import resample as interpolated
from pinotwin.logs.settings import USUAL, Settings
from pinotwin.machine import DataSettings, LeftOut, Machine, MachineLike, as_machine
from pinotwin.motion import Motion
from pinotwin.signals import clock, differentiate, edge_samples, low_pass, rms, segments, suggest_cutoff
from pinotwin.solve.lead import put_back
from pinotwin.system.phrases import LOG

_DECIMATOR = 25  # samples that the filter of `decimate_zero_phase` needs


def prepare(  # noqa: PLR0913, the public call: every option is a keyword
    machine: MachineLike,
    log: LogLike | Sequence[LogLike],
    *,
    cutoff: float | None = None,
    decimate: int | None = None,
    order: int | None = None,
    resample: float | None = None,
    leave_out: Sequence[LeftOut] | None = None,
    lead: Mapping[str, float] | None = None,
    settings: Settings = USUAL,
) -> Motion:
    """Return one log, or several of the same machine, ready for identification and prediction.

    What is not given comes from machine.yaml. Logs of unequal rates are put on the slowest one's.

    Args:
        machine: whose log it is; or its folder, URDF or bundled name.
        log: servo log(s) or their files, raw or in the names of the contract.
        cutoff: corner of the low-pass [Hz], 0 for none; else from the spectra.
        decimate: fit one row in so many; else five rows a period of the corner.
        order: order of the Butterworth filter.
        resample: rate of the even clock to put the logs on [Hz].
        leave_out: rows that are no measurement, as :class:`~pinotwin.machine.DataSettings` has them.
        lead: axis -> time by which its effort is ahead of its position [s]; the effort is put back by it.
        settings: what is decided by.

    Raises:
        LogError: a channel is missing or unusable; the message names it.
        DataError: too little of the log can be used.
    """
    machine, logs = as_machine(machine), as_logs(log)
    how = replace(
        machine.data,
        order=order or machine.data.order,
        resample=resample or machine.data.resample,
        leave_out=machine.data.leave_out if leave_out is None else tuple(leave_out),
    )
    even = EvenLogs.of(machine, logs, how, settings)
    return even.motion(machine, cutoff=cutoff, decimate=decimate, lead=lead)


@dataclass(frozen=True, eq=False)
class EvenLogs:
    """Logs of one machine on one even clock, before any filter: motions of several corners are made of them."""

    logs: tuple[Log, ...]  # in the names of the contract
    how: DataSettings  # how they were made, and are filtered where nothing else is asked for
    settings: Settings = USUAL  # what is decided by

    @classmethod
    def of(
        cls, machine: Machine, logs: Sequence[Log], how: DataSettings, settings: Settings = USUAL
    ) -> EvenLogs:
        """Return logs, raw or in the names of the contract, on the clock of the slowest of them."""
        if not logs:
            raise DataError(f"{machine.name}: no log given; give at least one")
        even = [_regular(machine, item, how, settings) for item in logs]
        rates = [1.0 / _step(log.t, channels.stretches(machine, log)) for log in even]
        slowest = min(rates)
        same = (1.0 + settings.same_rate) * slowest
        pairs = zip(even, rates, strict=True)
        return cls(tuple(x if rate <= same else _resampled(x, slowest) for x, rate in pairs), how, settings)

    @property
    def whose(self) -> Ints:
        """Number of the log that each row of their motion is of, shape (n,)."""
        return np.repeat(np.arange(len(self.logs)), [len(x) for x in self.logs])

    def require_long(self) -> None:
        """Refuse logs that are too short, all together, to identify anything."""
        seconds = sum(clock(log.t).step * len(log) for log in self.logs)
        if seconds < self.settings.shortest:
            raise DataError(f"{self.logs[0].source}: {LOG['log_short'].format(seconds=seconds)}")

    def motion(
        self,
        machine: Machine,
        *,
        cutoff: float | None = None,
        decimate: int | None = None,
        lead: Mapping[str, float] | None = None,
    ) -> Motion:
        """Return the logs filtered, as :func:`prepare` does it; the options are its own."""
        leads = {name: axis.lead or 0.0 for name, axis in machine.axes.items()} | dict(lead or {})
        corner = cutoff if cutoff is not None else self.how.cutoff
        if corner is None:
            corner = min(_corner(machine, item) for item in self.logs)
        how = replace(self.how, cutoff=corner, decimate=decimate or self.how.decimate)
        parts = [_prepare_one(machine, item, how, leads, self.settings) for item in self.logs]
        return Motion.join(parts) if len(parts) > 1 else parts[0]


def _regular(machine: Machine, log: Log, how: DataSettings, settings: Settings) -> Log:
    """Return a log in the names and units of the contract, on an even clock; its notes say what was done to it."""
    bound = replace(channels.usable(machine, bind(log, machine.columns)), notes=())
    bound = without(bound, how.leave_out)
    even = even_clock(bound, list(machine.axes), settings)
    return even if how.resample is None else _resampled(even, how.resample)


def without(log: Log, leave_out: Sequence[LeftOut]) -> Log:
    """Return a bound log without rows that are no measurement, by (file, from, to) [s] or (file, channel, value)."""
    if not leave_out or "t" not in log:
        return log
    out = np.zeros(len(log), dtype=bool)
    for file, first, last in leave_out:
        if file not in ("", log.source, Path(log.source).name):
            continue
        if not isinstance(first, str):
            out |= (log.t >= first) & (log.t <= last)
        elif first in log:  # a feed rate, a program number
            out |= np.isclose(log[first], last, rtol=1e-9, atol=0.0)
        else:
            raise DataError(
                f"{log.source}: data.leave_out names the channel {first!r}, which this log lacks; map it "
                "under columns, or name the files that have it: leave_out: {FILE: [{CHANNEL: VALUE}]}"
            )
    if out.all():
        raise DataError(f"{log.source}: data.leave_out excludes every row; exclude fewer")
    if not out.any():
        return log
    kept = log.rows(~out)
    return kept.with_channels(kept.channels, [f"{int(out.sum())} rows left out as data.leave_out says"])


def _resampled(log: Log, rate: float) -> Log:
    """Return a log of even clock at another rate, low-passed before where that is lower."""
    now = clock(log.t).rate
    if rate >= 0.9 * now:
        return interpolated(log, rate)
    smooth = {}
    for name, x in log.channels.items():
        if name != "t":
            parts = [p for p in segments(log.t, valid=np.isfinite(x)) if p.stop - p.start > channels.SHORTEST]
            smooth[name] = low_pass(x, now, 0.4 * rate, segments=parts)
    said = interpolated(log.with_channels({**log.channels, **smooth}), rate, smooth=True)
    return replace(said, notes=(*said.notes, f"low-passed at {0.4 * rate:.4g} Hz before"))


def _corner(machine: Machine, log: Log) -> float:
    parts = channels.stretches(machine, log)
    q = np.stack([log[f"{name}.q"] for name in machine.axes], axis=1)
    return suggest_cutoff(q, 1.0 / _step(log.t, parts), parts)


def _step(t: Floats, parts: Sequence[slice]) -> float:
    """Return the mean sampling interval [s]: rounded stamps spoil the median, not the mean."""
    duration = sum(float(t[s.stop - 1] - t[s.start]) for s in parts)
    return duration / sum(s.stop - s.start - 1 for s in parts)


def _prepare_one(
    machine: Machine, log: Log, how: DataSettings, leads: Mapping[str, float], settings: Settings
) -> Motion:
    parts = channels.stretches(machine, log, max(channels.SHORTEST, 3 * how.order + 1))
    step = _step(log.t, parts)
    rate = 1.0 / step
    cutoff = how.cutoff or 0.0
    corner = cutoff if 0.0 < cutoff < 0.45 * rate else np.inf
    vibrates = any(f"{name}.v" in log for name in machine.passive)
    smoother = Smoother(step, corner, how.order, tuple(parts), vibrates or not np.isfinite(corner))
    q, v, a = smoother.derivatives(channels.joint_positions(machine, log, "q"))
    moves = _moves(machine, log, parts)
    q[:, ~moves], v[:, ~moves], a[:, ~moves] = q[np.r_[*parts]][:, ~moves].mean(axis=0), 0.0, 0.0
    v, a, notes = _measured_derivatives(machine, log, (v, a), smoother, moves, settings.other_speed)
    u, load = channels.efforts(machine, _put_back(log, leads, parts)), channels.external(machine, log)
    if how.filter_effort:
        u = np.where(np.isfinite(u), smoother.smooth(np.nan_to_num(u)), np.nan)
        load = None if load is None else smoother.smooth(load)
    qr = vr = ar = None
    if channels.has_commands(machine, log):
        qr, vr, ar = smoother.derivatives(channels.joint_positions(machine, log, "qr"))
    ql = channels.load_positions(machine, log)
    thin = how.decimate or (max(1, int(rate / (5.0 * corner))) if np.isfinite(corner) else 1)
    edge = edge_samples(corner, rate, how.order)
    head, tail = how.drop if how.drop is not None else (edge, edge)
    head += int(np.ceil(max(0.0, *leads.values()) * rate - 1e-9))
    tail += int(np.ceil(max(0.0, *(-x for x in leads.values())) * rate - 1e-9))
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
        ql=None if ql is None else smoother.smooth(ql),
        external=load,
        segments=_trimmed(parts, head, tail, channels.SHORTEST if thin == 1 else _DECIMATOR, log.source),
        step=step,
        use=_fast_enough(machine, v, a) & moves,
        decimation=thin,
        cutoff=corner,
        passband=corner if how.filter_effort else np.inf,
        order=how.order,
        on_load=() if qr is None else _on_load(machine, log),
        source=log.source,
        notes=tuple(f"{log.source}: {note}" for note in (*log.notes, *notes)),
    )


def _on_load(machine: Machine, log: Log) -> tuple[bool, ...]:
    """Return which columns' loops are closed on the load's encoder, which the log must have; empty for none."""
    closed = [name for name in machine.axes if machine.regulated(name).endswith(".ql")]
    for name in closed:
        if f"{name}.ql" not in log:
            raise LogError(
                f"{log.source}: no channel {name}.ql, on which loop.{name}.closed_on says that the loop is closed; "
                "record the load's encoder or name its column under `columns`"
            )
    return tuple(name in closed for name in machine.names) if closed else ()


def _put_back(log: Log, leads: Mapping[str, float], parts: Sequence[slice]) -> Log:
    """Return the log with every effort put back by the time that it is ahead: ``u(t - lead)``, by splines."""
    moved = {f"{name}.u": log[f"{name}.u"].copy() for name, x in leads.items() if x and f"{name}.u" in log}
    for channel, u in moved.items():
        for part in parts:
            u[part] = put_back(log.t[part], u[part], leads[channel.removesuffix(".u")])
    return log.with_channels({**log.channels, **moved}) if moved else log


@dataclass(frozen=True)
class Smoother:
    """The one filter of every channel; ``sharp`` slopes are of fourth order: others lose 3 % of 20 Hz at 400 Hz."""

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
    out = [slice(s.start + head, s.stop - tail) for s in parts if s.stop - s.start >= shortest + head + tail]
    if not out:
        longest = max(s.stop - s.start for s in parts)
        raise DataError(
            f"{source}: the longest of {len(parts)} unbroken stretches has {longest} samples, of "
            f"which the filter's start-up spoils {head} + {tail}; record longer or without breaks "
            "of the clock, or raise the cutoff"
        )
    return tuple(out)


def _measured_derivatives(
    machine: Machine, log: Log, motion: tuple[Floats, Floats], smoother: Smoother, moves: Mask, other: float
) -> tuple[Floats, Floats, tuple[str, ...]]:
    """Use the measured velocity of a joint, or its acceleration; say of which."""
    v, a = (x.copy() for x in motion)
    for name, part in machine.passive.items():
        if f"{name}.v" in log:
            v[:, part.index] = smoother.smooth(np.nan_to_num(log[f"{name}.v"]))
            a[:, part.index] = smoother.slope(v[:, part.index])
        elif f"{name}.a" in log:
            a[:, part.index] = smoother.smooth(np.nan_to_num(log[f"{name}.a"]))
    ratio = np.eye(machine.nv) if machine.transmission is None else machine.transmission
    motor_v, motor_a = v @ ratio.T, a @ ratio.T
    rows = np.r_[*smoother.stretches]
    used = []
    for name, axis in machine.axes.items():
        for channel, motor in ((f"{name}.v", motor_v), (f"{name}.a", motor_a)):
            if channel in log and moves[axis.index] and np.isfinite(log[channel][rows]).all():
                given = smoother.smooth(np.nan_to_num(log[channel]))
                _agrees(log, channel, motor[rows, axis.index], given[rows], other)
                motor[:, axis.index] = given
                used.append(channel)
        if used and used[-1] == f"{name}.v":
            motor_a[:, axis.index] = smoother.slope(motor_v[:, axis.index])
    if not used:
        return v, a, ()
    back = np.linalg.inv(ratio).T
    return motor_v @ back, motor_a @ back, (f"{', '.join(used)} as measured",)


def _agrees(log: Log, channel: str, derivative: Floats, given: Floats, other: float) -> None:
    """Refuse a measured speed or acceleration that is not that of the position."""
    off = rms(given - derivative) / max(rms(derivative), 1e-300)
    if off > other:
        what = "second derivative" if channel.endswith(".a") else "derivative"
        raise LogError(
            f"{log.source}: {channel}: is not the position's {what} (differs by {100 * off:.0f} %); correct "
            "its unit, sign or column under `columns` in machine.yaml, or leave it out"
        )


def _fast_enough(machine: Machine, v: Floats, a: Floats) -> Mask:
    """Return the rows above each axis' thresholds (thesis Section 3.3), below which friction is presliding, (n, nv)."""
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


def _moves(machine: Machine, log: Log, parts: Sequence[slice]) -> Mask:
    """Return which joints move at all, shape (nv,): an encoder's noise at rest is no motion."""
    rotary = {name: axis.rotary for name, axis in machine.axes.items()}
    table, _ = inspect_axes(log.rows(np.r_[*parts]), rotary, None)
    moving = {name for name, axis in table.items() if axis.moves}
    return np.array([name in moving or name in machine.passive for name in machine.names])


def _moving(v: Floats, limit: float | None) -> Mask:
    """Return the rows that move; none of an axis that stands still throughout."""
    speed = np.abs(v)
    top = float(speed.max(initial=0.0))
    return (speed > 0.0) & (speed >= (0.01 * top if limit is None else limit))
