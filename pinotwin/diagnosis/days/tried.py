"""All causes of a question as columns, in the logs in question and in those of validation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pinotwin.diagnosis.candidates.catalogue import same_cause
from pinotwin.diagnosis.days.courses import courses, since
from pinotwin.diagnosis.days.evidence import Left
from pinotwin.diagnosis.days.forms import forms
from pinotwin.diagnosis.days.healthy import Shapes
from pinotwin.diagnosis.days.law import Law
from pinotwin.diagnosis.days.mechanisms import (
    GROWS,
    READ,
    TOLD,
    Acts,
    bodies,
    descriptions,
    group_of,
    mechanisms,
    motors,
    one_program,
    zeros,
)
from pinotwin.diagnosis.days.places import Felt, Sought, local, whitened
from pinotwin.diagnosis.days.row import ALL, Question, Row
from pinotwin.diagnosis.days.stretch import Stretch, combined
from pinotwin.diagnosis.days.stroke import encoder_errors
from pinotwin.effects import Effect

Columns = list[dict[str, Acts]]
"""Of every stretch, cause -> equation -> columns."""
Every = Mapping[tuple[str, str], Sequence[Felt]]  # axis, cause -> of every stretch
MISREAD = ("friction", "onset", "offset", "time", "form")
"""Groups of causes that a reading of the effort may show and the machine not have."""


class Tried:
    """What is tried beside the causes that were found so far.

    Attributes:
        columns, unseen: axis -> columns in the logs in question and in those of validation.
        sought: axis, cause -> what has a course, a place or a form. felt: those that other axes feel.
        wide: cause -> its axis, of those that act on several.
    """

    def __init__(self, q: Question, found: Sequence[Row], shapes: Shapes, *, search: bool = True) -> None:
        self.q, self.r, self.found = q, q.reference, tuple(found)
        left = [less(x, [f.acts for f in found], found, k) for k, x in enumerate(q.left)]
        self.sought = dict[tuple[str, str], Sought]()
        for name in self.r.axes if search else ():
            w = whitened(self.r, q.logs, left, name, shapes)
            every = {
                **courses(self.r, q.logs, left, name, found),
                **local(self.r, w),
                **forms(self.r, w, name),
            }
            if (name, "encoders") in left[0]:
                every |= encoder_errors(self.r, q.logs, left, name)
            self.sought |= {(name, cause): x for cause, x in every.items()}
        self.felt = self._felt()
        self.columns, self.wide = self._asked(left, search=search)
        self.unseen = self._validation() if q.valid else {}

    def _asked(self, left: Sequence[Left], *, search: bool) -> tuple[dict[str, Columns], dict[str, str]]:
        """Return the causes in the logs in question, and the axis of those that act on several."""
        q, r = self.q, self.r
        at = {key: x.columns for key, x in self.sought.items()}
        wide = self._several(q.logs, left, at)
        if search:
            wide |= self._turned(wide, left)
        out, ends, program = self._gathered(q.logs, q.left, at, wide), q.ends(), one_program(r, q.logs)
        for name, each in out.items():
            for k, s in enumerate(q.logs):
                if not self.found:
                    each[k] |= descriptions(r, s, name, ends, (k, len(q.logs)), program=program)
                acts = {f"found:{n}": f.refitted.acts for n, f in enumerate(self.found)}
                each[k] |= {cause: x[name][k] for cause, x in acts.items() if name in x}
        told = {f"payload:{TOLD}": ALL} if "payload" in wide and r.laws else {}
        return out, {k: k.partition(":")[2] or ALL for k in wide} | told

    def _validation(self) -> dict[str, Columns]:
        """Return the causes in the validation logs whose columns do not hang on the logs in question."""
        q, r, out, ends = self.q, self.r, dict[str, Columns](), self.q.ends()
        at = {key: [x.again(s) for s in q.valid] for key, x in self.sought.items() if x.again is not None}
        wide = self._several(q.valid, q.valid_left, at)
        for name, each in self._gathered(q.valid, q.valid_left, at, wide).items():
            out[name] = [{k: x for k, x in acts.items() if k.partition(":")[0] not in GROWS} for acts in each]
            for acts, s in zip(out[name], q.valid, strict=True):
                acts |= {} if self.found else descriptions(r, s, name, ends)
        return out

    def _gathered(
        self,
        logs: Sequence[Stretch],
        left: Sequence[Left],
        sought: Every,
        wide: Mapping[str, Sequence[Felt]],
    ) -> dict[str, Columns]:
        """Return axis -> columns of all causes: what was ``sought`` on it, and what acts on several axes."""
        r, out = self.r, dict[str, Columns]()
        for name in r.axes:
            own = {cause: x for (axis, cause), x in sought.items() if axis == name}
            each: Columns = []
            for k, (s, x) in enumerate(zip(logs, left, strict=True)):
                acts = mechanisms(r, s, name, x, float(k))
                acts |= {cause: {self.sought[name, cause].equation: y[k][name]} for cause, y in own.items()}
                acts |= {cause: {"plant": y[k][name]} for cause, y in wide.items() if name in y[k]}
                acts |= _misread(acts, r.laws[name], s.step) if (name, "law") in x else {}
                acts |= _told(acts, name, r.laws)
                each.append({c: y for c, y in acts.items() if (name, c) not in self.felt})
            out[name] = [{c: x[c] for c in x if all(c in y for y in each)} for x in each]
        return out

    def _several(self, logs: Sequence[Stretch], left: Sequence[Left], sought: Every) -> dict[str, list[Felt]]:
        """Return what acts on several axes, in every stretch: bodies, motors, zeros, and forms that others feel."""
        r, felt = self.r, {f"{cause}:{axis}": list(sought[axis, cause]) for axis, cause in self.felt}
        each = [bodies(r, s) | motors(r, s) | zeros(r, s, x) for s, x in zip(logs, left, strict=True)]
        return {cause: [x[cause] for x in each] for cause in each[0] if all(cause in x for x in each)} | felt

    def _felt(self) -> list[tuple[str, str]]:
        """Return axis and cause of the forms that other axes feel through their inertia; a coupling of two once."""
        out, shown = list[tuple[str, str]](), list[Effect]()
        for key, x in list(self.sought.items()):
            if x.form is None or all(len(y) == 1 for y in x.columns):
                continue
            if any(same_cause(x.form, other) for other in shown):
                del self.sought[key]
            else:
                out.append(key)
                shown.append(x.form)
        return out

    def _turned(self, wide: Mapping[str, Sequence[Felt]], left: Sequence[Left]) -> dict[str, list[Felt]]:
        """Return zeros that moved within a log, in every stretch."""
        logs, out = self.q.logs, dict[str, list[Felt]]()
        for name in (k for k in self.r.axes if f"zero:{k}" in wide):
            turns = wide[f"zero:{name}"]
            found = since(logs, [x[name] for x in turns], left, (name, "plant"), self.found)
            if found is not None:
                self.sought[name, "zero_since"] = found
                each = zip(logs, turns, found.since, strict=True)
                out[f"zero_since:{name}"] = [{k: y * (s.t > t) for k, y in x.items()} for s, x, t in each]
        return out


def _misread(acts: dict[str, Acts], law: Law, step: float) -> dict[str, Acts]:
    """Return causes whose effort is in the reading alone: the law of the controller, which did not ask, has it too."""
    plain = {k: x["plant"] for k, x in acts.items() if set(x) == {"plant"} and ":" not in k}
    read = {k: (x, law.unfiltered(x, step)) for k, x in plain.items() if group_of(k) in MISREAD}
    return {f"{k}:{READ}": {"plant": x, "law": y} for k, (x, y) in read.items()}


def _told(acts: dict[str, Acts], name: str, laws: Mapping[str, Law]) -> dict[str, Acts]:
    """Return a body whose controllers are told of it: the gains of each follow by a number of its own."""
    if "payload" not in acts or not laws:
        return {}
    body = acts["payload"]["plant"]
    out = {"plant": np.column_stack([body, np.zeros((len(body), len(laws)))])}
    if "loop_gain" in acts:
        out["law"] = np.zeros_like(out["plant"])
        follows = laws[name].follows.items()
        out["law"][:, body.shape[1] + list(laws).index(name)] = sum(x * acts[k]["law"] for k, x in follows)
    return {f"payload:{TOLD}": out}


def less(left: Left, acts: Sequence[Mapping[str, Sequence[Acts]]], found: Sequence[Row], k: int) -> Left:
    """Return what is left of stretch ``k`` without the causes that were found, ``acts`` their columns in its logs."""
    out = dict(left)
    for f, axes in zip(found, acts, strict=True):
        for axis, each in axes.items():
            for equation, x in each[k].items():
                if (axis, equation) in out:
                    out[axis, equation] = out[axis, equation] - combined(x, f.numbers)
    return out
