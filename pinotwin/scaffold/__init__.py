"""A machine folder to start from: a URDF, a machine.yaml, the columns of a log guessed and each guess said."""

from pinotwin.scaffold.guess import Guess, Guesses, guess_columns
from pinotwin.scaffold.start import Start, new

__all__ = ["Guess", "Guesses", "Start", "guess_columns", "new"]
