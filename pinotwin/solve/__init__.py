"""The one solver: linear least squares, variable projection around it, possible bodies, held-out errors."""
