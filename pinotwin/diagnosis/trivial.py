"""What is real but gets no name: too small to matter, or what a first-order column leaves over."""

from __future__ import annotations

import numpy as np

from pinotwin.diagnosis.admission import Judged, admit
from pinotwin.diagnosis.ledger import build_ledger, residual_of
from pinotwin.diagnosis.stage import Stage

LATENCY = 3e-4  # [s] a delay below this is every machine's own and gets no name
MATTERS = 0.01  # gap power over noise power below which an effect is too small to matter
LEFT_OVER = 0.10  # of an effect's gain: what a first-order column may leave to its like on its axis
LEFT_OVER_OTHERS = 0.01  # the same to effects of another kind
LEFT_OVER_ELSEWHERE = 0.03  # the same on other axes, where it moves the rigid body of them all
LEFT_OVER_APART = 0.001  # the same on other axes, where it acts on its own alone
LEFT_OVER_SHAKING = 0.25  # the same on other axes, where both shake them
SHAKING = {"drive_flexibility", "backlash", "encoder_error"}  # all axes feel them
KINDS = (
    {"ripple", "ripple_modulated", "position_table", "encoder_error"},
    {
        "drive_flexibility",
        "backlash",
        "delay",
        "payload",
        "rotor_inertia",
        "wrist_coupling",
        "geometric_error",
        "gravity",
        "effort_scale",
    },
    {
        "coulomb",
        "coulomb_asymmetric",
        "offset",
        "viscous",
        "viscous_asymmetric",
        "viscous_thermal",
        "stribeck",
        "quadratic_drag",
        "load_friction",
        "presliding",
    },
)
"""Effects that have much in common: what one of them leaves over looks like another."""


def left_by(found: Judged, gain: float, other: Judged) -> bool:
    """Whether an effect may be what the first-order column of a found one leaves over.

    Args:
        found: effect that is named already.
        gain: of it, given the other one: two that hide each other leave nothing of the kind.
        other: effect that is asked about.
    """
    return _leaves(found, other) * gain > other.G


def trivial(judged: Judged, stage: Stage, plain: Stage) -> bool:
    """Whether an effect is real but too small to matter."""
    if judged.candidate.effect == "delay" and abs(float(judged.theta[0])) < LATENCY:
        return True
    least = MATTERS * rows_of(judged, stage)
    if least > judged.G:
        return True
    if stage.base.change:  # a twin's own parameters absorb a change, at the price of their prior
        return least > _effort(judged, plain)
    return least > _power(plain) - _power(admit(plain, [judged]))


def _leaves(found: Judged, other: Judged) -> float:
    """Return the share of an effect's gain that its column of first order may leave to another effect."""
    effect = found.candidate.effect
    if found.candidate.axis == other.candidate.axis:
        kin = any({effect, other.candidate.effect} <= kind for kind in KINDS)
        return LEFT_OVER if kin else LEFT_OVER_OTHERS
    if {effect, other.candidate.effect} <= SHAKING:
        return LEFT_OVER_SHAKING
    wide = len(found.joints) > 1 or effect in SHAKING
    return LEFT_OVER_ELSEWHERE if wide else LEFT_OVER_APART


def _effort(judged: Judged, stage: Stage) -> float:
    """Return the squared effort of an effect on a plain stage, in units of the noise."""
    columns = stage.project(judged.candidate.columns)
    return float(sum(np.sum((x @ judged.theta) ** 2) for x in columns if x is not None))


def _power(stage: Stage) -> float:
    """Return the squared residual of a plain stage in units of the noise."""
    ledger = build_ledger(stage)
    return float(sum(np.sum(residual_of(p, ledger.theta) ** 2) for p in stage.pieces))


def rows_of(judged: Judged, stage: Stage) -> int:
    """Return the number of rows that an effect acts on."""
    joints = judged.joints
    if judged.candidate.axis is not None:
        own = stage.rows.motions[0].index(judged.candidate.axis)
        joints = {own} if own in joints else joints
    return sum(len(p.y) for p in stage.pieces if p.channel.joint in joints)
