"""Responses of the sections to inputs, and on their own from any start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints
from pinotwin.loop import kernels
from pinotwin.loop.layout import Layout
from pinotwin.loop.sections import Discrete
from pinotwin.loop.structure import Section


def free_places(layout: Layout) -> list[Ints]:
    """Return, per parameter, pairs (column of dF, column of F)."""
    places: list[list[tuple[int, int]]] = [[] for _ in layout.parameters]
    f, d = 0, 0
    for s, section in enumerate(layout.sections):
        for i, parameter in enumerate(layout.parameters):
            if parameter.section == s:
                first = d + section.order * parameter.value
                places[i] += [(first + j, f + j) for j in range(section.order)]
        f += section.order
        d += section.order * section.order
    return [np.array(pairs, dtype=np.intp).reshape(-1, 2) for pairs in places]


def memory(sections: Sequence[Section], step: float, constants: float = 18.0) -> int:
    """Return after how many samples the slowest free response is forgotten: of its time constants, to 1e-8."""
    rates = []
    for section in sections:
        if section.order == 1:
            rates.append(section.values[0])
        else:
            wn, zeta = section.values
            over = max(zeta * zeta - 1.0, 0.0) ** 0.5
            rates.append(wn / (zeta + over) if over else wn * zeta)
    return int(np.ceil(constants / (min(rates) * step)))


def free_response(layout: Layout, discrete: Discrete, n: int) -> Floats:
    """Return the free responses of all sections and then their derivatives, shape (columns, n)."""
    silent, block = np.zeros(n), np.array([[0, n, 1]], dtype=np.intp)
    values, slopes = [], []
    for s, section in enumerate(layout.sections):
        own = []
        for j in range(section.order):
            out = np.zeros((1, 2 if section.order == 1 else 6, n))
            kernels.filter_section(discrete.A[s], discrete.B[s], silent, block, np.eye(2)[j], out)
            own.append(out[0])
        values += [x[0] for x in own]
        for i in range(section.order):
            slopes += [x[section.order * (1 + i)] for x in own]
    return np.stack(values + slopes)


def triangle(blocks: Floats) -> Floats:
    """Return the triangular factor, shape (columns, columns), of blocks (m, columns, rows), which are overwritten."""
    columns = blocks.shape[1]
    out = np.zeros((columns, columns))
    if len(blocks):
        factors = [_factor(block.T) for block in blocks]
        last = factors[0] if len(factors) == 1 else _factor(np.asfortranarray(np.vstack(factors)))
        out[: len(last)] = last
    return out


def _factor(rows: Floats, panel: int = 8) -> Floats:
    """Return the triangular factor of rows in Fortran order, overwritten; dgeqrf takes three times as long."""
    reflected, *_ = scipy.linalg.lapack.dgeqrt(min(panel, *rows.shape), rows, overwrite_a=True)
    return np.triu(reflected[: rows.shape[1]])


def without_free(R: Floats, layout: Layout) -> tuple[Floats, tuple[Floats, Floats, Floats]]:
    """Return the rows of a segment's head off its free response, and what gives f, from the factor of [F, dF, rest]."""
    nf = sum(section.order for section in layout.sections)
    nd = nf + sum(section.order**2 for section in layout.sections)
    inverse = np.asarray(np.linalg.pinv(R[:nf, :nf], rcond=1e-11), dtype=np.float64)
    return R[nf:, nd:], (inverse, R[:nf, nd:], R[nf:, nf:nd])
