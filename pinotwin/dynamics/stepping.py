"""Mass matrix and bias effort of one sample, callable from compiled loops, which Pinocchio is not.

A call from Python costs more than the step itself (docs/architecture.md); tests hold the result equal to Pinocchio's.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.system.kernels import compiled

leaf = compiled(nogil=True, _nrt=False)  # axes are searched side by side
"""Compiles what allocates nothing: numba's own ``_nrt=False`` spares references, three times the arithmetic's cost."""

inlined = compiled(nogil=True, inline="always")
"""Compiles a function into those that call it: arrays in tuples cost a call more than most steps do."""


def entry(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function for named tuples from Python: 4 µs, not 200, for numba 0.68 forgets their types otherwise."""
    kept: list[Any] = []

    @wraps(kernel)
    def call(*args: Any) -> Any:
        if not kept:
            from numba import typeof

            kept.extend(typeof(x) for x in args)
        return kernel(*args)

    return call


@leaf
def replay(revolute: Ints, ops: Ints, sign: Floats, q: Floats, v: Floats, t: Floats) -> None:
    """Work off a :class:`pinotwin.dynamics.tape.Tape` at one sample; ``t`` (m + k,) starts with the constants."""
    nv = len(q)
    for r in range(len(revolute)):
        i = revolute[r]
        t[i] = np.cos(q[i])
        t[nv + i] = np.sin(q[i])
    for i in range(nv):
        t[2 * nv + i] = q[i]
        t[3 * nv + i] = v[i]
    at = len(t) - len(ops)
    for k in range(len(ops)):
        t[at + k] = t[ops[k, 0]] * t[ops[k, 1]] * sign[k] + t[ops[k, 2]]


@leaf
def gather(mass: Ints, bias: Ints, t: Floats, M: Floats, h: Floats) -> None:
    """Fill M (nv, nv) and h (nv,) from the values of a tape; entries without a place stay."""
    for r in range(len(mass)):
        value = t[mass[r, 2]]
        M[mass[r, 0], mass[r, 1]] = value
        M[mass[r, 1], mass[r, 0]] = value
    for r in range(len(bias)):
        h[bias[r, 0]] = t[bias[r, 1]]
