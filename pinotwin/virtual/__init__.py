"""Virtual machines that produce honest field data; they share nothing with the identification side."""

from pinotwin.virtual.machine import VirtualMachine as VirtualMachine
from pinotwin.virtual.trajectories import random_trajectory as random_trajectory
