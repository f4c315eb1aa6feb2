"""Machines: a tree from a URDF with axes, effects and sensors from YAML."""

from pinotwin.machine.bundled import machines as machines
from pinotwin.machine.machine import Machine as Machine
from pinotwin.machine.machine import MachineLike as MachineLike
from pinotwin.machine.machine import as_machine as as_machine
from pinotwin.machine.parts import Axis as Axis
from pinotwin.machine.parts import DataSettings as DataSettings
from pinotwin.machine.parts import Imu as Imu
from pinotwin.machine.parts import LeftOut as LeftOut
from pinotwin.machine.parts import LoopShape as LoopShape
from pinotwin.machine.parts import Passive as Passive
