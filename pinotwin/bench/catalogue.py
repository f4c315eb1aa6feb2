"""What the bench puts into a truth: effects, their sizes, where they make sense, what imitates them."""

from __future__ import annotations

SIZES: dict[str, tuple[float, float]] = {
    "viscous": (0.002, 0.04),
    "coulomb": (0.001, 0.03),
    "coulomb_asymmetric": (0.003, 0.05),
    "stribeck": (0.004, 0.06),
    "presliding": (0.1, 2.0),
    "ripple": (0.002, 0.03),
    "ripple_modulated": (0.0008, 0.02),
    "position_table": (0.002, 0.03),
    "load_friction": (0.006, 0.12),
    "viscous_thermal": (0.05, 0.8),
    "drive_flexibility": (0.01, 0.3),
    "joint_flexibility": (0.05, 0.5),
    "backlash": (0.005, 0.2),
    "encoder_error": (0.03, 0.6),
    "delay": (0.02, 0.4),
    "geometric_error": (0.02, 0.4),
    "quadratic_drag": (0.004, 0.1),
    "effort_scale": (0.005, 0.1),
    "external_force": (0.01, 0.3),
    "payload": (0.005, 0.2),
    "inertial_coupling": (0.005, 0.2),
    "feedforward": (0.03, 0.4),
    "saturation": (0.25, 0.5),
    "ripple_speed": (0.005, 0.1),
    "coulomb_position": (0.005, 0.1),
    "mains": (0.002, 0.05),
    "chatter": (0.02, 0.2),
    "gms": (0.02, 0.3),
    "ripple_triangle": (0.002, 0.03),
    "loop_delay": (0.03, 0.15),
}
"""Effect -> smallest and largest relative size, drawn log-uniformly (units: virtual.doses)."""

CHANGE_SIZES: dict[str, tuple[float, float]] = {"presliding": (0.004, 0.1)}
"""The same where the effect is there already and grows."""

OUTSIDE = ("ripple_speed", "coulomb_position", "mains", "chatter")
"""Effects that no catalogue entry describes."""

FORMS: dict[str, str] = {"gms": "presliding", "ripple_triangle": "ripple", "loop_delay": "delay"}
"""Right effect in another functional form than the catalogue's -> the name that is right."""

AFTERWARDS = ("payload", "inertial_coupling", "effort_scale", "feedforward")
"""Effects that can only come after a twin was identified: a refit absorbs them."""

STRUCTURE = tuple(name for name in SIZES if name not in (*AFTERWARDS, *OUTSIDE, *FORMS))
"""Effects that a model which is fitted to the log itself can be seen to lack."""

CHANGE = (*STRUCTURE, *AFTERWARDS)  # effects that can come after a twin was identified

LOOP_ONLY = ("feedforward", "saturation", "loop_delay")
"""Effects of the controller: what they change is the tracking error; the plant stays as it was."""

ROTARY = ("ripple_modulated",)
"""Effects that repeat with the turn of an axis; on a linear one they are another effect."""

MANY_AXES = ("inertial_coupling", "geometric_error")  # effects that need more than one axis

PERIODIC = ("ripple", "ripple_modulated", "ripple_triangle", "position_table")

COVERED_BY: dict[str, tuple[str, ...]] = {
    "viscous": ("viscous", "viscous_asymmetric"),
    "coulomb": ("coulomb", "coulomb_asymmetric", "presliding"),
    "coulomb_asymmetric": ("coulomb_asymmetric",),
    "stribeck": ("stribeck", "presliding"),
    "presliding": ("presliding",),
    "gms": ("presliding",),
    **dict.fromkeys(PERIODIC, ("ripple", "ripple_modulated", "position_table")),
    "quadratic_drag": ("quadratic_drag",),
}
"""Effect of the truth -> entries of machine.yaml that know it already: taken off the listing."""

TAKEN_OUT: dict[str, tuple[str, ...]] = {
    "coulomb": ("coulomb", "stribeck"),
    "gms": ("presliding",),
    **dict.fromkeys(PERIODIC, ("ripple", "position_table")),
    "quadratic_drag": ("quadratic_drag",),
}
"""Effect taken off a listing -> what the truth loses first, so that it then has the drawn size."""

IMITATORS: tuple[frozenset[str], ...] = (
    frozenset({"ripple", "ripple_modulated", "position_table"}),
    frozenset({"payload", "inertial_coupling", "rigid_body", "wrist_coupling"}),
    frozenset({"drive_flexibility", "joint_flexibility"}),
    frozenset({"coulomb_asymmetric", "offset", "viscous_asymmetric"}),
    frozenset({"coulomb", "presliding", "stribeck"}),
)
"""Effects that say the same in other words: left out of a catalogue together."""

EXACT: tuple[frozenset[str], ...] = (
    frozenset({"drive_flexibility", "joint_flexibility"}),
    frozenset({"coulomb_asymmetric", "offset"}),
    frozenset({"payload", "inertial_coupling"}),
    frozenset({"feedforward", "acceleration_feedforward"}),  # what a virtual machine's `feedforward` is
)
"""Classes that no motion of one axis can split: always merged, never in the strict row."""

CONTAINED_IN: dict[str, frozenset[str]] = {
    "coulomb": frozenset({"coulomb_asymmetric"}),
    "viscous": frozenset({"viscous_asymmetric"}),
}
"""Effect -> entries of which it is a case: a catalogue that has one of them has not lost the effect."""


def left_out_with(effect: str) -> tuple[str, ...]:
    """Return what a catalogue must lose so that an effect is unknown to it."""
    kin = next((g for g in IMITATORS if effect in g), frozenset({effect}))
    return tuple(sorted(kin | {effect} | CONTAINED_IN.get(effect, frozenset())))
