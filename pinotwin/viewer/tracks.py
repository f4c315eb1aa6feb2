"""What a log played back shows beside the machine: effort, residual, tracking error, effort by cause, over time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects import effect_name, known
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.signals import interior, rms
from pinotwin.twin import Twin

POINTS = 1200  # Frames of a playback; more would make the page large and look the same


@dataclass(frozen=True)
class Tracks:
    """A playback: t [s] (m,), positions and commands [m or rad] (m, nv), series by axis and kind.

    Kinds are effort, gap, error and parts; ``full``: axis -> residual where it is as red as it gets [N or N·m].
    """

    t: Floats
    q: Floats
    qr: Floats | None = None
    series: dict[str, dict[str, list[tuple[str, str, Floats]]]] = field(default_factory=dict)
    full: dict[str, float] = field(default_factory=dict)

    def frames(self) -> dict[str, Any]:
        """Return the motion for the page."""
        return {
            "t": np.round(self.t, 4).tolist(),
            "q": np.round(self.q, 7).tolist(),
            "qr": None if self.qr is None else np.round(self.qr, 9).tolist(),
        }

    def lines(self, axis: str) -> dict[str, list[dict[str, Any]]]:
        """Return the plots of an axis for the page."""
        return {
            kind: [
                {"name": n, "colour": c, "y": [float(f"{x:.5g}") if np.isfinite(x) else None for x in y]}
                for n, c, y in lines
            ]
            for kind, lines in self.series[axis].items()
        }


def _looks(key: str) -> tuple[str, str]:
    """Return name and colour of an effect."""
    kind = known().get(name := effect_name(key))
    return (name.replace("_", " "), "#888888") if kind is None else (kind.title.lower(), kind.colour)


def tracks_of(
    machine: Machine, motion: Motion, twin: Twin | None = None, edge: int = 10, most: int = 6
) -> Tracks:
    """Return the playback of a motion; with a twin its effort, residual (``edge`` rows inside), largest effects."""
    rows = np.unique(np.linspace(0, len(motion) - 1, min(POINTS, len(motion))).astype(int))
    parts = {} if twin is None else twin.parts(motion)
    model = None if twin is None else twin.effort(motion)
    series: dict[str, dict[str, list[tuple[str, str, Floats]]]] = {}
    full = {}
    settled = interior(len(motion), edge, motion.segments)
    for name, axis in machine.axes.items():
        i = axis.index
        u = motion.u[:, i]
        held: dict[str, list[tuple[str, str, Floats]]] = {"effort": [("measured", "#7a828d", u[rows])]}
        if model is not None:
            gap = np.where(settled, u - model[:, i], np.nan)
            held["effort"].append(("model", "#2b6cb0", model[rows, i]))
            held["gap"] = [("residual", "#d2691e", gap[rows])]
            known = np.abs(gap[np.isfinite(gap)])
            full[name] = float(np.percentile(known, 99.0)) if known.any() else 1.0
            sizes = {key: rms(p[:, i]) for key, p in parts.items()}
            largest = sorted((k for k in sizes if sizes[k] > 0.0), key=lambda k: -sizes[k])[:most]
            held["parts"] = [(*_looks(key), parts[key][rows, i]) for key in largest]
        if motion.qr is not None:
            error = motion.error[:, i] * (np.rad2deg(1e3) if axis.rotary else 1e6)
            held["error"] = [("command minus position", "#2fa6a0", error[rows])]
        series[name] = held
    qr = None if motion.qr is None else np.where(np.isfinite(motion.qr), motion.qr, motion.q)[rows]
    return Tracks(motion.t[rows] - motion.t[0], motion.q[rows], qr, series, full)
