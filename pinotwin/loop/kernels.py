"""The inner loops: sections filtered sample by sample, compiled.

States that have decayed below 1e-200 are set to zero: denormal numbers are a hundred times slower.
"""

from __future__ import annotations

from pinotwin.arrays import Floats, Ints
from pinotwin.system.kernels import compiled


@compiled(nogil=True)
def flush(x: float) -> float:
    """Return x, or zero where it is as good as none."""
    return 0.0 if abs(x) < 1e-200 else x


@compiled(nogil=True)
def filter_section(A: Floats, B: Floats, w: Floats, blocks: Ints, start_state: Floats, out: Floats) -> None:
    """Filter w (n,) by a section and by its derivatives with respect to log p, or to log wn and log zeta.

    A (3, 2, 2) and B (2, 3, 2), for B0 and B1, hold the value and its derivatives; ``blocks`` start, stop and 1
    where a segment begins, (m, 3). There the state is ``start_state`` beside the equilibrium of the first
    input. ``out`` gets the states and their derivatives, (m, 6, rows), of a first-order section (m, 2, rows).
    """
    x = 0.0
    y = 0.0
    dx, dy, ex, ey = 0.0, 0.0, 0.0, 0.0
    for m in range(len(blocks)):
        first = blocks[m, 0]
        for k in range(first, blocks[m, 1]):
            if k == first and blocks[m, 2] == 1:
                x, y = w[k] + start_state[0], start_state[1]
                dx, dy, ex, ey = 0.0, 0.0, 0.0, 0.0
            else:
                v, z = w[k - 1], w[k]
                p = A[1, 0, 0] * x + A[1, 0, 1] * y + B[0, 1, 0] * v + B[1, 1, 0] * z
                q = A[1, 1, 0] * x + A[1, 1, 1] * y + B[0, 1, 1] * v + B[1, 1, 1] * z
                r = A[2, 0, 0] * x + A[2, 0, 1] * y + B[0, 2, 0] * v + B[1, 2, 0] * z
                s = A[2, 1, 0] * x + A[2, 1, 1] * y + B[0, 2, 1] * v + B[1, 2, 1] * z
                p, q = p + A[0, 0, 0] * dx + A[0, 0, 1] * dy, q + A[0, 1, 0] * dx + A[0, 1, 1] * dy
                r, s = r + A[0, 0, 0] * ex + A[0, 0, 1] * ey, s + A[0, 1, 0] * ex + A[0, 1, 1] * ey
                dx, dy, ex, ey = flush(p), flush(q), flush(r), flush(s)
                p = A[0, 0, 0] * x + A[0, 0, 1] * y + B[0, 0, 0] * v + B[1, 0, 0] * z
                q = A[0, 1, 0] * x + A[0, 1, 1] * y + B[0, 0, 1] * v + B[1, 0, 1] * z
                x, y = flush(p), flush(q)
            i = k - first
            if out.shape[1] == 2:
                out[m, 0, i], out[m, 1, i] = x, dx
            else:
                out[m, 0, i], out[m, 1, i], out[m, 2, i] = x, y, dx
                out[m, 3, i], out[m, 4, i], out[m, 5, i] = dy, ex, ey


@compiled(nogil=True)
def simulate(  # noqa: PLR0913, a compiled kernel takes its arrays one by one
    A: Floats, B: Floats, C: Floats, w: Floats, x: Floats, start: int, stop: int, out: Floats
) -> None:
    """Step a modal system from states x (k, 2) over rows of inputs w (k, n) and add its response to out (n, ny).

    A (k, 2, 2), B (k, 2, 2) as [block, start or end of the interval, state], C (ny, k, 2); x ends at the last row.
    """
    for b in range(len(A)):
        p, q = x[b, 0], x[b, 1]
        for k in range(start, stop):
            if k > start:
                v, z = w[b, k - 1], w[b, k]
                r = A[b, 0, 0] * p + A[b, 0, 1] * q + B[b, 0, 0] * v + B[b, 1, 0] * z
                q = A[b, 1, 0] * p + A[b, 1, 1] * q + B[b, 0, 1] * v + B[b, 1, 1] * z
                p, q = flush(r), flush(q)
            for j in range(len(C)):
                out[k, j] += C[j, b, 0] * p + C[j, b, 1] * q
        x[b, 0], x[b, 1] = p, q
