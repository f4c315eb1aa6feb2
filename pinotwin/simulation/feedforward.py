"""The effort that a command takes, ahead of time: computed-torque feed-forward from a twin."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from pinotwin.log import Log
from pinotwin.motion import Motion
from pinotwin.simulation.command import motor_coordinates, request

if TYPE_CHECKING:
    from pinotwin.twin import Twin


def feedforward(twin: Twin, log: Log) -> Log:
    """Return the effort of every axis along its command as it stands, ``<axis>.u`` [N or N·m].

    Rigid body, friction, ripple, tables and external loads of the twin at the *commanded* position,
    velocity and acceleration (by cubic spline); nothing is simulated and nothing measured is used.

    Args:
        twin: the machine.
        log: ``t``, ``<axis>.qr`` and external loads.
    """
    asked = request(twin.machine, log)
    a = np.stack([CubicSpline(asked.clock, x)(asked.clock, 2) for x in asked.qr.T], axis=1)
    n = len(asked.clock)
    motion = Motion(
        names=twin.machine.names,
        rotary=twin.machine.rotary,
        t=asked.clock,
        q=asked.qr,
        v=asked.vr,
        a=a,
        u=np.zeros_like(asked.qr),
        segments=(slice(0, n),),
        step=asked.step,
        use=np.ones(asked.qr.shape, dtype=bool),
        external=asked.external if len(asked.external) == n else None,
        source=asked.source,
    )
    effort = asked.at_stamps(twin.effort(motion))
    zero = np.zeros_like(effort)
    u = motor_coordinates(twin.machine, zero, zero, effort)[2]
    channels = {"t": asked.t, **{f"{k}.u": u[:, x.index] for k, x in twin.machine.axes.items()}}
    return Log(channels, source=f"feed-forward for {asked.source}", notes=asked.notes)
