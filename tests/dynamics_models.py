"""Small models for the tests of ``pinotwin.dynamics``: random trees and a laser driller."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin


def body(m, com, inertia=None):
    """A body from mass, centre of mass and tensor xx xy yy xz yz zz about the joint frame."""
    xx, xy, yy, xz, yz, zz = inertia if inertia is not None else (0.0,) * 6
    h = m * np.asarray(com, dtype=float)
    return pin.Inertia.FromDynamicParameters(np.array([m, *h, xx, xy, yy, xz, yz, zz]))


def driller(h=0.08, a=0.0, seed=1):
    """X-Y nozzle branch and Z-B-C table branch, as in DESIGN section 4; generic inertias."""
    rng = np.random.default_rng(seed)
    model = pin.Model()
    model.name = "driller"
    place = pin.SE3.Identity

    def add(parent, axis, kind, placement, name):
        joint = getattr(pin, f"JointModel{kind}Unaligned")(np.array(axis, dtype=float))
        i = model.addJoint(parent, joint, placement, name)
        model.addJointFrame(i)  # buildReducedModel crashes without
        model.appendBodyToJoint(i, random_body(rng), pin.SE3.Identity())
        return i

    x = add(0, (1, 0, 0), "Prismatic", place(), "X")
    add(x, (0, 1, 0), "Prismatic", place(), "Y")
    z = add(0, (0, 0, -1), "Prismatic", place(), "Z")
    b = add(z, (0, -1, 0), "Revolute", place(), "B")
    add(b, (0, 0, -1), "Revolute", pin.SE3(np.eye(3), np.array([a, 0.0, h])), "C")
    model.armature = rng.uniform(0.1, 1.0, 5)
    return model


def random_body(rng):
    """A physically possible body: point masses scattered about the joint frame."""
    points = rng.normal(size=(6, 3)) * 0.2 + rng.normal(size=3) * 0.1
    weights = rng.uniform(0.2, 2.0, 6)
    total = pin.Inertia.Zero()
    for w, r in zip(weights, points, strict=True):
        total = total + pin.Inertia(w, r, np.zeros((3, 3)))
    return total


def random_tree(rng, joints=6, kinds="RP"):
    """A tree with random branching, axes, placements, inertias and rotor inertias."""
    model = pin.Model()
    model.name = "random"
    for i in range(joints):
        kind = {"R": "Revolute", "P": "Prismatic"}[rng.choice(list(kinds))]
        axis = rng.normal(size=3)
        if rng.uniform() < 0.4:
            axis = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
        joint = getattr(pin, f"JointModel{kind}Unaligned")(axis / np.linalg.norm(axis))
        R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        R *= np.sign(np.linalg.det(R))
        # depth first, as Pinocchio's mass matrix needs it: on the last joint or one that carries it
        chain = [i]
        while chain[-1]:
            chain.append(int(model.parents[chain[-1]]))
        parent = chain[min(int(rng.integers(0, 3)), len(chain) - 1)]
        j = model.addJoint(parent, joint, pin.SE3(R, rng.normal(size=3) * 0.3), f"j{i + 1}")
        model.addJointFrame(j)
        model.appendBodyToJoint(j, random_body(rng), pin.SE3.Identity())
    model.armature = rng.uniform(0.01, 1.0, joints)
    return model


def motion(rng, model, n=20):
    """Random positions, velocities and accelerations."""
    return tuple(rng.uniform(-2.0, 2.0, (n, model.nv)) * s for s in (1.0, 1.5, 4.0))


def robot(relative):
    """A robot of example-robot-data, without its meshes; the hand of a Panda locked."""
    share = next(Path(p) for p in _shares() if (Path(p) / relative).exists())
    model = pin.buildModelFromUrdf(str(share / relative))
    fingers = [model.getJointId(n) for n in model.names if "finger" in n]
    return pin.buildReducedModel(model, fingers, pin.neutral(model)) if fingers else model


def _shares():
    root = Path(pin.__file__).parents[4]
    return [*root.glob("**/example-robot-data/robots"), Path(".")]


UR10 = "ur_description/urdf/ur10_robot.urdf"
PANDA = "panda_description/urdf/panda.urdf"
