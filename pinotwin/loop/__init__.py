"""Closed-loop LTI models of the axes: identify, judge, simulate (thesis 4.2, 5.3)."""

from pinotwin.loop.data import LoopData as LoopData
from pinotwin.loop.data import command_rates as command_rates
from pinotwin.loop.identify import identify_loop as identify_loop
from pinotwin.loop.margins import close as close
from pinotwin.loop.margins import margins as margins
from pinotwin.loop.model import LoopFit as LoopFit
from pinotwin.loop.model import LoopModel as LoopModel
from pinotwin.loop.sections import ModalStep as ModalStep
from pinotwin.loop.servo import Servo as Servo
from pinotwin.loop.structure import Section as Section
from pinotwin.loop.structure import Structure as Structure
