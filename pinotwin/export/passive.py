"""The passive-force function of an exported MJCF file; its text is copied beside the file."""

from __future__ import annotations

from typing import Any

import numpy as np

from pinotwin.export.runtime import Friction

DATA: dict[str, Any] = {}


class PassiveForce:
    """Adds the efforts that MJCF has no words for to ``data.qfrc_passive``.

    Its memory follows ``data.time``: asked again at the same time (RK4, a sensor, a derivative) it
    answers from the state before; time that goes back starts afresh.

    Args:
        model: the ``mujoco.MjModel``; joints are found by name.
        data: numbers of the machine.
    """

    def __init__(self, model: Any, data: dict[str, Any] = DATA) -> None:
        self.friction = Friction(data)
        joints = [model.joint(name) for name in data["joints"]]
        self.q = np.array([int(j.qposadr[0]) for j in joints])
        self.v = np.array([int(j.dofadr[0]) for j in joints])
        self.time = np.inf
        self.before: Any = None

    def __call__(self, model: Any, data: Any) -> None:
        """Add the efforts; to be given to ``mujoco.set_mjcb_passive``."""
        q, v = data.qpos[self.q], data.qvel[self.v]
        if data.time < self.time:
            self.friction.reset(q, v, float(model.opt.timestep))
            self.before = self.friction.state()
        elif data.time > self.time:
            self.before = self.friction.state()
        else:
            self.friction.restore(self.before)
        self.time = data.time
        data.qfrc_passive[self.v] -= self.friction.effort(q, v)


def install(model: Any, *, memory: bool = False) -> PassiveForce:
    """Make MuJoCo call the function for every model from now on; return it."""
    import mujoco

    data = DATA
    if memory:
        model.dof_frictionloss[:] = 0.0
        model.tendon_frictionloss[:] = 0.0
        data = DATA | {"dry": DATA["whole"]}
    force = PassiveForce(model, data)
    mujoco.set_mjcb_passive(force)
    return force
