"""One word for an axis and signal, from its numbers alone: the same in tile, plot, text and JSON.

    level = hypot(noise, misfit):   what is left even when nothing has changed

A gap is asked three questions in turn: is it larger than the noise; is it larger than what the model left on
its own logs; and what of it is left once the named causes are modelled. An explained share is one of squared
sizes above the level, for that is what a cause takes away.
"""

from __future__ import annotations

import math
from typing import Literal

Grade = Literal[
    "agrees",
    "within the model's own misfit",
    "gap explained",
    "partly explained",
    "not explained",
    "not judged",
]

BEYOND = 1.5
"""A gap counts from so many times the level on: repeats of a healthy machine scatter below it."""
WHOLE = 0.9
"""Share of the squared gap above the level from which on it counts as explained; what stays must also be
within twice ``BEYOND`` of the level, or it would still be seen at a glance."""
PART = 0.2
"""Below this share nothing worth a word is explained."""

KIND: dict[Grade, str] = {
    "agrees": "good",
    "within the model's own misfit": "",
    "gap explained": "good",
    "partly explained": "fair",
    "not explained": "bad",
    "not judged": "",
}
"""Grade -> colour of its chip."""


def grade(rms: float, misfit: float | None, noise: float | None, after: float | None = None) -> Grade:
    """Return the grade of one axis and signal.

    Args:
        rms: gap, log minus model [unit of the signal].
        misfit: what the model left on its own logs, cross-validated [same]; None or NaN when not known.
        noise: scatter of repeats, or the assumed noise [same]; None or NaN when not known.
        after: gap with the named causes modelled [same]; None where no cause is named for it.
    """
    if not _known(rms) or not _known(noise):
        return "not judged"
    assert noise is not None
    if rms <= BEYOND * noise:
        return "agrees"
    if not _known(misfit) and after is None:
        return "not judged"  # whether the gap is the model's own cannot be said
    level = math.hypot(noise, misfit) if misfit is not None and _known(misfit) else noise
    if rms <= BEYOND * level:
        return "within the model's own misfit"
    share = explained(rms, level, after)
    if share >= WHOLE and after is not None and after <= 2.0 * BEYOND * level:
        return "gap explained"
    return "partly explained" if share >= PART else "not explained"


def explained(rms: float, level: float, after: float | None) -> float:
    """Return the share of the squared gap above the level that goes, at most 1; 0 where nothing is named."""
    if after is None or not _known(after) or rms <= level:
        return 0.0
    return min(1.0, (rms**2 - after**2) / (rms**2 - level**2))


def told(rms: float, misfit: float | None, noise: float | None, after: float | None, unit: str) -> str:
    """Return the numbers behind a grade in one line, with units."""
    parts = [f"gap {rms:.3g} {unit}"] if _known(rms) else ["gap not known"]
    if after is not None and _known(after):
        parts.append(f"{after:.3g} {unit} with the named causes")
    parts.append(f"noise {noise:.2g} {unit}" if noise is not None and _known(noise) else "noise not known")
    if misfit is not None and _known(misfit):
        parts.append(f"model's own misfit {misfit:.2g} {unit}")
    return ", ".join(parts)


def _known(x: float | None) -> bool:
    return x is not None and math.isfinite(x)
