"""The motion of a passive joint from servo and IMU logs (thesis Sections 6.4-6.5, and beyond)."""

from pinotwin.reconstruction.estimate import reconstruct_vibration as reconstruct_vibration
from pinotwin.reconstruction.estimate import reconstruct_vibration as vibration
from pinotwin.reconstruction.flexible import Flexible as Flexible
from pinotwin.reconstruction.flexible import identify_flexible as identify_flexible
from pinotwin.reconstruction.merge import with_vibration as with_vibration
from pinotwin.reconstruction.result import Vibration as Vibration
from pinotwin.reconstruction.settings import Settings as Settings

__all__ = [
    "Flexible",
    "Settings",
    "Vibration",
    "identify_flexible",
    "reconstruct_vibration",
    "vibration",
    "with_vibration",
]
