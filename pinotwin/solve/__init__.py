"""The one solver: linear least squares, and variable projection around it.

``linear.linear`` solves for coefficients, ``separable.separable`` also searches shapes,
``consistency.consistent`` asks for inertias that a real body could have, and ``crossval.held_out``
measures the error on data that were not fitted. All take a ``problem.Problem``.
"""
