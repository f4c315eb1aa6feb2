"""The controller of one axis, found through the closed loop that it makes with the identified plant.

Least squares on the law start the search for the gains with which the *simulated* axis shows the error and the effort
of the log (:mod:`output_error`). Of all structures the one that predicts held-out windows best is kept, a larger one
only where it pays (:mod:`structure`).
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
