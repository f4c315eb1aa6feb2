"""Axes whose efforts are the twin's while their tracking error is not: what the verdict says of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from pinotwin.diagnosis.grade import stays
from pinotwin.diagnosis.result import Diagnosis, Gap
from pinotwin.diagnosis.rules import RULES, Rules


def off_track(gaps: Mapping[str, Gap], level: float) -> dict[str, float]:
    """Return axis -> times its tracking error is off by what the twin's own logs leave, of those beyond a level."""
    times = {a: stays(g.rms, g.noise, g.misfit, None) for a, g in gaps.items() if math.isfinite(g.misfit)}
    return {axis: x for axis, x in times.items() if x > level}


def strayed(found: Diagnosis, rules: Rules = RULES) -> Diagnosis:
    """Return the diagnosis with axes left open that follow their command otherwise than the twin does.

    Where a cause is named its own consequences are in the tracking error, of other axes too: nothing is added then.
    """
    if found.effects or found.possible:
        return found
    closed = {a: row["e"] for a, row in found.gap.items() if "e" in row and a not in found.unexplained}
    off = off_track(closed, rules.open_tracking)
    if not off:
        return found
    said = [
        f"{axis} follows its command otherwise than its twin ({x:.1f} times what the simulation left of the twin's own "
        "logs) though its effort agrees: look at its controller and at what shapes its command"
        for axis, x in off.items()
    ]
    before = [] if found.verdict == "none" else [found.sentence]
    unexplained = {**found.unexplained, **{axis: {"e": 1.0} for axis in off}}
    return replace(
        found, verdict="unexplained", sentence=". ".join([*before, *said]), unexplained=unexplained
    )
