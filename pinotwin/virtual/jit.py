"""How the kernel is compiled.

Nothing in it allocates, so it runs without numba's reference counting (``_nrt=False``): counting
the arrays of its records in and out of every small function took half of the time.
"""

from __future__ import annotations

from pinotwin.system.kernels import compiled

kernel = compiled(error_model="numpy", _nrt=False)
"""Decorator of every function of the kernel; such a function must not make an array."""
