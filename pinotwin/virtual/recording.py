"""What a virtual machine hands out: the log as a controller would write it, and the truth apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import InputError, nearest
from pinotwin.log import Log
from pinotwin.virtual.rigid import Tree, body_forces, empty_pose, move, place, place_in_world


@dataclass(frozen=True)
class LinkMotion:
    """True motion of a link, world axes; ``n`` samples.

    Attributes:
        t: time [s], shape (n,).
        rotation: link frame in the world, shape (n, 3, 3).
        position: origin of the link frame [m], shape (n, 3).
        angular_velocity: [rad/s], shape (n, 3).
        angular_acceleration: [rad/s²], shape (n, 3).
        acceleration: of the frame's origin, gravity not included [m/s²], shape (n, 3).
    """

    t: Floats
    rotation: Floats
    position: Floats
    angular_velocity: Floats
    angular_acceleration: Floats
    acceleration: Floats


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

    def link_motion(self, link: str) -> LinkMotion:
        """Return the true motion of a link of the URDF, as an IMU on it would feel."""
        if link not in self.links:
            raise InputError(f"no link {link!r} in this machine; {nearest(link, self.links)}")
        joint, rotation, offset = self.links[link]
        return link_motion(self, joint, rotation, offset)


def link_motion(truth: SealedTruth, joint: int, rotation: Floats, offset: Floats) -> LinkMotion:
    """Return the true motion of a frame fixed to a joint's body.

    Args:
        truth: the recording's truth.
        joint: index of the joint.
        rotation: the frame in the joint frame, shape (3, 3).
        offset: its origin in the joint frame [m], shape (3,).
    """
    n, tree, pose = len(truth.t), truth.tree, empty_pose(len(truth.joints))
    R, p, w, dw, a = (np.zeros((n, *s)) for s in ((3, 3), (3,), (3,), (3,), (3,)))
    for k in range(n):
        place(tree, truth.q[k], pose)
        place_in_world(tree, pose)
        move(tree, truth.v[k], truth.a[k], pose)
        body = pose.R[joint]
        R[k] = body @ rotation
        p[k] = pose.p[joint] + body @ offset
        w[k], dw[k] = body @ pose.w[joint], body @ pose.dw[joint]
        arm = body @ offset
        a[k] = body @ pose.a[joint] + tree.gravity
        a[k] += np.cross(dw[k], arm) + np.cross(w[k], np.cross(w[k], arm))
    return LinkMotion(truth.t, R, p, w, dw, a)


def inverse_dynamics(truth: SealedTruth) -> Floats:
    """Return the rigid-body efforts of the true motion, shape (m, nv), armature left out."""
    from pinotwin.virtual.rigid import joint_efforts

    out, pose = np.zeros_like(truth.q), empty_pose(len(truth.joints))
    for k in range(len(truth.t)):
        place(truth.tree, truth.q[k], pose)
        move(truth.tree, truth.v[k], truth.a[k], pose)
        body_forces(truth.tree, pose)
        joint_efforts(truth.tree, pose, out[k])
    return out


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
