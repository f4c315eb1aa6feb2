"""The misfit of a set of poles, with all numerators projected out, and its exact gradient.

For poles theta the outputs are linear in the residues c, tied by N(theta).T c = g, and in the free response f of every
segment. With c = cp + Z z, Z the null space of N.T, variable projection (Golub and Pereyra 1973, doi:10.1137/0710036)
in Kaufman's simplification (1975, doi:10.1007/BF01932995) is

    r(theta) = min over z, f of  || Y - Phi c - F f ||
    dr/dtheta_i = -P [dPhi_i c + Phi dc_i + dF_i f],     dc_i = -N (N.T N)^-1 dN_i.T c,

with P the projector off [Phi Z, F]. All columns of a block of rows, [F dF Phi dPhi Y], are first reduced to their
triangular factor: a few dozen rows whatever the length of the log, and nothing is squared.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints
from pinotwin.loop.data import LoopData
from pinotwin.loop.layout import Layout, Ties
from pinotwin.loop.sections import Discrete, discretise, filter_section
from pinotwin.loop.structure import Section

BLOCK = 1000  # Rows that are filtered and factored at once


class Misfit(NamedTuple):
    """The misfit at one set of poles."""

    residual: Floats  # in reduced coordinates; half its square is the cost
    jacobian: Floats  # its derivative by theta
    residues: Floats  # in scaled units, shape (ny, nc)


@dataclass(frozen=True)
class Scales:
    """Units in which the fit works: every signal of size one."""

    inputs: Floats  # disturbances and velocity of the command, shape (ni,)
    acceleration: float  # acceleration of the command
    outputs: Floats  # shape (ny,)

    @classmethod
    def of(cls, data: LoopData) -> Scales:
        """Return rms values over the segments."""
        rows = np.r_[*data.segments]

        def rms(x: Floats) -> Floats:
            size = np.sqrt(np.mean(x[rows] ** 2, axis=0))
            return np.where(size > 0, size, 1.0)

        inputs = np.append(rms(data.d), rms(data.vr))
        return cls(inputs, float(rms(data.ar)), rms(data.outputs))

    def residue_units(self, layout: Layout) -> Floats:
        """Return the factor from scaled to SI residues, shape (ny, nc)."""
        per_state = np.concatenate([[self.inputs[s.input]] * s.order for s in layout.slots])
        per_column = np.concatenate([per_state, [self.inputs[-1], self.acceleration]])
        return self.outputs[:, None] / per_column

    def gains(self, output: int) -> Floats:
        """Return the gain 1 of every input to an output in scaled units, shape (ni,)."""
        return self.inputs / self.outputs[output]


class Projection:
    """The separable problem of one axis: data and structure, evaluated at poles theta."""

    def __init__(self, data: LoopData, layout: Layout, scales: Scales) -> None:
        self.layout = layout
        self.scales = scales
        self.step = data.step
        self.inputs = np.ascontiguousarray(np.column_stack([data.d, data.vr]).T / scales.inputs[:, None])
        self.direct = np.stack([data.vr / scales.inputs[-1], data.ar / scales.acceleration])
        self.outputs = np.ascontiguousarray((data.outputs / scales.outputs).T)
        self.segments, self.columns = data.segments, _Columns(layout)
        found = [
            (k, min(k + BLOCK, s.stop), int(k == s.start))
            for s in self.segments
            for k in range(s.start, s.stop, BLOCK)
        ]
        self.blocks = np.array(found, dtype=np.intp)  # start, stop and whether a segment begins, shape (m, 3)

    def filtered(self, discrete: Discrete) -> Floats:
        """Return states and derivatives, direct terms, outputs in blocks, (m, columns, BLOCK), zero past the end."""
        out = np.zeros((len(self.blocks), self.columns.width, BLOCK))
        for slot, at in zip(self.layout.slots, self.columns.starts, strict=True):
            part = out[:, at : at + 2 if slot.order == 1 else at + 6]
            A, B = discrete.A[slot.section], discrete.B[slot.section]
            filter_section(A, B, self.inputs[slot.input], self.blocks, np.zeros(2), part)
        for m, (start, stop, _) in enumerate(self.blocks):
            out[m, self.columns.direct, : stop - start] = self.direct[:, start:stop]
            out[m, self.columns.output :, : stop - start] = self.outputs[:, start:stop]
        return out

    def evaluate(self, theta: Floats) -> Misfit:
        """Return misfit, gradient and residues at the poles ``theta`` (logarithms)."""
        sections = self.layout.shaped(theta)
        discrete = discretise(sections, self.step)
        rows, free = self._reduced(sections, discrete)
        ties = [self.layout.ties(sections, k, self.scales.gains(k)) for k in range(self.layout.outputs)]
        parts = [self._solved(rows, free, own, k) for k, own in enumerate(ties)]
        residuals, jacobians, residues = zip(*parts, strict=True)
        return Misfit(np.concatenate(residuals), np.concatenate(jacobians), np.stack(residues))

    def _solved(
        self, rows: Floats, free: Sequence[_Free], ties: Ties, output: int
    ) -> tuple[Floats, Floats, Floats]:
        """Return residual, Jacobian and residues of one output, in triangular coordinates."""
        particular, Z = ties.particular()
        phi, y = rows[:, self.columns.phi], rows[:, self.columns.output + output]
        target = y - phi @ particular
        U, sizes, V = np.linalg.svd(phi @ Z, full_matrices=False)
        good = sizes > 1e-11 * sizes.max(initial=1e-300)
        U = U[:, good]
        inside = U.T @ target
        c = particular + Z @ (V[good].T @ (inside / sizes[good]))
        residual = target - U @ inside
        slopes = self._slopes(rows, free, c, output) + phi @ ties.moves(c)
        return residual, -(slopes - U @ (U.T @ slopes)), c

    def _slopes(self, rows: Floats, free: Sequence[_Free], c: Floats, output: int) -> Floats:
        """Return dPhi c + dF f per parameter, shape (rows, np)."""
        out = self.columns.moved(rows, c)
        for segment in free:
            along = segment.upper
            f = segment.solve @ (along[:, self.columns.output + output] - along[:, self.columns.phi] @ c)
            part = slice(segment.row, segment.row + len(segment.slopes))
            for i, pairs in enumerate(self.columns.free_slopes):
                out[part, i] += segment.slopes[:, pairs[:, 0]] @ f[pairs[:, 1]]
        return out

    def clear_free(self, discrete: Discrete, sections: Sequence[Section], columns: Floats) -> None:
        """Take the free responses of the segments out of full-length columns, shape (rows, k), in place."""
        longest = max(s.stop - s.start for s in self.segments)
        n = min(memory(sections, self.step), longest)
        nf = sum(section.order for section in sections)
        response = free_response(self.layout, discrete, n)[:nf].T
        at = 0
        for s in self.segments:
            own = min(n, s.stop - s.start)
            Q, sizes, _ = np.linalg.svd(response[:own], full_matrices=False)
            Q = Q[:, sizes > 1e-11 * sizes[0]]
            columns[at : at + own] -= Q @ (Q.T @ columns[at : at + own])
            at += s.stop - s.start

    def _reduced(self, sections: Sequence[Section], discrete: Discrete) -> tuple[Floats, list[_Free]]:
        """Return the triangular rows of all data, and the free responses of the segments."""
        wide = self.filtered(discrete)
        starts = np.flatnonzero(self.blocks[:, 2])
        stops = np.append(starts[1:], len(self.blocks))
        head = min(-(-memory(sections, self.step) // BLOCK), int(np.max(stops - starts)))
        response = free_response(self.layout, discrete, head * BLOCK)
        response = np.swapaxes(response.reshape(-1, head, BLOCK), 0, 1)
        tail = np.ones(len(self.blocks), dtype=bool)
        rows: list[Floats] = []
        free: list[_Free] = []
        nf = sum(section.order for section in sections)
        nd = nf + sum(section.order**2 for section in sections)
        for a, b in zip(starts, stops, strict=True):
            stop = min(b, a + head)
            tail[a:stop] = False
            both = np.concatenate([response[: stop - a], wide[a:stop]], axis=1)
            both[-1, :, self.blocks[stop - 1, 1] - self.blocks[stop - 1, 0] :] = 0.0
            R = triangle(both)  # the factor of [F, dF, rest]
            inverse = np.asarray(np.linalg.pinv(R[:nf, :nf], rcond=1e-11), dtype=np.float64)
            free.append(_Free(sum(map(len, rows)), inverse, R[:nf, nd:], R[nf:, nf:nd]))
            rows.append(R[nf:, nd:])
        rows.append(triangle(wide[tail]))
        return np.concatenate(rows), free


@dataclass(frozen=True)
class _Free:
    """Free response of a segment: f = solve @ (y - phi c), and the rows of its derivative."""

    row: int
    solve: Floats  # pseudo-inverse of the triangular factor of F, (nf, nf)
    upper: Floats  # rows of [Phi dPhi direct Y] along F, (nf, columns)
    slopes: Floats  # columns dF off F, (rows, nd)


class _Columns:
    """Places of states, derivatives, direct terms and outputs among the columns of a block."""

    def __init__(self, layout: Layout) -> None:
        slots, widths = layout.slots, [2 if slot.order == 1 else 6 for slot in layout.slots]
        *self.starts, at = np.cumsum([0, *widths]).tolist()
        states = [k + j for k, slot in zip(self.starts, slots, strict=True) for j in range(slot.order)]
        self.direct = slice(at, at + 2)
        self.output = at + 2
        self.width = at + 2 + layout.outputs
        self.phi = np.array([*states, at, at + 1])
        spots = [(x.section, k + x.order, x.at) for k, x in zip(self.starts, slots, strict=True)]
        self.slopes = _pairs(layout, spots)
        orders = np.array([section.order for section in layout.sections])
        ends = np.cumsum(orders**2), np.cumsum(orders)
        free = zip(range(len(orders)), ends[0] - orders**2, ends[1] - orders, strict=True)
        self.free_slopes = _pairs(layout, free)

    def moved(self, rows: Floats, c: Floats) -> Floats:
        """Return dPhi c per parameter, shape (rows, np)."""
        out = np.zeros((len(rows), len(self.slopes)))
        for i, pairs in enumerate(self.slopes):
            out[:, i] = rows[:, pairs[:, 0]] @ c[pairs[:, 1]]
        return out


def _pairs(layout: Layout, spots: Iterable[tuple[int, int, int]]) -> list[Ints]:
    """Return, per parameter, pairs of columns, of a derivative and its state; spots: section, first of either."""
    pairs: list[list[tuple[int, int]]] = [[] for _ in layout.parameters]
    for section, slopes, states in spots:
        order = layout.sections[section].order
        for own, parameter in zip(pairs, layout.parameters, strict=True):
            if parameter.section == section:
                own += [(slopes + order * parameter.value + j, states + j) for j in range(order)]
    return [np.array(own, dtype=np.intp).reshape(-1, 2) for own in pairs]


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
            filter_section(discrete.A[s], discrete.B[s], silent, block, np.eye(2)[j], out)
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
