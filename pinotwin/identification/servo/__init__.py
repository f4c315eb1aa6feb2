"""The controller of one axis, found through the closed loop that it makes with the identified plant.

Least squares on the law start the search for the gains with which the *simulated* axis shows the error and the effort
of the log (:mod:`output_error`). Of all structures the one that predicts held-out windows best is kept, a larger one
only where it pays (:mod:`structure`).
"""
