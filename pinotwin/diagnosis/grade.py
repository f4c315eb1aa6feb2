"""One word for an axis and signal, from its numbers alone: the same in tile, plot, text and JSON.

Is the residual larger than the noise; than what the model left on its own logs; and what of it is left once the named
causes are modelled? An explained share is of squared sizes above the level, hypot(noise, misfit). The thresholds are
the verdict's own.
"""

from __future__ import annotations

import math
from typing import Literal, TypeGuard

from pinotwin.diagnosis.rules import RULES
from pinotwin.system.phrases import PRINTED

Grade = Literal[
    "agrees",
    "within misfit",
    "above misfit",
    "gap explained",
    "partly explained",
    "not explained",
    "not judged",
]

KIND: dict[Grade, str] = {
    "agrees": "good",
    "within misfit": "good",
    "above misfit": "fair",
    "gap explained": "bad",
    "partly explained": "bad",
    "not explained": "bad",
    "not judged": "",
}
"""Grade -> colour of its chip: of the machine's state, for an explained residual is a changed machine."""

State = Literal["changed", "unchanged", "cannot say"]
STATE: dict[str, State] = {"good": "unchanged", "bad": "changed"}
"""Colour of a grade -> state of what it grades."""


def printed(grade: str) -> str:
    """Return the words that people read for a grade: its own, or plainer ones."""
    return PRINTED.get(grade, grade)


OPEN: tuple[Grade, ...] = ("not explained", "partly explained")
"""Grades of a signal that no verdict calls explained."""


def grade(
    rms: float,
    misfit: float | None,
    noise: float | None,
    after: float | None = None,
    *,
    size: float | None = None,
    signal: str = "u",
) -> Grade:
    """Return the grade of one axis and signal, from residuals [unit of the signal].

    ``rms`` is log minus model, ``misfit`` what the model left on its own logs, ``noise`` the scatter of repeats or
    what is assumed, ``after`` the residual with the named causes modelled, ``size`` the RMS of the signal itself,
    against which a machine without a twin is held; None, NaN or 0 where not known. Any but the effort ``u`` is open
    from further on.
    """
    own, level = _known(misfit), left_anyway(noise, misfit)
    n = noise if _known(noise) else 0.0
    quiet = n > 0.0
    if not _known(rms) or not (quiet or own):
        return "not judged"
    if quiet and rms <= RULES.odd * n:
        return "agrees"
    if own and rms <= RULES.odd * level:
        return "within misfit"
    share = explained(rms, level, after)
    if own or size is not None:
        left = is_open(rms if after is None else after, noise, misfit, size, signal=signal)
    else:
        left = after is not None and after > RULES.open_change * level
    enough = RULES.explained_known if own else RULES.explained_unknown
    if after is not None and not left and share >= enough:
        return "gap explained"
    if share >= RULES.explained_part:
        return "partly explained"
    if own:
        left = is_open(rms, noise, misfit, size, signal=signal)
    return "not explained" if left else "above misfit" if own else "not judged"


def is_open(
    left: float, noise: float | None, misfit: float | None, size: float | None, *, signal: str = "u"
) -> bool:
    """Whether more of a residual stays than a model leaves of a healthy axis; see :func:`stays`."""
    known = RULES.open_change if signal == "u" else RULES.open_tracking
    return stays(left, noise, misfit, size) > (known if _known(misfit) else RULES.open_structure)


def stays(left: float, noise: float | None, misfit: float | None, size: float | None) -> float:
    """Return what stays of a residual: levels where a validation error is known, else a share of the size, or 0."""
    level = left_anyway(noise, misfit)
    if _known(misfit):
        return left / max(level, 1e-300)
    return 0.0 if size is None else math.sqrt(max(left**2 - level**2, 0.0)) / max(size, 1e-300)


def left_anyway(noise: float | None, misfit: float | None) -> float:
    """Return noise and validation error together, those of the two that are known: a residual is held against it."""
    return math.hypot(*(x for x in (noise, misfit) if _known(x)))


def explained(rms: float, level: float, after: float | None) -> float:
    """Return the share of the squared residual above the level that goes, at most 1; 0 where nothing is named."""
    if not _known(after) or rms <= level:
        return 0.0
    return min(1.0, (rms**2 - after**2) / (rms**2 - level**2))


def _known(x: float | None) -> TypeGuard[float]:
    return x is not None and math.isfinite(x)
