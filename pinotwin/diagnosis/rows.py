"""The rows that a diagnosis looks at: every log thinned by one filter, standstill left out.

The columns of the model and the effort go through the same short low-pass before they are thinned
(the parallel filter of Gautier 1997), and a row counts only if the axis moves throughout the filter's
span: below that, dry friction is not a function of what the log shows. Only the search for friction
with a memory (:mod:`pinotwin.diagnosis.standstill`) takes all rows. Where a drive is at its limit, effort
and acceleration leap faster than either channel follows: such rows tell of the limit and of nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.ndimage import convolve1d

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.diagnosis.limits import reached
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.motion import Motion

Bend = Callable[[Motion, Motion], Motion]
ROW_RATE = 125.0  # [Hz] rows per second that are looked at
LEAST_RUN = 12  # rows in one go that are worth looking at
QUICK_ROWS = 1500  # of every axis that a quick look wants
MOST_LIMITED = 0.7  # of a log: a drive that is at its limit for longer leaves no other rows
SLOWEST = 0.001  # share of an axis' top speed below which its rows are left out


@dataclass(frozen=True)
class Thinner:
    """Low-pass and thin: a windowed mean over ``2 factor + 1`` samples, one row every ``factor``."""

    factor: int

    @property
    def weights(self) -> Floats:
        """Weights of the filter, shape (2 factor - 1,) or longer, sum 1."""
        if self.factor == 1:
            return np.ones(1)
        half = 2 * self.factor
        x = np.arange(-half, half + 1) / self.factor
        w = np.sinc(0.8 * x) * np.cos(0.5 * np.pi * x / (2.0 + 1.0 / self.factor)) ** 2
        return np.asarray(w / w.sum(), dtype=float)

    def centres(self, part: slice) -> Ints:
        """Return the samples that the rows of a stretch are centred on."""
        half = len(self.weights) // 2
        return np.arange(part.start + half, part.stop - half, self.factor)

    def apply(self, x: Floats, centres: Ints) -> Floats:
        """Return ``x`` (n, k) filtered at the centres, shape (m, k)."""
        w = self.weights
        half = len(w) // 2
        out = w[half] * x[centres]
        for k in range(1, half + 1):
            out += w[half + k] * (x[centres - k] + x[centres + k])
        return np.asarray(out)


@dataclass(frozen=True)
class Channel:
    """The rows of one joint in one log.

    Attributes:
        log: index of the log.
        joint: column of the joint.
        centres: samples of the log's motion, shape (m,).
        runs: unbroken runs among the rows.
        y: effort at the rows [N or N·m], shape (m,).
    """

    log: int
    joint: int
    centres: Ints
    runs: tuple[slice, ...]
    y: Floats


@dataclass(frozen=True)
class Rows:
    """All rows of a diagnosis.

    Attributes:
        machine: whose logs these are.
        motions: prepared logs, lightly filtered.
        thinner: filter that every column goes through.
        channels: per log and joint.
        commands: which logs repeat one command: a label per log.
        validation: which logs are for validation only.
        limited: (log, joint) -> samples at which a drive is at its limit, where one is.
    """

    machine: Machine
    motions: tuple[Motion, ...]
    thinner: Thinner
    channels: tuple[Channel, ...]
    commands: tuple[int, ...]
    validation: tuple[bool, ...]
    limited: Mapping[tuple[int, int], Mask] = field(default_factory=dict)

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints that have rows."""
        return tuple(sorted({c.joint for c in self.channels}))

    @property
    def fitted(self) -> Rows:
        """The rows without those of validation logs: all that may be fitted to."""
        kept = tuple(c for c in self.channels if not self.validation[c.log])
        return replace(self, channels=kept)

    @property
    def row_step(self) -> float:
        """Time between rows [s]."""
        return self.motions[0].step * self.thinner.factor

    @property
    def repeated(self) -> bool:
        """Whether a command was run more than once."""
        return len(set(self.commands)) < len(self.commands)


def take_rows(
    machine: Machine,
    logs: Sequence[Log],
    validation: Sequence[Log],
    *,
    coarse: int = 1,
    bend: Bend | None = None,
) -> Rows:
    """Prepare logs and choose their rows.

    Args:
        machine: whose logs they are.
        logs: logs to diagnose; those with the same command are repeats.
        validation: logs that no effect is fitted to.
        coarse: by how much fewer samples and rows are looked at.
        bend: puts the deflection of passive joints into a motion, beside what was measured of it.
    """
    every = [*logs, *validation]
    cutoff = machine.data.cutoff or 1e9
    read = [prepare(machine, log, cutoff=cutoff, decimate=1) for log in every]
    read = [_coarser(m, coarse) if coarse > 1 else m for m in read]
    motions = [sharp(m) if bend is None else bend(sharp(m), m) for m in read]
    factor = max(1, round(coarse / (motions[0].step * ROW_RATE)))
    thinner = Thinner(factor)
    flags = tuple([False] * len(logs) + [True] * len(validation))
    rows = Rows(machine, tuple(motions), thinner, (), _commands(motions), flags, _limited(motions, flags))
    rows = replace(rows, channels=_channels(rows, SLOWEST))
    if not rows.fitted.channels:
        raise DataError(
            f"{machine.name}: no axis moves for long enough in {', '.join(x.source for x in logs)} to say "
            f"anything (for {1e3 * LEAST_RUN * rows.row_step:.0f} ms in one go); give a log of longer moves"
        )
    return rows


def coarsest(logs: Sequence[Log], most: int) -> int:
    """Return by how much fewer samples are enough for a quick look: short logs are kept whole."""
    seconds = sum(float(np.ptp(log.t)) for log in logs)
    return int(np.clip(seconds * ROW_RATE // QUICK_ROWS, 1, most))


def _coarser(motion: Motion, count: int) -> Motion:
    """Return one sample in so many, positions and efforts as the mean over as many."""
    window = np.full(count, 1.0 / count)
    q, u = (convolve1d(x, window, axis=0, mode="nearest") for x in (motion.q, motion.u))
    return replace(motion, q=q, u=u).every(count)


def at_rest_too(rows: Rows) -> Rows:
    """Return the rows of the same logs with standstill and reversals."""
    return replace(rows, channels=_channels(rows, 0.0))


def _channels(rows: Rows, slowest: float) -> tuple[Channel, ...]:
    places = product(range(len(rows.motions)), range(rows.machine.nv))
    found = (_channel(rows, k, joint, slowest) for k, joint in places)
    return tuple(c for c in found if c is not None)


def _limited(motions: Sequence[Motion], flags: Sequence[bool]) -> dict[tuple[int, int], Mask]:
    """Return the samples at which drives are at their limits; logs that are sealed on their own."""
    out = {}
    for flag in (False, True):
        logs = [k for k, x in enumerate(flags) if x == flag]
        for joint in range(motions[0].q.shape[1]):
            limit = reached([motions[k] for k in logs], joint)
            if limit is not None and max(np.mean(x) for x in limit.samples) < MOST_LIMITED:
                out.update({(k, joint): x for k, x in zip(logs, limit.samples, strict=True)})
    return out


def sharp(motion: Motion) -> Motion:
    """Return the motion with derivatives of sixth order.

    Central differences lose 12 % of the acceleration at a tenth of the sampling rate, which a search for
    elastic drives takes for one.
    """
    q, step = motion.q, motion.step
    v, a = motion.v.copy(), motion.a.copy()
    first = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / (60.0 * step)
    second = np.array([2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]) / (180.0 * step**2)
    for part in motion.segments:
        if part.stop - part.start < 8:
            continue
        inner = slice(part.start + 3, part.stop - 3)
        n = inner.stop - inner.start
        v[inner] = sum(c * q[part.start + k : part.start + k + n] for k, c in enumerate(first))
        a[inner] = sum(c * q[part.start + k : part.start + k + n] for k, c in enumerate(second))
    vr, ar = motion.vr, motion.ar
    return replace(motion, v=v, a=a, vr=vr, ar=ar)


def _channel(rows: Rows, log: int, joint: int, slowest: float) -> Channel | None:
    motion, thinner = rows.motions[log], rows.thinner
    u = motion.u[:, joint]
    v = np.abs(motion.v[:, joint])
    good = (v >= slowest * v.max(initial=0.0)) & np.isfinite(u)
    if (log, joint) in rows.limited:
        good &= ~rows.limited[log, joint]
    half = len(thinner.weights) // 2
    kernel = np.ones(2 * half + 1)
    centres, runs, count = [], [], 0
    for part in motion.segments:
        inside = np.convolve(good[part].astype(float), kernel, "same") > len(kernel) - 0.5
        at = thinner.centres(part)
        keep = inside[at - part.start]
        for a, b in _stretches(keep):
            if b - a >= LEAST_RUN:
                centres.append(at[a:b])
                runs.append(slice(count, count + b - a))
                count += b - a
    if count < 40:
        return None
    where = np.concatenate(centres)
    load = u if motion.external is None else u + motion.external[:, joint]
    y = thinner.apply(np.nan_to_num(load)[:, None], where)[:, 0]
    return Channel(log, joint, where, tuple(runs), y)


def _stretches(keep: Mask) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], keep.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _commands(motions: Sequence[Motion]) -> tuple[int, ...]:
    """Return a label per log; logs that follow the same path in time share one."""
    labels: list[int] = []
    for k, motion in enumerate(motions):
        label = k
        for j in range(k):
            if _same(motions[j], motion):
                label = labels[j]
                break
        labels.append(label)
    return tuple(labels)


def _same(a: Motion, b: Motion) -> bool:
    x, y = (m.qr if m.qr is not None else m.q for m in (a, b))
    n = min(len(x), len(y))
    if n < 0.9 * max(len(x), len(y)):
        return False
    size = np.std(x[:n], axis=0) + 1e-12
    return bool((np.sqrt(np.mean((x[:n] - y[:n]) ** 2, axis=0)) < 0.01 * size + 1e-9).all())
