"""A machine folder to start from: a URDF, a machine.yaml, the columns of a log guessed and each guess said."""

from pinotwin.scaffold.guess import Guess as Guess
from pinotwin.scaffold.guess import Guesses as Guesses
from pinotwin.scaffold.guess import guess_columns as guess_columns
from pinotwin.scaffold.start import Start as Start
from pinotwin.scaffold.start import new as new

__all__ = ["Guess", "Guesses", "Start", "guess_columns", "new"]
