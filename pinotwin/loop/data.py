"""The data of one control loop: inputs and outputs of one axis, checked once.

Disturbances and the *velocity* of the command run straight between samples (first-order hold), as an exact
discretisation needs it said; where the log has no velocity of the command it comes from a cubic spline through ``qr``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import scipy

from pinotwin.arrays import Floats
from pinotwin.errors import DataError


@dataclass(frozen=True)
class LoopData:
    """Inputs and outputs of one axis on one clock; n samples, SI."""

    step: float  # sampling interval [s]
    qr: Floats  # position command [m or rad], shape (n,)
    d: Floats  # generalised disturbances [N or N·m], shape (n, nd) or (n,); the axis' own first
    outputs: Floats  # shape (n, ny): tracking error, motor effort, and then any structural velocity
    # stretches of unbroken sampling; the state at the start of each is unknown
    segments: tuple[slice, ...] = ()
    vr: Floats = field(default=None)  # type: ignore[arg-type]  # velocity of the command; by spline where absent
    ar: Floats = field(default=None)  # type: ignore[arg-type]  # acceleration of the command; likewise
    axis: str = "axis"  # name of the axis, for messages and signal names
    output_names: tuple[str, ...] = ("e", "u")  # names of the outputs
    disturbance_names: tuple[str, ...] = ("d",)  # names of the disturbances

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "qr", np.asarray(self.qr, dtype=float))
        for name in ("d", "outputs"):
            x = np.asarray(getattr(self, name), dtype=float)
            put(self, name, x[:, None] if x.ndim == 1 else x)
        put(self, "segments", tuple(self.segments) or (slice(0, len(self.qr)),))
        put(self, "output_names", _names(self.output_names, self.outputs.shape[1], "v"))
        put(self, "disturbance_names", _names(self.disturbance_names, self.d.shape[1], "d"))
        for name, x in zip(("vr", "ar"), _rates(self), strict=True):
            put(self, name, x)
        for name in ("qr", "d", "vr", "ar", "outputs"):
            if not all(np.isfinite(getattr(self, name)[s]).all() for s in self.segments):
                raise DataError(
                    f"{self.axis}: {name} has NaN or infinite samples inside a segment; "
                    "split the segments around the gap"
                )

    @property
    def rows(self) -> int:
        """Number of samples inside the segments."""
        return sum(s.stop - s.start for s in self.segments)

    def within(self, segments: Sequence[slice]) -> Self:
        """Return the same channels with other segments."""
        return replace(self, segments=tuple(segments))

    def require_motion(self, rows: int = 64) -> None:
        """Refuse data from which no loop can be identified, among them fewer rows than these."""
        if self.rows < rows:
            raise DataError(
                f"{self.axis}: {self.rows} samples in unbroken segments, at least {rows} "
                "are needed to identify the loop; give a longer log"
            )
        inside = np.r_[*self.segments]
        if np.ptp(self.vr[inside]) <= 1e-12:
            raise DataError(
                f"{self.axis}: the command never moves in this log, so its loop cannot be "
                "identified; give a log in which the axis moves"
            )
        for names, values in ((self.output_names, self.outputs), (self.disturbance_names, self.d)):
            flat = np.flatnonzero(np.ptp(values[inside], axis=0) == 0.0)
            if len(flat):
                raise DataError(
                    f"{self.axis}: channel {names[flat[0]]!r} is constant over the whole log, so "
                    "its transfer functions cannot be identified; check the channel or leave it out"
                )


def command_rates(qr: Floats, step: float) -> tuple[Floats, Floats]:
    """Return velocity and acceleration of a sampled command by a cubic spline, shapes (n,)."""
    if len(qr) < 4:
        velocity = np.gradient(qr, step) if len(qr) > 1 else np.zeros(len(qr))
        return velocity, np.zeros(len(qr))
    t = step * np.arange(len(qr))
    spline = scipy.interpolate.CubicSpline(t, qr)
    return spline(t, 1), spline(t, 2)


def rates(qr: Floats, step: float, vr: Floats | None, ar: Floats | None) -> tuple[Floats, Floats]:
    """Return velocity and acceleration of a command as given, by spline where they are not."""
    if vr is None:
        vr, spline = command_rates(qr, step)
        return vr, spline if ar is None else ar
    return vr, command_rates(vr, step)[0] if ar is None else ar


def _rates(data: LoopData) -> tuple[Floats, Floats]:
    if data.vr is not None and data.ar is not None:
        return np.asarray(data.vr, dtype=float), np.asarray(data.ar, dtype=float)
    velocity, acceleration = np.zeros((2, len(data.qr)))
    for s in data.segments:
        given = (None if x is None else np.asarray(x, dtype=float)[s] for x in (data.vr, data.ar))
        velocity[s], acceleration[s] = rates(data.qr[s], data.step, *given)
    return velocity, acceleration


def _names(names: tuple[str, ...], count: int, stem: str) -> tuple[str, ...]:
    extra = tuple(f"{stem}{i + 1}" for i in range(len(names), count))
    return (tuple(names) + extra)[:count]
