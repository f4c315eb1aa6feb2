"""The servo log and the reconstructed vibration as one log, ready for ``identify``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.reconstruction.combine import at_stamps
from pinotwin.reconstruction.result import Vibration


def with_vibration(
    log: Log, vibration: Vibration | Log, joint: str | None = None, *, row: bool = False
) -> Log:
    """Return the servo log with the channel ``<joint>.v`` of the vibration; DataError where that does not cover it.

    The velocity is all that the motors' equations take (thesis Eq. 7.2); ``row`` adds ``.q`` and ``.a`` as well.
    """
    if isinstance(vibration, Vibration):
        vibration = vibration.to_log()
    names = [c.rpartition(".")[0] for c in vibration.channels if c.endswith(".v")]
    name = joint if joint is not None else next(iter(names), "")
    channels = dict(log.channels)
    units = dict(log.units)
    kinds = ("q", "v", "a") if row else ("v",)
    for kind in kinds:
        if f"{name}.{kind}" not in vibration:
            raise DataError(
                f"{vibration.source}: no channel {name or '<joint>'}.{kind}; give the file that "
                "`pinotwin vibration` wrote"
            )
        channels[f"{name}.{kind}"] = at_stamps(log.t, vibration.t, vibration[f"{name}.{kind}"], bridged=3.5)
        units.pop(f"{name}.{kind}", None)
    known = np.isfinite(channels[f"{name}.v"]).mean() if len(log) else 0.0
    if known < 0.5:
        raise DataError(
            f"{vibration.source}: covers {known:.0%} of {log.source}; it must be of the same run, "
            "on the same clock"
        )
    scale = {**log.scale, **{f"{name}.{k}": (1.0, 0.0) for k in kinds}} if log.scale else {}
    return replace(log, channels=channels, units=units, scale=scale)
