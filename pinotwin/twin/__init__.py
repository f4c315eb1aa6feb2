"""Twins: identified machines that predict, save, load and judge themselves."""

from __future__ import annotations

from pinotwin.twin.open_loop import OpenLoop
from pinotwin.twin.parameters import Parameter, Parameters
from pinotwin.twin.twin import Twin

__all__ = ["OpenLoop", "Parameter", "Parameters", "Twin"]
