"""One cause after the other: the most probable is applied to the model before the next is sought."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.diagnosis.days.causes import effect_of
from pinotwin.diagnosis.days.decision import Case, Decision, known
from pinotwin.diagnosis.days.detectable import detectable
from pinotwin.diagnosis.days.limit import limit_rows
from pinotwin.diagnosis.days.mechanisms import READ, group_of
from pinotwin.diagnosis.days.recording import recording_rows
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.row import ALL, Question, Row
from pinotwin.diagnosis.days.rows import Asked, by_score, least_share
from pinotwin.diagnosis.days.stretch import Stretch
from pinotwin.diagnosis.settings import SETTINGS


@dataclass(frozen=True, eq=False)
class Named:
    """A cause that is named, the probability of its class, what else it may be, and what of that class is as likely."""

    row: Row
    probability: float
    rivals: Sequence[tuple[Row, float]]
    alike: Sequence[Row] = ()


@dataclass(frozen=True, eq=False)
class Judged:
    """What is said of a question.

    Attributes:
        named: causes, in the order in which they were found.
        unknown: whether something has changed that no cause explains, at last.
        described: the best description of what is left, then.
        rows: evidence of the first question, best first. open: axis, equation -> its misfit over a healthy one.
        detectable: the least changes that these logs would have shown.
        possible: the best cause that is not sure enough to be named, also where nothing need have changed.
        proofs: faults of the recording that `check` proves; nothing else is judged then.
    """

    named: Sequence[Named] = ()
    unknown: bool = False
    described: Row | None = None
    rows: Sequence[Row] = ()
    open: Mapping[tuple[str, str], float] = field(default_factory=dict)
    detectable: Sequence[Mapping[str, Any]] = ()
    possible: Sequence[Named] = ()
    proofs: Sequence[dict[str, Any]] = ()


def evidence(
    q: Question, found: Sequence[Row] = (), admits: Callable[[Row], bool] = bool
) -> tuple[Case, list[Row], Asked]:
    """Return the case, the rows that these logs can show, and the columns of a question beside what was found."""
    asked = Asked(q.without(found), [x for x in found if not x.rescales])
    rows = asked.rows()
    if not found:
        rows += [*recording_rows(asked), *limit_rows(asked)]
    search = bool(found) or any((r.axis, r.name) in asked.tried.sought for r in rows if r.score > 0.0)
    told, healthy = {(family(f.name), f.axis) for f in found}, usual(q.reference, search=search)
    # Each step between two encoders is one: it may come again, if nothing else was found.
    again = {f.axis for f in found if {x.name for x in found if x.axis == f.axis} == {"encoder_step"}}
    rows = [
        replace(
            r,
            score=_beyond(healthy.amplitudes.get(_kind(r), 0.0), r, q.logs),
            own=healthy.numbers.get((r.name, r.axis, r.what), 0.0),
        )
        for r in rows
        if ((r.name == "encoder_step" and r.axis in again) or (family(r.name), r.axis) not in told)
        and admits(r)
    ]
    rows.sort(key=by_score)
    opened = {f"{axis} {equation}": x for (axis, equation), x in asked.open.items()}
    touched = {f"{axis} {equation}" for f in found for axis, each in f.acts.items() for equation in each[0]}
    return case_of(q.reference, rows, opened, touched), rows, asked


@dataclass(frozen=True)
class Usual:
    """What causes are on the twin's own days, which nobody doubts, in so far as they speak for them.

    Attributes:
        amplitudes: kind of cause -> the largest amplitude of one [root of nats/s]; a kind is a group, whether it is in
            the reading alone, and the axis. It is no less than that of the average axis: few days show few of the ways
            in which a twin is off.
        numbers: name, axis, and what a row is of -> its number, mean of the days; 0 on one that does not speak for it.
    """

    amplitudes: Mapping[tuple[str, bool, str], float]
    numbers: Mapping[tuple[str, str, str], float]


@cache
def usual(r: Reference, *, search: bool) -> Usual:
    """Return what causes are on the twin's own days. No ``search``: of what needs none, which is faster."""
    seen, numbers = dict[tuple[str, bool, str], float](), dict[tuple[str, str, str], float]()
    days = sorted({s.log for s in r.logs})
    for day in days:
        logs = [s for s in r.logs if s.log == day]
        asked = Asked(Question.of(r, logs), search=search)
        for x in (*asked.rows(every=True), *recording_rows(asked)):
            if x.score > 0.0:
                seen[_kind(x)] = max(seen.get(_kind(x), 0.0), _amplitude(x, logs))
                one = (x.name, x.axis, x.what)
                numbers[one] = numbers.get(one, 0.0) + x.theta / len(days)
    groups = {kind[:2] for kind in seen}
    average = {g: float(np.mean([seen.get((*g, axis), 0.0) for axis in r.axes])) for g in groups}
    every = {(*g, k): max(seen.get((*g, k), 0.0), average[g]) for g in groups for k in (*r.axes, ALL)}
    return Usual(every, numbers)


def _kind(row: Row) -> tuple[str, bool, str]:
    return row.group, row.what == READ, row.axis


def _amplitude(row: Row, logs: Sequence[Stretch]) -> float:
    """Return the root of what a row gains a second [nats/s]: it goes with the size of the cause."""
    return float(np.sqrt((row.score + row.price) / sum(s.t[-1] for s in logs)))


def _beyond(own: float, row: Row, logs: Sequence[Stretch]) -> float:
    """Return the score of what is beyond the amplitude on own days [nats]: a score goes with its square."""
    return row.score * (1.0 if row.score <= 0.0 else max(1.0 - own / _amplitude(row, logs), 0.0) ** 2)


def case_of(
    r: Reference, rows: Sequence[Row], opened: Mapping[str, float], touched: Collection[str] = ()
) -> Case:
    """Return rows as the decision reads them; ``opened`` is axis and equation -> misfit over a healthy one [1]."""
    noise = {k: float(np.mean([s.axes[k]["raw"][0] for s in r.logs])) for k in r.axes}
    return Case.of(rows, opened, noise, touched)


def judge(
    q: Question, decision: Decision, false_alarm: float, admits: Callable[[Row], bool], most: int
) -> Judged:
    """Return what has changed: at most so many causes, named while P(nothing) is below that of false alarms [1]."""
    limit = decision.limit(false_alarm, q.reference.days)
    found: list[Named] = []
    first: tuple[list[Row], Asked] | None = None
    unknown, described, possible = False, None, list[Named]()
    while first is None or len(found) < most:
        case, rows, asked = evidence(q, [x.row for x in found], admits)
        P, one = decided(case, decision)
        first = first or (_with_chances(rows, case, P[2:]), asked)
        best = one or (None if found else _next_to_unknown(case, P))
        possible = [] if best is None else [replace(best, probability=best.probability * (1.0 - float(P[0])))]
        told = [one.row] if one else case.described[:1]
        if P[0] >= limit or any(r.worth < least_share(r.group, q.worth) for r in told):
            break
        if one is None or one.probability < SETTINGS.likely:
            unknown, described = True, next(iter(case.described), None)
            break
        found, possible = [*_renewed(found, one.row), one], []
        if one.row.group in ("recording", "limit"):
            break  # the recording is mended, or the limit lifted, before anything else is said
    rows, asked = first
    could = detectable(asked, decision.bars[known(q.reference.days)])
    return Judged(found, unknown, described, rows, asked.open, could, possible)


def _next_to_unknown(case: Case, P: Floats) -> Named | None:
    """Return the best cause if it is at least half as likely as something unknown."""
    near = [k for k, p in enumerate(P[2:]) if p >= SETTINGS.likely * P[1]]
    return named(case, P, max(near, key=lambda k: P[2 + k])) if near else None


def _renewed(found: Sequence[Named], one: Row) -> list[Named]:
    """Return what was found, its numbers as they are beside one more cause."""
    fitted = [x.row.refitted.count * (not x.row.rescales) for x in found]
    parts = np.split(one.beside, np.cumsum(fitted)[:-1], axis=1) if found else []
    return [replace(x, row=x.row.renewed(y)) for x, y in zip(found, parts, strict=True)]


def decided(case: Case, decision: Decision) -> tuple[Floats, Named | None]:
    """Return P of nothing, something unknown and every cause, (2 + causes,), and the best cause.

    None where it is rather something unknown. What other equations leave makes it no less probable.
    """
    P = decision.probabilities(case)
    best = int(np.argmax(np.log(P[1:] + 1e-300).round(2))) - 1  # of two alike the first that is listed
    if best < 0:
        return P, None
    return P, named(case, decision.probabilities(case, case.causes[best]), best)


def named(case: Case, P: Floats, best: int) -> Named:
    """Return a cause by its number, with the probability of its class.

    Rows of one effect are one name, those of one kind of change on its axis one class. So are numbers of the controller
    that are as probable but for the price of one number: not told apart. What acts elsewhere may be true as well.
    """
    one, p = case.causes[best], P[2:]
    same, kin, alike = _class(case, p, best)
    meets = kin | [r.meets(one) and not (r.by.keys() & one.by.keys()) <= {"day"} for r in case.causes]
    order = [int(k) for k in np.argsort(-p) if meets[k] and not same[k]]
    rivals = [(case.causes[k], float(p[k])) for k in order[:4]]
    return Named(one, float(p[kin].sum() / max(P[1] + p[meets].sum(), 1e-9)), rivals, alike)


def _with_chances(rows: Sequence[Row], case: Case, p: Floats) -> list[Row]:
    """Return rows with their probabilities in a case, and what of their class is as probable."""
    told = {id(r): (float(p[k]), [x.name for x in _class(case, p, k)[2]]) for k, r in enumerate(case.causes)}
    return [replace(r, p=told[id(r)][0], alike=told[id(r)][1]) if id(r) in told else r for r in rows]


def _class(case: Case, p: Floats, k: int) -> tuple[Mask, Mask, list[Row]]:
    """Return which causes have the name of one, which are of its class, and those that are as probable, best first."""
    one, near = case.causes[k], p > p[k] * np.exp(-SETTINGS.number)
    same = np.array([(effect_of(r.name), r.axis) == (effect_of(one.name), one.axis) for r in case.causes])
    kin = same | [(family(r.name), r.axis) == (family(one.name), one.axis) for r in case.causes]
    kin |= near & [(r.group, r.axis) == (one.group, one.axis) for r in case.causes]
    return same, kin, [case.causes[i] for i in np.argsort(-p) if (near & kin & ~same)[i]]


def family(name: str) -> str:
    """Return what one change of a machine goes by: a second name of it on the same axis would be the same change."""
    group = group_of(name)
    if group in ("law", "recording") or name.startswith("zero") or name == "effort_late":
        return name
    return {"onset": "friction", "cross": "friction", "time": "local", "place": "local"}.get(group, group)
