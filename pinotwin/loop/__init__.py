"""Closed-loop LTI models of the axes: identify, judge, simulate (thesis 4.2, 5.3)."""

from pinotwin.loop.data import LoopData, command_rates
from pinotwin.loop.identify import identify_loop
from pinotwin.loop.margins import Margins, close, margins
from pinotwin.loop.model import LoopFit, LoopModel, ParameterFit
from pinotwin.loop.sections import ModalStep
from pinotwin.loop.servo import Servo
from pinotwin.loop.structure import Section, Structure

__all__ = [
    "LoopData",
    "LoopFit",
    "LoopModel",
    "Margins",
    "ModalStep",
    "ParameterFit",
    "Section",
    "Servo",
    "Structure",
    "close",
    "command_rates",
    "identify_loop",
    "margins",
]
