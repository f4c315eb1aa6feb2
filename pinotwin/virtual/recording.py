"""What a virtual machine hands out: the log as a controller would write it, and the truth apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.errors import InputError, require
from pinotwin.log import Log


@dataclass(frozen=True)
class SealedTruth:
    """What no log holds; never shown to the identification side."""

    t: Floats  # time [s], shape (m,); its rate may be higher than the log's
    joints: tuple[str, ...]  # names of the columns of q, v, a; a hidden joint is <axis>~
    q: Floats  # true joint positions, shape (m, nv)
    v: Floats  # true joint velocities
    a: Floats  # true joint accelerations
    axes: tuple[str, ...]  # names of the columns of u, friction
    u: Floats  # true motor efforts at the same times, shape (m, na)
    friction: Floats  # true friction efforts, shape (m, na)
    model: pin.Model  # the true rigid bodies and links

    def joint(self, name: str) -> tuple[Floats, Floats, Floats]:
        """Return true position, velocity and acceleration of a joint, each of shape (m,)."""
        require(name, self.joints, "the truth has no joint", InputError)
        j = self.joints.index(name)
        return self.q[:, j], self.v[:, j], self.a[:, j]


@dataclass(frozen=True)
class Recording:
    """One run of a virtual machine."""

    machine: str  # name of the machine
    log: Mapping[str, Floats]  # channel -> values, as a controller would log them (SI)
    truth: SealedTruth  # what the log does not show
    seed: int  # seed of its noise

    def to_log(self) -> Log:
        """Return the log as the rest of pinotwin reads it."""
        return Log(dict(self.log), source=f"virtual {self.machine} (seed {self.seed})")
