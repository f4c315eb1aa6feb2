"""The motion of a passive joint from servo and IMU logs (thesis Sections 6.4-6.5, and beyond)."""

from pinotwin.reconstruction.estimate import reconstruct_vibration as reconstruct_vibration
from pinotwin.reconstruction.flexible import Flexible as Flexible
from pinotwin.reconstruction.flexible import identify_flexible as identify_flexible
from pinotwin.reconstruction.flexible import with_vibration as with_vibration
from pinotwin.reconstruction.result import Vibration as Vibration
from pinotwin.reconstruction.servo import Settings as Settings

vibration = reconstruct_vibration
