"""A log made ready for a machine: SI, the velocity order of ``machine.model``, all channels filtered the same way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Self

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.errors import DataError, nearest
from pinotwin.notebook import Card, Shown
from pinotwin.signals.filters import interior, low_pass

CHANNELS = ("t", "q", "v", "a", "u", "use", "qr", "vr", "ar", "ql", "external", "model", "rigid", "mass")


@dataclass(frozen=True)
class AxisMotion:
    """The motion of one joint; arrays of shape (n,), SI."""

    name: str  # of the axis
    index: int  # column of the axis in the machine's arrays
    rotary: bool  # True for rad, False for m
    t: Floats  # time [s]
    q: Floats  # position [m or rad]
    v: Floats  # velocity [m/s or rad/s]
    a: Floats  # acceleration [m/s² or rad/s²]
    segments: tuple[slice, ...]  # stretches of unbroken, uniform sampling
    step: float  # sampling interval [s]


@dataclass(frozen=True, repr=False)
class Motion(Card):
    """A log made ready; arrays of shape (n, nv) unless said otherwise, SI.

    Attributes:
        names: joint (axis) name of every column, in the model's velocity order.
        rotary: whether each column is a rotation.
        t: time [s], shape (n,).
        q: position [m or rad].
        v: velocity.
        a: acceleration.
        u: motor effort [N or N·m]; NaN where the joint has no motor or no such channel.
        qr: command, or None where the log has none; likewise its derivatives ``vr`` and ``ar``.
        ql: position measured at the load (linear scale, link encoder) [m or rad], NaN where the axis has no
            such encoder; None where no axis has.
        on_load: which columns' loops are closed on ``ql``; empty for none.
        external: joint effort of the logged external loads (J^T f), zero where none.
        model: effort of a twin's model in this motion, None outside of a twin. Effects that scale with
            effort (delay, effort_scale, saturation) take it from here, never from the measured effort,
            which holds what they are to explain. :func:`pinotwin.effects.with_model_effort` fills it.
        rigid: the rigid-body part of ``model``: what gear and bearing carry.
        mass: inertia matrix along the motion, shape (n, nv, nv) [kg, kg·m or kg·m²].
        segments: stretches of unbroken, uniform sampling.
        step: sampling interval [s].
        use: rows that identification may use, per joint: away from edges, above the thresholds.
        decimation: keep one row in so many when the rows are fitted.
        cutoff: corner of the zero-phase low-pass that every channel went through [Hz], inf for none.
        passband: that of the effort, inf where it was not filtered; ``order`` of that filter.
        source: where the log came from.
        notes: what was done to its clock and holes, one sentence each, after the log's name.
    """

    names: tuple[str, ...]
    rotary: tuple[bool, ...]
    t: Floats
    q: Floats
    v: Floats
    a: Floats
    u: Floats
    segments: tuple[slice, ...]
    step: float
    use: Mask
    qr: Floats | None = None
    vr: Floats | None = None
    ar: Floats | None = None
    ql: Floats | None = None
    external: Floats | None = None
    model: Floats | None = None
    rigid: Floats | None = None
    mass: Floats | None = None
    decimation: int = 1
    cutoff: float = np.inf
    passband: float = np.inf
    order: int = 4
    on_load: tuple[bool, ...] = ()
    source: str = ""
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.t)

    def index(self, name: str) -> int:
        """Return the column of a joint; DataError if there is none of that name."""
        try:
            return self.names.index(name)
        except ValueError:
            raise DataError(f"no joint {name!r} in this motion; {nearest(name, self.names)}") from None

    def axis(self, name: str) -> AxisMotion:
        """Return the motion of one joint."""
        i = self.index(name)
        q, v, a = (x[:, i] for x in (self.q, self.v, self.a))
        return AxisMotion(name, i, self.rotary[i], self.t, q, v, a, self.segments, self.step)

    @property
    def regulated(self) -> Floats:
        """Position that the controllers regulate: of the motors, or of the load where a loop is closed there."""
        if self.ql is None or not any(self.on_load):
            return self.q
        return np.where(self.on_load, self.ql, self.q)

    @property
    def error(self) -> Floats:
        """Tracking error, command minus regulated position, shape (n, nv)."""
        assert self.qr is not None
        return np.asarray(self.qr - self.regulated)

    @cached_property
    def inside(self) -> Mask:
        """Rows that lie in an unbroken stretch, shape (n,)."""
        return interior(len(self), 0, self.segments)

    def moving(self, joint: int) -> Mask:
        """Return the rows on which errors of one joint's effort are stated: in motion, with an effort."""
        return self.inside & self.use[:, joint] & np.isfinite(self.u[:, joint])

    def passed(self, x: Floats) -> Floats:
        """Return columns (n, k) after the low-pass that the effort went through (*parallel filter*, Gautier 1997).

        A friction that turns round within a sample, beside a filtered effort, reads too small, its rest as viscous.
        """
        if not np.isfinite(self.passband):
            return x
        long = [s for s in self.segments if s.stop - s.start > 3 * self.order]
        return low_pass(x, 1.0 / self.step, self.passband, self.order, long)

    def cut(self, start: int, stop: int) -> Self:
        """Return rows ``start:stop`` as a motion of their own."""
        inside = [
            slice(max(s.start, start) - start, min(s.stop, stop) - start)
            for s in self.segments
            if s.start < stop and s.stop > start
        ]
        return self._taken(slice(start, stop), inside)

    def every(self, count: int) -> Self:
        """Return one row in so many of every segment; nothing is filtered here."""
        rows = [np.arange(s.start, s.stop, count) for s in self.segments]
        ends = np.cumsum([0, *map(len, rows)])
        picked = np.concatenate(rows) if rows else np.zeros(0, dtype=int)
        segments = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        thinner = max(1, round(self.decimation / count))
        return self._taken(picked, segments, step=self.step * count, decimation=thinner)

    def at(self, rows: Ints, block: Ints | None = None) -> Self:
        """Return ascending ``rows``, shape (m,), even within each ``block``, (m,), as a motion; nothing is filtered."""
        block = np.zeros(len(rows), dtype=np.intp) if block is None else block
        edges = [0, *(np.flatnonzero(np.diff(block)) + 1).tolist(), len(rows)]
        segments = [slice(a, b) for a, b in pairwise(edges)]
        every = int(rows[1] - rows[0]) if len(rows) > 1 else 1
        return self._taken(rows, segments, step=self.step * every, decimation=1)

    def _taken(self, rows: slice | Ints, segments: Sequence[slice], **other: Any) -> Self:
        """Return some rows of every channel that there is, in these segments."""
        every = {name: getattr(self, name) for name in CHANNELS}
        kept: dict[str, Any] = {k: None if x is None else x[rows] for k, x in every.items()}
        return replace(self, segments=tuple(segments), **kept, **other)

    def _shown(self) -> Shown:
        rows = []
        for k, name in enumerate(self.names):
            x = "rad" if self.rotary[k] else "m"
            q, v = self.q[:, k], np.abs(self.v[:, k])
            travel = f"{np.nanmin(q):.4g} to {np.nanmax(q):.4g} {x}" if np.isfinite(q).any() else ""
            fast = f"{np.nanmax(v):.3g} {x}/s" if np.isfinite(v).any() else ""
            rows.append((name, travel, fast, f"{float(np.mean(self.use[:, k])):.0%}"))
        note = f"{1.0 / self.step:.6g} Hz, {len(self.segments)} stretch(es), corner {self.cutoff:.4g} Hz"
        return f"Motion {self.source}: {len(self)} rows", ("axis", "travel", "up to", "used"), rows, note

    @classmethod
    def exact(
        cls, joints: tuple[Sequence[str], Sequence[bool]], t: Floats, *qva: Floats, **rest: Any
    ) -> Motion:
        """Return what is known without a log as one stretch: nothing is filtered, no effort is measured.

        ``joints``: names and rotary of the columns; ``t`` [s], (n,), NaN without a clock; ``qva``, ``rest``: (n, nv).
        """
        q, v, a = qva
        names, rotary = joints
        span = float(t[-1] - t[0]) / (len(t) - 1) if len(t) > 1 else 0.0
        made: dict[str, Any] = {
            "u": np.full_like(q, np.nan),
            "segments": (slice(0, len(q)),),
            "step": span if np.isfinite(span) else 0.0,
            "use": np.ones(q.shape, dtype=bool),
        }
        return cls(names=tuple(names), rotary=tuple(rotary), t=t, q=q, v=v, a=a, **(made | rest))

    @classmethod
    def join(cls, parts: Sequence[Motion]) -> Motion:
        """Return several motions of one machine as one, their segments kept apart."""
        starts = zip(parts, np.cumsum([0, *map(len, parts[:-1])]).tolist(), strict=True)
        segments = tuple(slice(s.start + at, s.stop + at) for part, at in starts for s in part.segments)
        every = {name: [getattr(part, name) for part in parts] for name in CHANNELS}
        arrays: dict[str, Any] = {
            k: None if any(x is None for x in each) else np.concatenate(each) for k, each in every.items()
        }
        notes = tuple(note for part in parts for note in part.notes)
        return replace(parts[0], segments=segments, notes=notes, **arrays)
