"""Twins: identified machines that predict, save, load and judge themselves."""

from pinotwin.twin.open_loop import OpenLoop as OpenLoop
from pinotwin.twin.parameters import Parameter as Parameter
from pinotwin.twin.parameters import Parameters as Parameters
from pinotwin.twin.twin import Twin as Twin
