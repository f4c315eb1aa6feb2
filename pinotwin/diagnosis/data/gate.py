"""What the logs can be asked: the findings of ``check`` decide which effects are tried and which questions put.

At 10 samples a second no vibration is looked for, on steps of 1 mm no presliding. An axis whose effort is none (a
magnitude, noise, of the wrong sign), or whose position is a sentinel for long, is not judged; where it leaps, no cause
is named: the effort asked for such a speed is a hundred times the real one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.effects import EFFECTS, known
from pinotwin.logs.prepared import Prepared
from pinotwin.logs.quality import Finding
from pinotwin.logs.settings import USUAL
from pinotwin.machine import Machine
from pinotwin.motion import Motion

Question = Literal["servo", "tracking"]

INSTANTS = ("presliding", "backlash", "drive_flexibility", "joint_flexibility", "delay", "inertial_coupling")
"""Effects that happen between two samples of a slow log."""
MICRONS = ("presliding", "backlash", "encoder_error", "hysteresis")  # Effects within few steps of an encoder
EVERY = tuple(EFFECTS)


@dataclass(frozen=True)
class Bar:
    """What a finding of ``check`` rules out."""

    effects: tuple[str, ...] = ()  # names that are not looked for
    questions: tuple[Question, ...] = ()  # that are not put
    axis: bool = False  # whether nothing at all is said of the axis
    channel: str = ""  # ending of the channel that the finding must be about; "" for any
    # whether it spoils the other axes too, whose inertia and gravity go with that position
    everywhere: bool = False


BARS: Mapping[str, Bar] = {
    "slow_rate": Bar(INSTANTS, ("servo", "tracking")),
    "coarse_position": Bar((*MICRONS, "drive_flexibility", "joint_flexibility"), channel="q"),
    "few_digits": Bar(MICRONS, channel="q"),
    "command_disagrees": Bar(questions=("servo", "tracking")),
    "loop_unstable": Bar(EVERY, ("servo", "tracking"), everywhere=True),
    "command_is_position": Bar(questions=("servo", "tracking")),
    "effort_unsigned": Bar(axis=True),
    "effort_noise": Bar(axis=True),
    "effort_stands": Bar(EVERY, ("tracking",)),
    "effort_sign": Bar(axis=True),
    "effort_exchanged": Bar(axis=True),
    "sentinel": Bar(axis=True, channel="q"),
    "leaps": Bar(EVERY, ("servo", "tracking"), channel="q"),
    "wraps": Bar(EVERY, ("servo", "tracking"), channel="q"),
    "position_unit": Bar(EVERY, ("servo", "tracking"), channel="q", everywhere=True),
    "motor_turns_several": Bar(EVERY, ("servo", "tracking"), channel="ql", everywhere=True),
}
"""Code of a finding -> what it rules out on its axis, or on all where it is about the whole log."""


@dataclass(frozen=True)
class Gate:
    """What logs can be asked."""

    doubts: tuple[str, ...] = ()  # what ``check`` says of them, one sentence each
    # axis -> effect that is not looked for -> why
    effects: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    # axis -> question that is not put -> why
    questions: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    silent: Mapping[str, str] = field(default_factory=dict)  # axis of which nothing is said -> why
    turned: frozenset[str] = frozenset()  # axes whose effort seems to have the other sign
    # axis whose position does not go with its command -> why
    strays: Mapping[str, str] = field(default_factory=dict)
    # axis that its twin cannot judge in these logs -> why, and what to do
    unknown: Mapping[str, str] = field(default_factory=dict)

    def admits(self, effect: str, axis: str | None) -> bool:
        """Whether an effect is looked for on an axis."""
        name = str(axis)
        return name not in self.silent and effect not in self.effects.get(name, {})

    def asks(self, question: Question, axis: str) -> bool:
        """Whether a question is put to an axis."""
        return axis not in self.silent and question not in self.questions.get(axis, {})

    @property
    def nameless(self) -> Mapping[str, str]:
        """Axis of which no cause is named at all -> why."""
        return {a: next(iter(row.values())) for a, row in self.effects.items() if set(row) >= set(EVERY)}

    @property
    def remains(self) -> Mapping[str, str]:
        """Axis of which no cause is named -> what its residual is, in words; of which nothing is said -> why."""
        return {a: f"cannot be traced to a cause: {x}" for a, x in self.nameless.items()} | dict(self.silent)

    @property
    def warnings(self) -> list[str]:
        """The doubts, what its twin cannot judge, and what is not looked for, once for the axes that share it."""
        out = [*self.doubts, *(f"{x}: not judged, {why}" for x, why in self.unknown.items())]
        same: dict[tuple[str, ...], list[str]] = {}
        for axis, row in self.effects.items():
            if axis in self.nameless:
                continue
            same.setdefault(tuple(sorted(row)), []).append(axis)
        out += [
            f"{', '.join(axes)}: not looked for, these logs cannot show it: {', '.join(what)}"
            for what, axes in same.items()
        ]
        servo = [axis for axis, row in self.questions.items() if "servo" in row]
        if servo:
            out.append(f"{', '.join(servo)}: controller and tracking error are not judged")
        limit = "looked for but a limit of its drive"
        out += [
            f"{axis}: no cause is {limit if self.asks('servo', axis) else 'named'}" for axis in self.nameless
        ]
        return [*out, *(f"{axis}: not judged" for axis in self.silent)]


def gate(machine: Machine, logs: Sequence[Prepared], sized: Collection[str] = ()) -> Gate:
    """Return what logs of a machine can be asked: what one of them cannot show, none is asked."""
    found = [(log, f) for log in logs for f in log.doubts]  # but for the unit of positions that are known
    found = [x for x in found if x[1].code != "position_unit" or {*_axes(machine, x[1], "q")} - {*sized}]
    effects: dict[str, dict[str, str]] = {}
    questions: dict[str, dict[str, str]] = {}
    silent: dict[str, str] = {}
    for _, finding in found:
        bar = BARS.get(finding.code)
        if bar is None:
            continue
        about = _axes(machine, finding, bar.channel)
        for axis in machine.axes if about and bar.everywhere else about:
            why = _about(finding)
            if bar.effects:
                names = known(machine.effects) if bar.effects is EVERY else bar.effects
                effects.setdefault(axis, {}).update(dict.fromkeys(names, why))
            if bar.questions:
                questions.setdefault(axis, {}).update(dict.fromkeys(bar.questions, why))
            if bar.axis:
                silent.setdefault(axis, why)
    turned = [a for _, f in found if f.code == "effort_sign" for a in _axes(machine, f, "")]
    strays = {a: _about(f) for _, f in found if f.code == "command_disagrees" for a in _axes(machine, f, "")}
    return Gate(_said(found, len(logs)), effects, questions, silent, frozenset(turned), strays)


def off_command(own: Motion, new: Motion) -> list[str]:
    """Return axes that kept to their command on the twin's own logs, and that no factor brings onto it now.

    The unit of such a position is not in doubt: in another one it would go with its command.
    """
    if own.qr is None or new.qr is None:
        return []
    out = []
    for name in (x for x in own.names if x in new.names and _keeps(own, x)):
        j = new.index(name)
        q, asked = (x[:, j] - np.mean(x[:, j]) for x in (new.q, new.qr))
        factor = float(asked @ q) / max(float(asked @ asked), 1e-300)
        if np.std(q - factor * asked) > USUAL.follows * np.std(q):
            out.append(name)
    return out


def _keeps(own: Motion, axis: str) -> bool:
    j = own.index(axis)
    return bool(np.std(own.error[:, j]) < USUAL.follows * np.std(own.q[:, j]))


def _about(finding: Finding) -> str:
    return f"{finding.channel} {finding.message}".strip()


def _axes(machine: Machine, finding: Finding, channel: str) -> list[str]:
    """Return the axes that a finding is about: all of them where it names none."""
    # Of rounded digits the channels stand at the head of the message.
    listed = finding.channel or (finding.message.partition(": ")[0] if finding.code == "few_digits" else "")
    named = [c.rpartition(".") for c in listed.split(", ")]
    owners = [owner or last for owner, _, last in named if not channel or last == channel]
    own = [a for a in dict.fromkeys(owners) if a in machine.axes]
    everywhere = not channel and not any(owner for owner, _, _ in named)
    return own or (list(machine.axes) if everywhere else [])


def _said(found: Sequence[tuple[Prepared, Finding]], count: int) -> tuple[str, ...]:
    """Return each doubt once, with the log's name where not all of several logs share it."""
    of: dict[str, list[str]] = {}
    for one, f in found:
        text = f"{f.channel}: {f.message}" if f.channel else f.message
        of.setdefault(text, []).append(one.log.source or "log")
    return tuple(t if len(who) == count else f"{', '.join(who)}: {t}" for t, who in of.items())


def run_away(gate: Gate, own: Motion) -> Gate:
    """Return the gate with the servo judged of axes that kept to their command on own logs: their columns are right."""
    if own.qr is None:
        return gate
    questions = {axis: dict(row) for axis, row in gate.questions.items()}
    for axis, why in gate.strays.items():
        if _keeps(own, axis):
            questions[axis] = {q: x for q, x in questions.get(axis, {}).items() if x != why}
    return replace(gate, questions=questions)


_KNOWN = 0.3  # Correlation of the measured effort with the twin's from which it is an effort of that axis


def confirmed(gate: Gate, machine: Machine, measured: Floats, said: Floats, rows: Mask) -> Gate:
    """Return the gate of a change, with axes judged whose effort (n, nv) the twin knows as it was ``measured``.

    A fault may turn what looks like friction round; an effort of another axis, or beside a position that is none, no
    longer goes with what the twin ``said`` on ``rows`` in motion; one that goes against it has the other sign.
    """
    silent = dict(gate.silent)
    for axis in gate.silent:
        j = machine.axes[axis].index
        use = rows[:, j] & np.isfinite(measured[:, j])
        x, y = measured[use, j], said[use, j]
        alive = use.sum() > 3 and np.ptp(x) > 0.0 and np.ptp(y) > 0.0
        along = float(np.corrcoef(x, y)[0, 1]) if alive else 0.0
        if along > _KNOWN or (along < -_KNOWN and axis in gate.turned):
            del silent[axis]
    return replace(gate, silent=silent)
