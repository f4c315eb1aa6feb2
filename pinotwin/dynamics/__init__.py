"""Rigid-body dynamics on a plain ``pin.Model``: efforts, regressors, base parameters, frames."""

from pinotwin.dynamics.base import base_parameters as base_parameters
from pinotwin.dynamics.batch import inverse as inverse
from pinotwin.dynamics.batch import mass_matrix as mass_matrix
from pinotwin.dynamics.batch import regressor as regressor
from pinotwin.dynamics.excitation import excitation as excitation
from pinotwin.dynamics.frames import external_effort as external_effort
from pinotwin.dynamics.frames import frame_acceleration as frame_acceleration
from pinotwin.dynamics.frames import frame_rotation as frame_rotation
from pinotwin.dynamics.frames import frame_velocity as frame_velocity
from pinotwin.dynamics.frames import jacobian as jacobian
from pinotwin.dynamics.parameters import parameter_names as parameter_names
from pinotwin.dynamics.parameters import parameter_units as parameter_units
from pinotwin.dynamics.parameters import parameters as parameters
from pinotwin.dynamics.parameters import with_parameters as with_parameters
