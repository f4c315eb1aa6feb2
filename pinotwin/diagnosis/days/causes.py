"""A row of evidence in the words and units of the contract: name of the effect, its numbers, where it acts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pinotwin.arrays import Mask
from pinotwin.diagnosis.conclusion.sizes import body_sizes, largest, sized
from pinotwin.diagnosis.days.forms import known, parts
from pinotwin.diagnosis.days.law import Law
from pinotwin.diagnosis.days.mechanisms import ENCODER, GROWS, Ends, knows, part_of
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.row import ALL, Row
from pinotwin.diagnosis.days.stretch import Stretch
from pinotwin.diagnosis.payload import plain_body
from pinotwin.diagnosis.result import Region, Size
from pinotwin.effects import Effect
from pinotwin.units import of_axis

ROWS = {
    "coulomb": ("friction_since", "friction_at_start", "cross_friction", "motor_coulomb"),
    "viscous": ("motor_viscous",),
    "offset": ("drift",),
    "zero": ("zero_since",),
    "payload": ("inertia",),
    "drive_flexibility": ("compliance",),
    "loop_gain": ("proportional_gain",),
    "backlash": ("lost_motion", "lost_motion_by_load", "lost_motion_either_side"),
    "encoder_step": ("load_moved",),
    "external_force": ("push", "cut", "snag"),
    "position_table": ("tooth",),
    "effort_scale": ("torque_constant", "torque_fades"),
    "delay": ("effort_late",),
    "encoder_scale": ("encoder_grows",),
    "encoder_error": ("encoder_period", "encoder_along"),
    "saturation": ("limit",),
}
"""Effect of the contract -> rows that name it; others keep their name."""
EFFECT = {row: effect for effect, rows in ROWS.items() for row in rows}


@dataclass(frozen=True, eq=False)
class Place:
    """What a row is read beside: healthy days, its axis, the stretches in question."""

    reference: Reference
    axis: str
    logs: Sequence[Stretch]

    @property
    def effort(self) -> float:
        """RMS of the effort on healthy days [N or N·m]."""
        return float(self.reference.widths[self.axis]["effort"])

    def unit(self, of: str) -> str:
        """Return a unit in which F, x and I stand for that of effort, position and inertia of the axis."""
        machine = self.reference.twin.machine
        return of_axis(of, machine.rotary[machine.names.index(self.axis)])

    def spread(self, channel: str) -> float:
        """Return how far a channel varies in the logs in question [its unit]."""
        return float(np.mean([np.std(s.axes[self.axis][channel]) for s in self.logs]))

    def friction(self, part: str) -> tuple[float, float]:
        """Return the twin's number of dry or viscous friction [its unit], and what one unit of a row's number is of it.

        Known by another law than Coulomb's, it is the size of that friction over the direction, or over the speed.
        """
        name, course = ("coulomb", "sg") if part == "dry" else ("viscous", "v")
        columns = [s.axes[self.axis] for s in self.logs]
        size = float(np.mean([np.std(part_of(c, part, self.effort)) for c in columns])) / self.spread(course)
        number = (self.known(name) or size) if knows(columns[0], part, self.effort) else 0.0
        return number, number or size

    def known(self, effect: str) -> float:
        """Return the first number that the twin has of an effect on the axis [its unit]; 0 of one that it has not."""
        pairs = self.reference.twin.pairs
        return next((float(theta[0]) for e, theta in pairs if (e.name, e.axis) == (effect, self.axis)), 0.0)


def effect_of(name: str) -> str:
    """Return the effect of the contract that a row names."""
    return EFFECT.get(name, name)


def plain_row(row: Row, axis: str) -> dict[str, Any]:
    """Return a row of evidence of diagnosis.json: gain by signal [nats], probability [1], and effects of its class."""
    score = {k: row.by.get(e, 0.0) for k, e in (("u", "plant"), ("law", "law"), ("ql", "encoders"))}
    score["u"] += row.by.get("day", 0.0)
    effects = list(dict.fromkeys(map(effect_of, (row.name, *row.alike))))
    names = {"effect": effects[0], "axis": axis, "score": score, "class": effects, "total": row.score}
    return {**row.plain(), **names}


def axis_of(row: Row, r: Reference) -> str:
    """Return the axis of a row; of a body that of the last link."""
    return r.axes[-1] if row.axis == ALL else row.axis


def sizes(row: Row, at: Place) -> list[Size]:
    """Return what changed from what to what, with 90 % intervals."""
    if row.name == "payload":
        return body_sizes(plain_body(row.numbers), np.diag(plain_body(row.errors) ** 2))
    if effect_of(row.name) == "external_force":
        return [_largest(row, "plant", "largest disturbance", at.unit("F"))]
    if row.name in ("encoder_period", "encoder_along"):
        return [_largest(row, "encoders", "encoder_error.largest", at.unit("x"))]
    if row.form is not None:
        return _coefficients(row, row.form, at)
    name, before, factor, unit = unit_of(row.name, at)
    if row.group in ("limit", "recording"):
        return [sized(name, before if row.name == "limit" else np.nan, row.theta, unit, np.nan)]

    def after(x: float) -> float:
        # A compliance is a number of what the drive gives, not of its stiffness.
        return before / max(1.0 + x, 1e-9) if row.name == "compliance" else before + factor * x

    low, now, high = sorted(after(row.theta + k * row.error) for k in (-1.645, 0.0, 1.645))
    least = 0.0 if row.group == "friction" else -np.inf
    steady = row.place is None and when(row, at).get("kind") == "always"
    own = row.own if steady else 0.0  # of another place or instant it tells nothing
    return [Size(name, max(after(own), least), max(now, least), unit, (low, high))]


def _coefficients(row: Row, form: Effect, at: Place) -> list[Size]:
    """Return the coefficients of an effect before and after, those that cannot be below a bound at that bound."""
    out = []
    each = [k for part in parts(form) for k in part.coefficients()]
    before = known(at.reference.twin, form)
    for k, old, x, error in zip(each, before, row.numbers * row.scale, row.errors * row.scale, strict=True):
        new = float(np.clip(old + x, k.lower, k.upper))
        out.append(sized(f"{row.name}.{k.name}", float(old), new, k.unit, abs(error)))
    return out


def unit_of(name: str, at: Place) -> tuple[str, float, float, str]:
    """Return name, old value, what one unit of the row's number is, and unit of the number that changed."""
    dry, viscous = at.friction("dry"), at.friction("viscous")
    law = at.reference.laws.get(at.axis, Law())
    kp, ki = law.cascade
    stiff = -1.0 / min(float(at.reference.twists.get(at.axis, -np.ones(1))[0]), -1e-300)
    table = {
        "coulomb": ("coulomb.c", *dry, "F"),
        "friction_at_start": ("coulomb.after_starts", 0.0, at.effort, "F"),
        "motor_coulomb": ("coulomb.at_the_motor", 0.0, at.effort, "F"),
        "motor_viscous": ("viscous.at_the_motor", 0.0, at.effort / at.spread("v"), "F·s/x"),
        "cross_friction": ("coulomb.along_stroke", 0.0, at.effort, "F"),
        "viscous": ("viscous.b", *viscous, "F·s/x"),
        "offset": ("offset.f0", at.known("offset"), at.effort, "F"),
        "drift": ("offset.drift", 0.0, at.effort, "F"),
        "inertia": ("payload.inertia", 0.0, at.effort / at.spread("a"), "I"),
        "compliance": ("drive_flexibility.stiffness", stiff, -stiff, "F/x"),
        "effort_scale": ("effort_scale.share", 0.0, 1.0, "-"),
        "effort_late": ("delay.seconds", 0.0, 1e-3, "s"),
        "position_gain": ("position_gain.kp", kp, kp, "1/s"),
        "velocity_feedforward": ("velocity_feedforward.share", law.ahead[0], 1.0, "-"),
        "acceleration_feedforward": ("acceleration_feedforward.inertia", law["ar"], law.inertia, "I"),
        "integral": ("integral.ki", ki, law.proportional, "F/x"),
        "dead_band": ("dead_band.half_width", 0.0, at.spread("e") if law.stable else 1.0, "x"),
        "zero": ("zero.shift", 0.0, 1.0, "x"),
        "encoder_step": ("encoder_step.step", 0.0, ENCODER, "x"),
        "encoder_scale": ("encoder_scale.error", 0.0, ENCODER, "1"),
        "backlash": ("backlash.gap", 0.0, ENCODER, "x"),
        "tooth": ("position_table.peak", 0.0, at.effort, "F"),
        "limit": ("saturation.limit", np.inf, 1.0, "F"),
        "command_late": ("command_late.seconds", 0.0, 1.0, "s"),
        "clock_scale": ("clock_scale.factor", 1.0, 1.0, "-"),
    }
    found = table.get(name, table.get(effect_of(name)))
    plain = found is None or (name in ("position_gain", "integral") and not kp)
    if plain or found is None:
        return f"{effect_of(name)}.factor", 1.0, 1.0, "-"
    return *found[:3], at.unit(found[3])


def _largest(row: Row, equation: str, name: str, unit: str) -> Size:
    """Return the largest force, or error, of what acts for a while or along a stroke."""
    return largest(name, np.concatenate(row.courses(row.axis, equation)), row.numbers, row.errors, unit)


def regions(row: Row, at: Place) -> list[Region]:
    """Return where and when a cause acts, in the log's own time, with the share of the residual that lies there."""
    gap, law = ("encoders", "ql"), ("law", "e")
    equation, signal = {"play": gap, "encoder": gap, "law": law}.get(row.group, ("plant", "u"))
    left = at.reference.left(at.logs, at.axis, equation)
    total = max(sum(float(x @ x) for x in left), 1e-300)
    count = sum(len(x) for x in left)

    def region(kind: str, span: Ends, unit: str, rows: list[Mask], other: str | None = None) -> Region:
        power = sum(float(x[m] @ x[m]) for x, m in zip(left, rows, strict=True))
        share = sum(int(m.sum()) for m in rows) / count
        return Region(at.axis, signal, kind, span, unit, power / total, share, None, other)

    out = []
    for k, a, b in [*row.spans, *_begun(row, at)]:
        rows = [(s.t >= a) & (s.t <= b) & (n == k) for n, s in enumerate(at.logs)]
        start = float(at.logs[k].motion.t[0])
        out.append(region("time", (start + a, start + b), "s", rows))
    if row.place is not None:
        span = (row.place[0] - 2.0 * row.place[1], row.place[0] + 2.0 * row.place[1])
        out.append(region("position", span, at.unit("x"), _within(at, at.axis, "q", span)))
    if row.name == "limit":
        spans = [(at.logs[k], a, b) for k, a, b in row.spans]
        told = (s.axes[at.axis]["v"][(s.t >= a) & (s.t <= b)] for s, a, b in spans)
        v = np.concatenate([np.zeros(1), *told])
        span = (float(v.min()), float(v.max()))
        out.append(region("velocity", span, at.unit("x/s"), _within(at, at.axis, "v", span)))
    if row.name == "cross_friction":
        q = np.concatenate([s.axes[row.what]["q"] for s in at.logs])
        span = (float(q.min()), float(q.max()))
        out.append(region("other_axis", span, at.unit("x"), _within(at, row.what, "q", span), row.what))
    return out


def when(row: Row, at: Place) -> dict[str, Any]:
    """Return when a cause acts, in the log's own time [s]; nothing of what comes at instants: see :func:`regions`."""
    if row.spans:
        return {}
    if row.name == "friction_at_start":
        return {"kind": "after", "event": "start", "time_constant": row.since[0]}
    begun = [float(at.logs[k].motion.t[0] + a) for k, a, _ in _begun(row, at)]
    kind = "growing" if row.name in GROWS else "since" if begun else "always"
    return {"kind": kind, "from": begun[0]} if begun else {"kind": kind}


def _begun(row: Row, at: Place) -> list[tuple[int, float, float]]:
    """Return stretch, begin and end of what begins within a run or grows through it."""
    if row.name in GROWS:
        return [(k, 0.0, float(s.t[-1])) for k, s in enumerate(at.logs)]
    since = () if row.name in ("friction_at_start", "limit") else row.since
    return [(k, t, float(at.logs[k].t[-1])) for k, t in enumerate(since)]


def _within(at: Place, axis: str, channel: str, span: Ends) -> list[Mask]:
    return [(s.axes[axis][channel] >= span[0]) & (s.axes[axis][channel] <= span[1]) for s in at.logs]
