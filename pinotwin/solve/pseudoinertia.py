"""The ten parameters of a body as its pseudo-inertia, and the size by which to judge them.

    J = [[Sigma, h], [h', m]],   Sigma = tr(I)/2 E - I   [kg·m², kg·m; kg·m, kg]

J is positive semidefinite exactly when some distribution of mass has these ten parameters (Wensing,
Kim & Slotine 2018, doi:10.1109/LRA.2017.2729659). Divided by the body's mass and radius of gyration
it is a plain number of trace near 2, so that eigenvalues of a screw and of a gantry compare.

Parameters follow Pinocchio: m, m x, m y, m z, Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats, Ints

ROUNDING = 1e-9
"""An eigenvalue of the scaled pseudo-inertia above minus this is taken as not negative."""


def pseudo_inertia(pi: Floats) -> Floats:
    """Return the pseudo-inertia of ten parameters, shape (4, 4)."""
    m, hx, hy, hz, xx, xy, yy, xz, yz, zz = pi
    return np.array(
        [
            [(yy + zz - xx) / 2, -xy, -xz, hx],
            [-xy, (xx + zz - yy) / 2, -yz, hy],
            [-xz, -yz, (xx + yy - zz) / 2, hz],
            [hx, hy, hz, m],
        ]
    )


@dataclass(frozen=True)
class Size:
    """How large a body is.

    Attributes:
        mass: [kg].
        length: radius of gyration about the joint's origin [m].
    """

    mass: float
    length: float

    def scaled(self, pi: Floats) -> Floats:
        """Return the pseudo-inertia in units of mass and length, shape (4, 4)."""
        unit = np.array([1 / self.length] * 3 + [1.0]) / np.sqrt(self.mass)
        return pseudo_inertia(pi) * np.outer(unit, unit)

    def smallest(self, pi: Floats) -> float:
        """Return the smallest eigenvalue of the scaled pseudo-inertia."""
        return float(np.linalg.eigvalsh(self.scaled(pi))[0])

    def units(self) -> Floats:
        """Return the size of each of the ten parameters, shape (10,)."""
        return self.mass * self.length ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])


def sizes(pi: Floats, bodies: Sequence[Ints]) -> tuple[Size, ...]:
    """Return the size of every body; one without mass or inertia takes the median of the others."""
    mass = np.array([pi[i[0]] for i in bodies])
    spread = np.array([pi[i[4]] + pi[i[6]] + pi[i[9]] for i in bodies]) / 2
    good = (mass > 0) & (spread > 0)
    length = np.sqrt(np.where(good, spread, 1.0) / np.where(good, mass, 1.0))
    usual_mass = float(np.median(mass[good])) if good.any() else 1.0
    usual_length = float(np.median(length[good])) if good.any() else 0.1
    return tuple(
        Size(float(m) if m > 0 else usual_mass, float(l) if ok else usual_length)
        for m, l, ok in zip(mass, length, good, strict=True)
    )
