"""Virtual machines: plant, controller and sensors that produce honest field data.

Nothing here is shared with the identification side, and only the command line and the tests may import it.
"""

from pinotwin.virtual.machine import VirtualMachine as VirtualMachine
from pinotwin.virtual.trajectories import random_trajectory as random_trajectory
