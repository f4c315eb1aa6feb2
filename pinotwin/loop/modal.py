"""The stepping form of a loop: real 2 x 2 blocks that a compiled simulator advances.

    x[k+1] = A x[k] + B0 w[k] + B1 w[k+1]          w = (disturbances..., velocity of the command)
    y[k]   = C x[k] + D w[k] + Da ar[k]            ar = acceleration of the command

Each input drives its own copy of the sections (every block belongs to one input), so that the
states carry physical meaning: the first state of a block is its filtered input. The
input runs straight between samples; B1 is what the next sample already does within the interval.

The derivatives of the outputs are exact, without numerical differentiation (thesis Eq. 4.12):

    y'[k]  = C1 x[k] + D1 w[k] + E1 w'[k]
    y''[k] = C2 x[k] + D2 w[k] + E2 w'[k] + F2 w''[k]

The tracking error has no direct term (E1 of e is zero for a rigid plant seen from its own
disturbance), so that q' = vr - e' is free of the unknown slope of d.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Ints


@dataclass(frozen=True)
class ModalStep:
    """A loop as 2 x 2 blocks at one sampling interval; k blocks, m inputs, ny outputs.

    Attributes:
        step: sampling interval [s].
        input: index of the input that drives each block, shape (k,).
        A: shape (k, 2, 2); a first-order block leaves its second state at zero.
        B0: weight of the input at the start of the interval, shape (k, 2).
        B1: weight of the input at its end, shape (k, 2).
        C: shape (ny, k, 2).
        D: direct terms of the inputs, shape (ny, m).
        Da: direct terms of the command's acceleration, shape (ny,).
        rate: continuous A of every block [1/s], shape (k, 2, 2).
        drive: continuous B of every block [1/s], shape (k, 2).
    """

    step: float
    input: Ints
    A: Floats
    B0: Floats
    B1: Floats
    C: Floats
    D: Floats
    Da: Floats
    rate: Floats
    drive: Floats

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return self.D.shape[1]

    def equilibrium(self, w: Floats) -> Floats:
        """Return the states at rest under constant inputs ``w``, shape (k, 2)."""
        x = np.zeros((len(self.A), 2))
        x[:, 0] = np.asarray(w, dtype=float)[self.input]
        return x

    def derivative(self, order: int = 1) -> tuple[Floats, Floats, Floats, Floats]:
        """Return C, D, E and F of the outputs' first or second derivative.

        C has shape (ny, k, 2); D, E, F weigh the inputs, their first and second derivatives, shape
        (ny, m).
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
