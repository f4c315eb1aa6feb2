"""Simulation of an identified machine: the command in, position, tracking error and effort out."""

from __future__ import annotations

from pinotwin.simulation.run import Response, feedforward, preferred, respond, simulate, wide_loops
from pinotwin.simulation.score import compare

__all__ = ["Response", "compare", "feedforward", "preferred", "respond", "simulate", "wide_loops"]
