"""The controller of one axis, found through the closed loop that it makes with the identified plant.

Least squares on the law give a first answer (:mod:`first_answer`); it only starts the search. The gains are then
those with which the *simulated* axis (controller, inertia, friction, and the disturbance that the other axes made)
shows the error and the effort of the log (:mod:`output_error`). Every structure (with and without lag of the current
loop, notch, the ties of a cascade or a PID) goes the same way; the one that predicts held-out windows best is kept, a
larger one only where it pays (:mod:`structure`).
"""

from pinotwin.identification.servo.certainty import shared as shared
from pinotwin.identification.servo.output_error import Found as Found
from pinotwin.identification.servo.problem import PLANT as PLANT
from pinotwin.identification.servo.problem import AxisProblem as AxisProblem
from pinotwin.identification.servo.problem import Factors as Factors
from pinotwin.identification.servo.structure import afresh as afresh
from pinotwin.identification.servo.structure import doubtful as doubtful
from pinotwin.identification.servo.structure import look as look
from pinotwin.identification.servo.structure import settle as settle
