"""What a virtual machine hands out: the log as a controller would write it, and the truth apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pinotwin.arrays import Floats
from pinotwin.errors import InputError, nearest
from pinotwin.log import Log
from pinotwin.virtual.rigid import Tree


@dataclass(frozen=True)
class SealedTruth:
    """What no log holds; never shown to the identification side.

    Attributes:
        t: time [s], shape (m,); its rate may be higher than the log's.
        joints: names of the columns of ``q``, ``v``, ``a``; a hidden joint is ``<axis>~``.
        q: true joint positions, shape (m, nv).
        v: true joint velocities.
        a: true joint accelerations.
        axes: names of the columns of ``u``, ``friction``.
        u: true motor efforts at the same times, shape (m, na).
        friction: true friction efforts, shape (m, na).
        tree: the true rigid bodies.
        links: link -> (index of its joint, rotation, offset in the joint frame).
    """

    t: Floats
    joints: tuple[str, ...]
    q: Floats
    v: Floats
    a: Floats
    axes: tuple[str, ...]
    u: Floats
    friction: Floats
    tree: Tree
    links: Mapping[str, tuple[int, Floats, Floats]]

    def joint(self, name: str) -> tuple[Floats, Floats, Floats]:
        """Return true position, velocity and acceleration of a joint, each of shape (m,)."""
        if name not in self.joints:
            raise InputError(f"no joint {name!r} in the truth; {nearest(name, self.joints)}")
        j = self.joints.index(name)
        return self.q[:, j], self.v[:, j], self.a[:, j]


@dataclass(frozen=True)
class Recording:
    """One run of a virtual machine.

    Attributes:
        machine: name of the machine.
        log: channel -> values, as a controller would log them (SI).
        truth: what the log does not show.
        seed: seed of its noise.
    """

    machine: str
    log: Mapping[str, Floats]
    truth: SealedTruth
    seed: int

    def to_log(self) -> Log:
        """Return the log as the rest of pinotwin reads it."""
        return Log(dict(self.log), source=f"virtual {self.machine} (seed {self.seed})")
