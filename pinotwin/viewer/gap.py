"""The machine playing a log, every axis in the colour of its gap: grey agrees, red is far off."""

from __future__ import annotations

import numpy as np

from pinotwin.diagnosis.result import Diagnosis, Gap
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.viewer.play import play
from pinotwin.viewer.scene import Scene, colour, draw, visual_model

AGREES, OFF = np.array([0.62, 0.65, 0.68]), np.array([0.80, 0.13, 0.10])
FULL = 10.0  # gap over noise from which an axis is as red as it gets


def gap_scene(found: Diagnosis, machine: Machine, log: Log) -> Scene:
    """Return the scene of a diagnosed machine, playing a log.

    Args:
        found: the diagnosis.
        machine: the machine that was diagnosed.
        log: what it plays.
    """
    visual = visual_model(machine.model, machine.urdf, machine.meshes)
    drawn = draw(machine.model, visual, frames=False, masses=False, name=machine.name)
    axes = {axis: row["u"] for axis, row in found.gap.items() if "u" in row}
    shades = {machine.axis(axis).joint: shade(gap) for axis, gap in axes.items()}
    motion = prepare(machine, log, decimate=1)
    return play(colour(drawn, shades), motion.t, motion.q)


def shade(gap: Gap) -> tuple[float, float, float, float]:
    """Return red, green, blue and opacity of a gap: logarithmic from the noise to ten times it."""
    ratio = gap.rms / max(gap.noise, 1e-300)
    share = float(np.clip(np.log(max(ratio, 1.0)) / np.log(FULL), 0.0, 1.0))
    red, green, blue = AGREES + share * (OFF - AGREES)
    return float(red), float(green), float(blue), 1.0
