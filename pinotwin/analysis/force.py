"""External effort over time: what a twin cannot account for, with its interval.

    f = twin's effort - measured effort                                 [N or N·m]

is what pushes the axis from outside in the direction of the joint: a process force, contact, a hand. What
the twin leaves of its own logs without any such force (its cross-validated misfit, moving and at rest
apart) is the 90 % interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.twin import Twin

WIDE = 1.645
"""Half width of a 90 % interval in standard deviations."""


@dataclass(frozen=True, eq=False)
class ExternalEffort:
    """External effort of every axis.

    Attributes:
        t: time [s], shape (n,).
        names: axes.
        force: external effort, shape (n, axes) [N or N·m].
        half: half width of its 90 % interval, shape (n, axes).
    """

    t: Floats
    names: tuple[str, ...]
    force: Floats
    half: Floats

    def channels(self) -> dict[str, Floats]:
        """Return ``t`` and, for every axis, ``<axis>.f``, ``.f_low`` and ``.f_high``."""
        out = {"t": self.t}
        for k, name in enumerate(self.names):
            f, h = self.force[:, k], self.half[:, k]
            out |= {f"{name}.f": f, f"{name}.f_low": f - h, f"{name}.f_high": f + h}
        return out

    def beyond(self) -> Floats:
        """Return the share of the time in which each axis' interval leaves out zero, shape (axes,)."""
        return np.asarray(np.mean(np.abs(self.force) > self.half, axis=0))


def external_effort(twin: Twin, log: Log) -> ExternalEffort:
    """Return the external effort along a log.

    Args:
        twin: with its misfit.
        log: servo log of the same machine.

    Raises:
        LogError: a channel is missing or unusable.
        DataError: the twin does not know its misfit.
    """
    if twin.misfit is None:
        raise DataError(f"{twin.machine.name}: this twin does not know its own misfit; identify it again")
    motion = twin.motion(log)
    residual = twin.effort(motion) - motion.u
    inside = motion.inside
    names, force, half = [], [], []
    for name, axis in twin.machine.axes.items():
        if name in twin.misfit.summary:
            names.append(name)
            force.append(np.where(inside, residual[:, axis.index], np.nan)[inside])
            half.append(_half(twin.misfit.summary[name], motion.use[inside, axis.index]))
    return ExternalEffort(motion.t[inside], tuple(names), np.stack(force, axis=1), np.stack(half, axis=1))


def _half(summary: Mapping[str, Any], moving: Mask) -> Floats:
    """Return the half width of every row: the misfit in motion, or that at rest where it is known."""
    at_rest = summary["resting"] if summary["resting"] is not None else summary["rms"]
    return WIDE * np.where(moving, summary["moving"], max(at_rest, summary["moving"]))
