"""The one solver: linear least squares and variable projection around it."""
