"""Where a command leaves what a twin knows, and the error of the effort that must be expected there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.simulation.command import Request
from pinotwin.system.phrases import BEYOND

if TYPE_CHECKING:
    from pinotwin.twin import Twin


def beyond(twin: Twin, asked: Request, most: int = 2000) -> tuple[str, ...]:
    """Return a note about where an effect along the travel is less known than the twin's misfit, of ``most`` rows."""
    step = max(len(asked.qr) // most, 1)
    q, v, names = asked.qr[::step], asked.vr[::step], (twin.machine.names, twin.machine.rotary)
    motion = Motion.exact(names, asked.clock[::step], q, v, np.zeros_like(v), step=step * asked.step)
    if twin.misfit is None:
        return ()
    error, found = unsure(twin, motion, twin.misfit.motion), []
    for effect in twin.effects:
        own = twin.misfit.summary.get(str(effect.axis))
        if not effect.local or own is None:
            continue
        j = motion.index(str(effect.axis))
        strange = error[:, j] > own["moving"]
        if places := _places(q[:, j], strange):
            size = float(np.hypot(rms(error[strange, j]), own["moving"]))
            of = {"axis": effect.axis, "unit": "rad" if motion.rotary[j] else "m", "effort": own["unit"]}
            found.append(
                BEYOND["axis"].format(**of, places=", ".join(places), share=strange.mean(), error=size)
            )
    return (BEYOND["note"].format(axes="; ".join(found)),) if found else ()


def unsure(twin: Twin, motion: Motion, own: Motion) -> Floats:
    """Return the error of the twin's effort in a motion, (n, nv) [N or N·m].

    Of an unknown effect it is how far the value that it holds there is from those along its ``own`` travel.
    """
    error = twin.effort_error(motion)
    for effect, theta in twin.pairs:
        strange = ~effect.known(motion)
        if strange.any():
            j = twin.machine.axes[str(effect.axis)].index
            here, along = (effect.columns(m).effort(theta, twin.machine.nv)[:, j] for m in (motion, own))
            off = np.hypot(np.std(along), here[strange] - np.mean(along))
            error[strange, j] = np.hypot(error[strange, j], off)
    return error


def _places(q: Floats, strange: Mask, count: int = 50) -> list[str]:
    """Return the ranges of some positions (n,) [m or rad] in which most are strange, of ``count`` even parts."""
    edges = np.linspace(q.min(), q.max(), count + 1)
    part = np.clip(np.searchsorted(edges, q, side="right") - 1, 0, count - 1)
    share = np.bincount(part, strange, count) / np.maximum(np.bincount(part, minlength=count), 1)
    turns = edges[np.flatnonzero(np.diff(np.r_[False, share > 0.5, False]))]
    return [f"{low:.3g} to {high:.3g}" for low, high in turns.reshape(-1, 2)]
