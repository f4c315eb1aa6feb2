"""Machines: a tree from a URDF with axes, effects and sensors from YAML."""

from __future__ import annotations

from pinotwin.machine.bundled import machines
from pinotwin.machine.machine import Machine
from pinotwin.machine.parts import Axis, DataSettings, Imu, LeftOut, LoopShape, Passive

__all__ = ["Axis", "DataSettings", "Imu", "LeftOut", "LoopShape", "Machine", "Passive", "machines"]
