"""Exact discretisation of first- and second-order sections, and its derivative by the poles.

Each section has gain 1 at frequency zero, at any damping and for equal poles:

    first order    x' = -p x + p w
    second order   x1' = wn x2,   x2' = -wn x1 - 2 zeta wn x2 + wn w      (x1 = G w, x2 = G s w / wn)

For an input that runs straight between samples (first-order hold) x[k+1] = A x[k] + B0 w[k] + B1 w[k+1] exactly, with
A, B0, B1 from the matrix exponential of the section extended by the input and its slope (Van Loan 1978,
doi:10.1109/TAC.1978.1101743); extended once more it gives the derivatives by log p, log wn and log zeta. The compiled
loops set states that have decayed below 1e-200 to zero: denormal numbers are a hundred times slower.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints
from pinotwin.loop.structure import Section
from pinotwin.system.kernels import compiled


class Discrete(NamedTuple):
    """Stacked discrete sections and their derivatives by the logarithms of two values; first order fills one state."""

    A: Floats  # value and derivatives, shape (k, 3, 2, 2)
    B: Floats  # weights of the input at start and end of the interval, likewise, shape (k, 2, 3, 2)


def continuous(section: Section) -> tuple[Floats, Floats]:
    """Return A (2, 2) and B (2,) of a section [1/s]; a first-order one idles its second state."""
    if section.order == 1:
        p = section.values[0]
        return np.array([[-p, 0.0], [0.0, -p]]), np.array([p, 0.0])
    wn, zeta = section.values
    return np.array([[0.0, wn], [-wn, -2.0 * zeta * wn]]), np.array([0.0, wn])


def derivatives(section: Section) -> tuple[Floats, Floats]:
    """Return dA (2, 2, 2) and dB (2, 2) by the logarithms of the section's values."""
    A, B = continuous(section)
    dA, dB = np.zeros((2, 2, 2)), np.zeros((2, 2))
    dA[0], dB[0] = A, B  # both are proportional to p, or to wn
    if section.order == 2:
        dA[1, 1, 1] = A[1, 1]
    return dA, dB


def discretise(sections: Sequence[Section], step: float) -> Discrete:
    """Return the exact first-order-hold equivalents of continuous sections at a sampling interval [s]."""
    k = len(sections)
    M, dM = np.zeros((k, 4, 4)), np.zeros((k, 2, 4, 4))
    M[:, 2, 3] = 1.0
    for i, section in enumerate(sections):
        A, B = continuous(section)
        dA, dB = derivatives(section)
        M[i, :2, :2], M[i, :2, 2] = step * A, step * B
        dM[i, :, :2, :2], dM[i, :, :2, 2] = step * dA, step * dB
    big = np.zeros((k, 12, 12))
    for j in range(3):
        big[:, 4 * j : 4 * j + 4, 4 * j : 4 * j + 4] = M
    big[:, :4, 4:8], big[:, :4, 8:] = dM[:, 0], dM[:, 1]
    E = scipy.linalg.expm(big)
    parts = np.stack([E[:, :2, 4 * j : 4 * j + 4] for j in range(3)], axis=1)  # (k, 3, 2, 4)
    A, slope = parts[..., :2], parts[..., 3]
    B = np.stack([parts[..., 2] - slope, slope], axis=1)
    return Discrete(np.ascontiguousarray(A), B)


@dataclass(frozen=True)
class ModalStep:
    """A loop as 2 x 2 blocks at one sampling interval; k blocks, m inputs, ny outputs.

        x[k+1] = A x[k] + B0 w[k] + B1 w[k+1]          w = (disturbances..., velocity of the command)
        y[k]   = C x[k] + D w[k] + Da ar[k]            ar = acceleration of the command

    Each input drives its own copy of the sections: the first state of a block is its filtered input.
    """

    input: Ints  # index of the input that drives each block, shape (k,)
    A: Floats  # shape (k, 2, 2); a first-order block leaves its second state at zero
    B0: Floats  # weight of the input at the start of the interval, shape (k, 2)
    B1: Floats  # weight of the input at its end, shape (k, 2)
    C: Floats  # shape (ny, k, 2)
    D: Floats  # direct terms of the inputs, shape (ny, m)
    Da: Floats  # direct terms of the command's acceleration, shape (ny,)
    rate: Floats  # continuous A of every block [1/s], shape (k, 2, 2)
    drive: Floats  # continuous B of every block [1/s], shape (k, 2)

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return self.D.shape[1]

    def equilibrium(self, w: Floats) -> Floats:
        """Return the states at rest under constant inputs ``w``, shape (k, 2)."""
        x = np.zeros((len(self.A), 2))
        x[:, 0] = np.asarray(w, dtype=float)[self.input]
        return x

    def respond(self, w: Floats, x: Floats, C: Floats, out: Floats) -> None:
        """Add the outputs C (ny, k, 2) of the states, begun at x (k, 2), to ``out`` (n, ny), for inputs w (n, m)."""
        B, driven = np.stack([self.B0, self.B1], axis=1), np.ascontiguousarray(w.T[self.input])
        simulate(self.A, B, C, driven, x, out)

    def derivative(self, order: int = 1) -> tuple[Floats, Floats, Floats, Floats]:
        """Return C (ny, k, 2), D, E, F of the outputs' first or second derivative: C x + D w + E w' + F w''.

        D, E, F of shape (ny, m) weigh the inputs and their derivatives, exactly (thesis Eq. 4.12). E of e' is zero for
        a rigid plant seen from its own disturbance: q' = vr - e' needs no slope of d.
        """
        C, D = self.C, self.D
        weights = [D, np.zeros_like(D), np.zeros_like(D)]
        for _ in range(order):
            through = np.einsum("yki,ki->yk", C, self.drive)
            gain = np.zeros_like(D)
            np.add.at(gain.T, self.input, through.T)
            weights = [gain, weights[0], weights[1]]
            C = np.einsum("yki,kij->ykj", C, self.rate)
        return C, weights[0], weights[1], weights[2]


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
    state, new = np.zeros((3, 2)), np.zeros((3, 2))  # value and derivatives
    order = 1 if out.shape[1] == 2 else 2
    for m in range(len(blocks)):
        first = blocks[m, 0]
        for k in range(first, blocks[m, 1]):
            if k == first and blocks[m, 2] == 1:
                state[:] = 0.0
                state[0, 0], state[0, 1] = w[k] + start_state[0], start_state[1]
            else:
                v, z, x, y = w[k - 1], w[k], state[0, 0], state[0, 1]
                for d in range(3):
                    for i in range(2):
                        p = A[d, i, 0] * x + A[d, i, 1] * y + B[0, d, i] * v + B[1, d, i] * z
                        if d > 0:
                            p = p + A[0, i, 0] * state[d, 0] + A[0, i, 1] * state[d, 1]
                        new[d, i] = flush(p)
                state[:] = new
            for d in range(order + 1):
                for i in range(order):
                    out[m, order * d + i, k - first] = state[d, i]


@compiled(nogil=True)
def simulate(A: Floats, B: Floats, C: Floats, w: Floats, x: Floats, out: Floats) -> None:
    """Step a modal system from states x (k, 2) over inputs w (k, n) and add its response to out (n, ny).

    A (k, 2, 2), B (k, 2, 2) as [block, start or end of the interval, state], C (ny, k, 2).
    """
    for b in range(len(A)):
        p, q = x[b, 0], x[b, 1]
        for k in range(w.shape[1]):
            if k > 0:
                v, z = w[b, k - 1], w[b, k]
                r = A[b, 0, 0] * p + A[b, 0, 1] * q + B[b, 0, 0] * v + B[b, 1, 0] * z
                q = A[b, 1, 0] * p + A[b, 1, 1] * q + B[b, 0, 1] * v + B[b, 1, 1] * z
                p, q = flush(r), flush(q)
            for j in range(len(C)):
                out[k, j] += C[j, b, 0] * p + C[j, b, 1] * q
