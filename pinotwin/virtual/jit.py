"""How the kernel is compiled: it allocates nothing; counting references (numba's ``_nrt``) took half of the time."""

from __future__ import annotations

from pinotwin.system.kernels import compiled

kernel = compiled(error_model="numpy", _nrt=False)
"""Decorator of every function of the kernel; such a function must not make an array."""
