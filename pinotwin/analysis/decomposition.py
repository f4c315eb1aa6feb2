"""Which cause makes how much of the tracking error: e = G_eq q_r + sum of G_ed d_cause (thesis Fig. 4-14 to 4-16).

The response is simulated from the command alone; command and each part of every axis' disturbance
(:mod:`pinotwin.analysis.disturbance`) go through the identified transfer functions on their own, so that the parts add
up exactly. What the tables of the simulation differ from the effects (1e-4 and less) is ``other``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinotwin.analysis.disturbance import CAUSES, split
from pinotwin.arrays import Floats
from pinotwin.errors import DataError
from pinotwin.logs.files import LogLike, as_log
from pinotwin.loop import LoopModel
from pinotwin.motion import Motion
from pinotwin.notebook import Card, Shown
from pinotwin.signals import rms
from pinotwin.simulation.command import beginning
from pinotwin.simulation.run import Loops, as_motion, is_coupled, preferred, respond
from pinotwin.system.threads import one_blas_thread
from pinotwin.twin.twin import TwinLike, as_twin

COMMAND = "command"


@dataclass(frozen=True, eq=False, repr=False)
class Decomposition(Card):
    """Disturbances and tracking errors by cause, over a window of n rows; joint coordinates, SI."""

    t: Floats  # time [s], shape (n,)
    axes: tuple[str, ...]  # axes with a closed loop
    # axis -> cause -> its part of the generalised disturbance [N or N·m], shape (n,)
    disturbances: Mapping[str, Mapping[str, Floats]]
    # axis -> cause, or ``command`` -> the tracking error it makes [m or rad], shape (n,)
    errors: Mapping[str, Mapping[str, Floats]]
    notes: tuple[str, ...] = ()  # of the simulation

    def disturbance(self, axis: str) -> Floats:
        """Return the generalised disturbance of an axis, shape (n,)."""
        return np.sum(list(self.disturbances[axis].values()), axis=0)

    def error(self, axis: str) -> Floats:
        """Return the tracking error of an axis, shape (n,)."""
        return np.sum(list(self.errors[axis].values()), axis=0)

    def shares(self, axis: str) -> dict[str, float]:
        """Return each cause's share of the integrals of |e| (Fig. 4-16); they add up to 1."""
        sizes = {c: float(np.trapezoid(np.abs(x), self.t)) for c, x in self.errors[axis].items()}
        total = sum(sizes.values())
        return {c: size / total if total > 0.0 else 0.0 for c, size in sizes.items()}

    def table(self) -> tuple[dict[str, Any], ...]:
        """Return one row an axis and cause, largest share first; the command has no ``disturbance_rms``."""
        return tuple(
            {
                "axis": axis,
                "cause": cause,
                "disturbance_rms": rms(d) if (d := self.disturbances[axis].get(cause)) is not None else None,
                "error_rms": rms(self.errors[axis][cause]),
                "error_peak": float(np.abs(self.errors[axis][cause]).max(initial=0.0)),
                "share": share,
            }
            for axis in self.axes
            for cause, share in sorted(self.shares(axis).items(), key=lambda row: -row[1])
        )

    def _shown(self) -> Shown:
        """Return each cause's tracking error, for a notebook and for ``repr``."""
        rows = [
            (row["axis"], row["cause"], f"{row['error_rms']:.3g}", f"{row['share']:.0%}")
            for row in self.table()
        ]
        heads = ("axis", "cause", "tracking error, RMS [m, rad]", "share")
        return (f"Decomposition: {len(self.t)} rows", heads, rows, " ".join(self.notes[:3]))


@one_blas_thread
def decompose(
    twin: TwinLike,
    log: LogLike | Motion,
    window: tuple[float, float] | None = None,
    *,
    controller: Loops | None = None,
) -> Decomposition:
    """Split, by cause, the disturbances and the tracking error that a command will meet.

    Args:
        twin: the machine, with its loops.
        log: ``t``, ``<axis>.qr`` and external loads; nothing measured is used. Or a motion, for its command.
        window: first and last time to keep [s]; all when None.
        controller: which loops, see :func:`pinotwin.simulation.simulate`.

    Raises:
        DataError: nothing of the log lies in the window, or a motion has no command.
    """
    twin = as_twin(twin)
    given = log if isinstance(log, Motion) else as_log(log)
    found = respond(twin, given, controller=controller, every_step=True)
    asked = found.request
    modes = is_coupled(preferred(twin) if controller is None else controller)
    parts = split(twin, as_motion(twin, found), modes=modes)
    rest = found.d - np.sum(list(parts.values()), axis=0)
    parts["other"] = parts["other"] + rest if "other" in parts else rest
    rows = _rows(asked.t, asked.source, window)
    axes = tuple(name for name in twin.machine.axes if name in found.loops)
    begun = beginning(asked.qr, asked.vr, asked.step)[1][0]
    disturbances: dict[str, dict[str, Floats]] = {}
    errors: dict[str, dict[str, Floats]] = {}
    for name in axes:
        i = twin.machine.axes[name].index
        own = {c: parts[c][:, i] for c in CAUSES if c in parts and np.any(parts[c][:, i])}
        made = _errors(found.loops[name], asked.qr[:, i], asked.vr[:, i], own, asked.step, begun[i])
        disturbances[name] = {c: asked.at_stamps(x)[rows] for c, x in own.items()}
        errors[name] = {c: asked.at_stamps(x)[rows] for c, x in made.items()}
    return Decomposition(asked.t[rows], axes, disturbances, errors, found.notes)


def _errors(
    loop: LoopModel, qr: Floats, vr: Floats, parts: Mapping[str, Floats], step: float, begun: float
) -> dict[str, Floats]:
    """Return the tracking error that the command, from velocity ``begun``, and each part of the disturbance make."""
    none = np.zeros_like(qr)
    first = loop.modal(step).equilibrium(np.array([0.0, begun]))
    out = {COMMAND: loop.simulate(qr, none, first, vr=vr, step=step)[:, 0]}
    for cause, d in parts.items():
        out[cause] = loop.simulate(none, d, vr=none, ar=none, step=step)[:, 0]
    return out


def _rows(t: Floats, source: str, window: tuple[float, float] | None) -> slice:
    if window is None:
        return slice(0, len(t))
    first = int(np.searchsorted(t, window[0], "left"))
    last = int(np.searchsorted(t, window[1], "right"))
    if last - first < 2:
        raise DataError(
            f"{source}: window {window[0]:g} to {window[1]:g} s holds {max(last - first, 0)} rows; the "
            f"log runs from {t[0]:g} to {t[-1]:g} s"
        )
    return slice(first, last)
