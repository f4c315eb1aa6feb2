"""Virtual machines: plant, controller and sensors that produce honest field data.

Nothing here is shared with the identification side: own rigid-body code, friction laws that stick,
own integrator. Only the command line and the tests may import this package.
"""

from pinotwin.trajectories.moves import random_trajectory as random_trajectory
from pinotwin.virtual.machine import VirtualMachine as VirtualMachine
