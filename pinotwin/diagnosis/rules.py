"""Every threshold of a decision, in one place: meaning, unit, value, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Rules:
    """Thresholds of the diagnosis."""

    block_time: float = 0.5
    """[s] shortest stretch of a log that counts as one witness."""
    good_model: float = 0.01
    """[of the effort's variation] what a good model of a healthy axis leaves."""
    share: float = 0.10
    """[of the squared residual of its axis] least that a cause closes on rows not fitted."""
    strength_change: float = 12.0
    """[squared standard errors per number] least size of a change against the twin's own logs."""
    share_structure: float = 0.2
    size_structure: float = 0.015
    strength_structure: float = 12.0
    as_good: float = 0.97
    """[of the best gain] a simpler candidate that reaches this is preferred."""
    most: int = 8


RULES = Rules()
