"""All causes of a question as columns, in the logs in question and in those of validation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.courses import Course, courses, since
from pinotwin.diagnosis.days.evidence import Left
from pinotwin.diagnosis.days.forms import forms
from pinotwin.diagnosis.days.healthy import Shapes
from pinotwin.diagnosis.days.law import Law
from pinotwin.diagnosis.days.mechanisms import (
    GROWS,
    READ,
    TOLD,
    Acts,
    after_starts,
    bodies,
    descriptions,
    group_of,
    mechanisms,
    motors,
    one_program,
    zeros,
)
from pinotwin.diagnosis.days.places import Local, local, whitened
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.row import ALL, Question, Row
from pinotwin.diagnosis.days.stretch import Stretch, combined
from pinotwin.diagnosis.days.stroke import encoder_errors

Columns = list[dict[str, Acts]]
"""Of every stretch, cause -> equation -> columns."""
MISREAD = ("friction", "onset", "offset", "time", "form")
"""Groups of causes that a reading of the effort may show and the machine not have."""


class Tried:
    """What is tried beside the causes that were found so far.

    Attributes:
        columns, unseen: axis -> columns in the logs in question and in those of validation.
        local: axis, cause -> what acts at places or instants. courses: axis, cause -> what has a course.
        wide: cause -> its axis, of those that act on several.
    """

    def __init__(self, q: Question, found: Sequence[Row], shapes: Shapes, *, search: bool = True) -> None:
        self.q, self.r, self.found, self.shapes, self.search = q, q.reference, tuple(found), shapes, search
        self.local: dict[tuple[str, str], Local] = {}
        self.courses: dict[tuple[str, str], Course] = {}
        self.wide: dict[str, str] = {}
        self.columns = self._asked()
        self.unseen = self._validation() if q.valid else {}

    def price(self, axis: str, cause: str) -> float:
        """Return what the search for a cause costs [nats]."""
        found = self.local.get((axis, cause)) or self.courses.get((axis, cause))
        return 0.0 if found is None else found.price

    def _asked(self) -> dict[str, Columns]:
        q, r, out = self.q, self.r, {}
        left = [less(x, [f.acts for f in self.found], self.found, k) for k, x in enumerate(q.left)]
        ends, program = q.ends(), one_program(r, q.logs)
        wide = self._wide(left)
        for name in r.axes:
            pairs = enumerate(zip(q.logs, q.left, strict=True))
            each = [mechanisms(r, s, name, x, float(k)) for k, (s, x) in pairs]
            for cause, acts in wide.items():
                _put(each, cause, [{"plant": x[name]} for x in acts])
            if self.search:
                self._search(left, name, each)
            if (name, "law") in q.left[0]:
                each = [x | _misread(x, r.laws[name], s.step) for x, s in zip(each, q.logs, strict=True)]
            each = [x | _told(x, name, r.laws) for x in each]
            for k, s in enumerate(q.logs if not self.found else ()):
                told = descriptions(r, s, name, ends, (k, len(q.logs)), program=program)
                each[k] |= {f"describe:{w}": {"plant": x} for w, x in told.items()}
            for n, f in enumerate(self.found):
                _put(each, f"found:{n}", f.refitted.acts.get(name, ()))
            out[name] = _shared(each)
        return out

    def _search(self, left: Sequence[Left], name: str, each: Columns) -> None:
        """Add what has a course, a place or a shape to the causes of an axis, at its best."""
        r, logs = self.r, self.q.logs
        for cause, found in courses(r, logs, left, name, self.found).items():
            self.courses[name, cause] = found
            _put(each, cause, found.acts)
        w = whitened(r, logs, left, name, self.shapes)
        places = {**local(r, w), **forms(r, w, name)}
        if (name, "encoders") in left[0]:
            places |= encoder_errors(r, logs, left, name)
        for cause, place in places.items():
            self.local[name, cause] = place
            _put(each, cause, [{place.equation: x} for x in place.columns])

    def _wide(self, left: Sequence[Left]) -> dict[str, list[dict[str, Floats]]]:
        """Return what acts on several axes, in every stretch, and zeros that moved within a log."""
        logs, out = self.q.logs, _several(self.r, list(zip(self.q.logs, left, strict=True)))
        for name in [k.partition(":")[2] for k in out if k.startswith("zero:") and self.search]:
            turns = out[f"zero:{name}"]
            found = since(logs, [x[name] for x in turns], left, (name, "plant"), self.found)
            if found is not None:
                self.courses[name, "zero_since"] = found
                each = zip(logs, turns, found.since, strict=True)
                out[f"zero_since:{name}"] = [{k: y * (s.t > t) for k, y in x.items()} for s, x, t in each]
        self.wide |= {k: k.partition(":")[2] or ALL for k in out}
        self.wide |= {f"payload:{TOLD}": ALL} if "payload" in out and self.r.laws else {}
        return out

    def _validation(self) -> dict[str, Columns]:
        """Return the causes in the validation logs whose columns do not hang on the logs in question."""
        q, r, out, ends = self.q, self.r, {}, self.q.ends()
        wide = _several(r, list(zip(q.valid, q.valid_left, strict=True)))
        for name in r.axes:
            each = []
            for k, (s, left) in enumerate(zip(q.valid, q.valid_left, strict=True)):
                acts = mechanisms(r, s, name, left, float(len(q.logs)))
                told = {} if self.found else descriptions(r, s, name, ends, (0, len(q.logs)), program=False)
                acts |= {f"describe:{w}": {"plant": x} for w, x in told.items() if not w.endswith("time")}
                acts |= {cause: {"plant": x[k][name]} for cause, x in wide.items()}
                acts |= self._known(s, name)
                acts |= _misread(acts, r.laws[name], s.step) if (name, "law") in left else {}
                acts |= _told(acts, name, r.laws)
                each.append({k: x for k, x in acts.items() if k not in GROWS})
            out[name] = _shared(each)
        return out

    def _known(self, s: Stretch, name: str) -> dict[str, Acts]:
        """Return what has a course or a place that holds in a validation log, too."""
        size, out = self.r.widths[name]["effort"], {"friction_since": {"plant": s.axes[name]["dry"]}}
        after = self.courses.get((name, "friction_at_start"))
        if after is not None:
            out["friction_at_start"] = {"plant": after_starts(s, name, *after.since) * size}
        places = [(k, x) for (axis, k), x in self.local.items() if axis == name]
        return out | {k: {x.equation: x.again(s)} for k, x in places if x.again is not None}


def _several(r: Reference, logs: Sequence[tuple[Stretch, Left]]) -> dict[str, list[dict[str, Floats]]]:
    """Return what acts on several axes, in every stretch: a body on a link, a motor, the zero of a joint."""
    each = [bodies(r, s) | motors(r, s) | zeros(r, s, left) for s, left in logs]
    return {cause: [x[cause] for x in each] for cause in each[0] if all(cause in x for x in each)}


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


def _put(each: Columns, cause: str, acts: Sequence[Acts]) -> None:
    for x, a in zip(each, acts, strict=False):
        x[cause] = a


def _shared(each: Sequence[dict[str, Acts]]) -> list[dict[str, Acts]]:
    """Return causes that all stretches have."""
    names = [n for n in each[0] if all(n in x for x in each)]
    return [{n: x[n] for n in names} for x in each]


def less(left: Left, acts: Sequence[Mapping[str, Sequence[Acts]]], found: Sequence[Row], k: int) -> Left:
    """Return what is left of stretch ``k`` without the causes that were found, ``acts`` their columns in its logs."""
    out = dict(left)
    for f, axes in zip(found, acts, strict=True):
        for axis, each in axes.items():
            for equation, x in each[k].items():
                if (axis, equation) in out:
                    out[axis, equation] = out[axis, equation] - combined(x, f.numbers)
    return out
