"""One axis as its controller is searched: the command, what was measured, and the identified plant, simulated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.loop.margins import command_peak, stable
from pinotwin.loop.servo import Servo
from pinotwin.simulation import axis_kernel
from pinotwin.simulation.axis_kernel import Axis
from pinotwin.simulation.law import Law, substeps
from pinotwin.simulation.state import Command, Lookup

Usual = Mapping[str, tuple[float, float]]
DRIVES: Usual = {
    "velocity_lag": (4e-4, 1.0),
    "output_lag": (2e-4, 1.0),
    "dead": (1.2e-4, 1.0),
    "notch1": (0.1, 0.5),
    "notch2": (0.6, 0.4),
}
"""Usual shapes of drives [s, -] and the standard deviation of their logarithms.

At 200 Hz a log tells lags of a millisecond and the flanks of a notch badly apart; what it leaves open is
better usual than anything.
"""
SLOWEST, FASTEST, COMMANDS, THROWN_OFF = 0.05, 0.4, 60, 10.0
"""Frequencies of commands [Hz; share of the log's rate], how many, and the tracking error, over the command's size,
with which a controller throws its axis off: what a slow ramp leaves open of a law may be a thousand times that."""
PLANT = ("inertia", "viscous", "dry", "fading", "distance")
Factors = tuple[float, float, float, float, float]
"""On inertia, viscous friction, dry friction at speed, the part of it that fades with speed, and the distance over
which it turns round (presliding)."""
AS_FOUND: Factors = (1.0, 1.0, 1.0, 1.0, 1.0)
Check = Callable[[Factors], bool]  # Whether factors are believed


@cache
def _commands(step: float) -> Floats:
    """Return the frequencies of the commands that a controller has to bear [Hz]; asked for thousands of times."""
    return np.geomspace(SLOWEST, FASTEST / step, COMMANDS)


def skipped(step: float, seconds: float = 0.25) -> int:
    """Return the rows, ``step`` seconds apart, that are not compared as a window begins: its state was measured."""
    return int(seconds / step)


@dataclass(frozen=True)
class AxisProblem:
    """One axis alone: its command, what was measured, and what the plant says of it; ``noise`` (2,) is that of e and u.

    Of windows that meet the later goes on where the earlier ends: what friction and integrator hold is not measured.
    """

    step: float  # sampling interval [s]
    qr: Floats  # command, shape (n,)
    vr: Floats  # its velocity
    q: Floats  # measured position that is regulated, shape (n,)
    v: Floats  # its velocity (smooth), shape (n,)
    u: Floats  # effort, shape (n,)
    load: Floats  # effort that helps the motor: less all but inertia and own friction, shape (n,)
    inertia: float  # M_D of the axis
    viscous: float  # C of the axis
    tables: Lookup  # the axis' own friction
    windows: tuple[slice, ...]  # rows to simulate, in order
    fine: float = 5e-4  # longest internal step [s]
    lead: tuple[slice, ...] = ()  # rows that may be simulated before the windows, and are not compared
    stretches: tuple[slice, ...] = ()  # rows without a gap
    sizes: Floats = field(default_factory=lambda: np.ones(2))  # RMS of e and u over the windows, shape (2,)
    noise: Floats = field(default_factory=lambda: np.ones(2))  # share below which an error is none
    usual: Usual = field(default_factory=lambda: DRIVES)  # usual shapes
    correlated: float = 20.0  # rows of residual that tell as much as one independent row
    quiet: float = 5e-4  # error of a signal, as a share of its RMS, that is no worse than none

    @property
    def substeps(self) -> int:
        """Internal steps a sample."""
        return substeps(self.step, self.fine)

    @property
    def skip(self) -> int:
        """Rows at the beginning of a window that are not compared."""
        return skipped(self.step)

    def within(self, windows: Sequence[slice]) -> AxisProblem:
        """Return the same axis with other windows."""
        return replace(self, windows=tuple(windows), lead=())

    def response(self, servo: Servo, extra: Factors = AS_FOUND) -> Floats | None:
        """Return simulated e and u on all windows, shape (rows, 2), or None if the axis runs away."""
        if extra != AS_FOUND:
            return self.with_plant(extra).response(servo)
        axis, out = self._axis(servo, self.step / self.substeps), []
        for course, start, compared in self._courses:
            y = axis_kernel.run(axis, self.tables, course, start)
            if y is None:
                return None
            out += [y[rows] for rows in compared]
        return np.concatenate(out)

    @property
    def step_of_slopes(self) -> float:
        """Step of a difference quotient over what is searched: friction with a memory is rough below a thousandth."""
        return 1e-3 if len(self.tables.slips) or len(self.tables.speeds) else 1e-6

    def holds(self, servo: Servo, extra: Factors = AS_FOUND) -> bool:
        """Whether a controller holds the axis on any command, where nothing but viscous friction helps it."""
        plant = extra[0] * self.inertia, extra[1] * self.viscous
        return stable(servo, *plant) and command_peak(servo, *plant, _commands(self.step)) < THROWN_OFF

    def fine_error(
        self, servo: Servo, window: slice, command: tuple[Floats, Floats], substeps: int
    ) -> Floats | None:
        """Return the simulated error of a window at every internal step, shape (m,), or None if the axis runs away."""
        rows = np.arange(window.stop - window.start)
        load = np.interp(np.arange(len(command[0])) / substeps, rows, self.load[window])
        h = self.step / substeps
        course = Command(*command, load, h, 1, self._limit)
        y = axis_kernel.run(self._axis(servo, h), self.tables, course, self._start(window))
        return None if y is None else y[:, 0]

    def _axis(self, servo: Servo, h: float) -> Axis:
        return Axis(self.inertia, self.viscous, Law.of(servo, h))

    @cached_property
    def _courses(self) -> tuple[tuple[Command, Floats, tuple[slice, ...]], ...]:
        """What is asked in one go, the position, velocity and effort in which it begins, and what is compared."""
        out = []
        for windows in self._together():
            whole = slice(windows[0].start, windows[-1].stop)
            qr, vr, load = (np.ascontiguousarray(x[whole]) for x in (self.qr, self.vr, self.load))
            course = Command(qr, vr, load, self.step, self.substeps, self._limit)
            at = [slice(s.start - whole.start + self.skip, s.stop - whole.start) for s in windows]
            compared = tuple(x for x, s in zip(at, windows, strict=True) if s in self.windows)
            out.append((course, self._start(whole), compared))
        return tuple(out)

    def _together(self) -> list[list[slice]]:
        """Return windows and what leads to them, those together that follow one another without a gap."""
        out: list[list[slice]] = []
        for s in sorted((*self.lead, *self.windows), key=lambda s: s.start):
            before = out[-1][-1] if out else None
            whole = [x for x in self.stretches if before and x.start <= before.start and s.stop <= x.stop]
            if before is not None and before.stop == s.start and whole:
                out[-1].append(s)
            else:
                out.append([s])
        return [x for x in out if x[-1] in self.windows]

    @cached_property
    def _limit(self) -> float:
        return 0.2 * float(np.ptp(self.qr)) + 1e-9

    def _start(self, s: slice) -> Floats:
        return np.array([self.q[s.start], self.v[s.start], float(np.mean(self.u[s.start : s.start + 3]))])

    def with_plant(self, factors: Factors) -> AxisProblem:
        """Return the same axis with inertia, viscous and dry friction multiplied; see :data:`Factors`."""
        t, (inertia, viscous, dry, fading, distance) = self.tables, factors

        def levels(table: Floats) -> Floats:
            lasting = table[..., -1:]
            return np.asarray(dry * lasting + fading * (table - lasting))

        tables = t._replace(
            dry=levels(t.dry),
            slip=levels(t.slip),
            give=t.give / distance,
            memory=t.memory * np.array([1.0 / distance, 1.0, 1.0, 1.0]),
        )
        return replace(self, inertia=self.inertia * inertia, viscous=self.viscous * viscous, tables=tables)

    def split(self, trained: float = 2.0 / 3.0) -> tuple[AxisProblem, AxisProblem]:
        """Return the part that structures are fitted to, and the part that judges them."""
        cut = max(1, round(trained * len(self.windows)))
        first, last = self.windows[:cut], self.windows[cut:]
        judge = replace(self, windows=last, lead=first) if last else self.within(first[-1:])
        return self.within(first), judge

    @cached_property
    def measured(self) -> Floats:
        """Error and effort on all windows, shape (rows, 2)."""
        parts = [slice(s.start + self.skip, s.stop) for s in self.windows]
        return np.concatenate([np.column_stack([(self.qr - self.q)[s], self.u[s]]) for s in parts])
