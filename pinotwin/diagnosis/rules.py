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
    as_good_kin: float = 0.92
    as_good_curve: float = 0.6
    second_share: float = 0.1
    needless: float = 0.1
    excess: float = 0.9
    most: int = 8
    push: float = 4.0
    push_strong: float = 2.2
    push_short: float = 0.25
    push_better: float = 1.1
    most_of_time: float = 0.9
    push_size: float = 0.005
    law_holds: float = 0.35
    law_worse: float = 2.5
    law_level: float = 0.2
    law_share: float = 0.8
    law_forward: float = 0.9
    left_behind: float = 5.0
    at_limit: float = 5.0
    open_change: float = 2.5
    open_structure: float = 0.15
    odd: float = 1.5
    prior_right: float = 1.0
    prior_wrong: float = 0.5
    quick_confidence: float = 0.7
    push_confidence: float = 0.85
    servo_confidence: float = 0.85
    vibration_gap: float = 0.35
    vibration_form: float = 0.1
    vibration_share: float = 0.2
    vibration_moved: float = 4.0
    vibration_stays: float = 0.15
    vibration_quiet: float = 0.25
    vibration_confidence: float = 0.9


RULES = Rules()
