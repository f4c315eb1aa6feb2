"""Evidence rows: for every cause that may have acted what speaks for it, in the same numbers for all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.days.evidence import Left, cells
from pinotwin.diagnosis.days.healthy import Shapes
from pinotwin.diagnosis.days.mechanisms import (
    GROUP,
    POSSIBLE,
    Acts,
    after_starts,
    bodies,
    descriptions,
    mechanisms,
    one_program,
    starts,
)
from pinotwin.diagnosis.days.places import Local, local
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.score import Cells, Scored, opened, score
from pinotwin.diagnosis.days.settings import SETTINGS
from pinotwin.diagnosis.days.stretch import Stretch

ALL = "*"
"""Axis of what acts on the whole machine."""


@dataclass(frozen=True, eq=False)
class Row:
    """What speaks for one cause.

    Attributes:
        name: of the cause. axis: where. group: of :data:`~pinotwin.diagnosis.days.mechanisms.GROUPS`.
        score: gain of the log density less the price [nats]. by: of every equation and of the healthy day.
        price: of numbers and search [nats]. count: numbers.
        theta: the last of them. error: its standard error. z: all of them over their errors.
        worth: size over the effort; 1 where it has none in the effort.
        logs: gain of every stretch [nats]. positive: gains over all changes of cells. spread: cells that carry it.
        closed: equation -> share of what is open.
        valid: gain on the validation log with the numbers as they are [nats]; None where there is none.
        what: other axis of a cross friction, or channel of a description.
        place, spans: of what acts at places or instants.
        acts: axis -> of every stretch equation -> columns. unseen: likewise of the validation log, None where they
            cannot be told there. numbers, errors: all of them, shape (count,) each.
    """

    name: str
    axis: str
    group: str
    score: float
    by: Mapping[str, float]
    price: float
    count: int
    theta: float
    error: float
    z: float
    worth: float
    logs: Sequence[float]
    positive: float
    spread: float
    closed: Mapping[str, float] = field(default_factory=dict)
    valid: float | None = None
    what: str = ""
    place: tuple[float, float] | None = None
    spans: Sequence[tuple[int, float, float]] = ()
    since: Sequence[float] = ()
    acts: Mapping[str, list[Acts]] = field(default_factory=dict, repr=False)
    unseen: Mapping[str, list[Acts]] | None = field(default=None, repr=False)
    numbers: Floats = field(default_factory=lambda: np.zeros(0), repr=False)
    errors: Floats = field(default_factory=lambda: np.zeros(0), repr=False)

    def plain(self) -> dict[str, Any]:
        """Return what `train` reads."""
        hidden = ("acts", "unseen", "numbers", "errors")
        return {k: v for k, v in vars(self).items() if k not in hidden}


@dataclass(frozen=True, eq=False)
class Question:
    """Logs in question, and what the equations leave of them; validation logs, likewise."""

    reference: Reference
    logs: Sequence[Stretch]
    left: Sequence[Left]
    valid: Sequence[Stretch] = ()
    valid_left: Sequence[Left] = ()

    @classmethod
    def of(cls, r: Reference, logs: Sequence[Stretch], valid: Sequence[Stretch] = ()) -> Question:
        """Return the question what has changed in some stretches."""
        return cls(r, logs, [r.residuals(s) for s in logs], valid, [r.residuals(s) for s in valid])

    def ends(self) -> dict[str, tuple[float, float]]:
        """Return axis -> ends of its travel in all logs [m or rad]."""
        every = [*self.reference.logs, *self.logs, *self.valid]
        return {
            k: (min(s.axes[k]["q"].min() for s in every), max(s.axes[k]["q"].max() for s in every))
            for k in self.reference.axes
        }


class Asked:
    """The evidence of a question beside the causes that were found so far."""

    def __init__(self, q: Question, found: Sequence[Row] = ()) -> None:
        self.q, self.r, self.found = q, q.reference, tuple(found)
        self.shapes = _shapes(q, self.found)
        self.known: dict[tuple[str, str], Local] = {}
        self.onsets: dict[str, list[float]] = {}
        self.prices: dict[tuple[str, str], float] = {}
        self.columns = self._all_columns()
        self.cells = {
            k: cells(self.r, q.logs, q.left, k, self.columns[k], found=self.shapes) for k in self.r.axes
        }
        self.valid_columns = self._valid_columns()
        self.valid = {
            k: cells(self.r, q.valid, q.valid_left, k, x)
            for k, x in self.valid_columns.items()
            if not self.found
        }
        self.keys = [(k, e) for k in self.r.axes for e in self.cells[k]]
        self.base = {key: score([(self.cells[key[0]][key[1]], _none())], 0) for key in self.keys}
        self.open = {key: opened(self.cells[key[0]][key[1]], x.held[0]) for key, x in self.base.items()}

    def rows(self, *, every: bool = False) -> list[Row]:
        """Return the rows of all causes, best first; of descriptions and other axes the best of each axis, or all."""
        out = []
        for name in self.r.axes:
            for cause in self.columns[name][0]:
                if cause != "payload" and not cause.startswith("found:"):
                    out.append(self._row(cause, name, [name]))
        if len(self.r.axes) > 1 and not any(f.name == "payload" for f in self.found):
            out.append(self._row("payload", ALL, list(self.r.axes)))
        found = [x for x in out if x is not None]
        return found if every else _best(found)

    def _all_columns(self) -> dict[str, list[dict[str, Acts]]]:
        q, r, out = self.q, self.r, {}
        left = [_less(s, x, self.found, k) for k, (s, x) in enumerate(zip(q.logs, q.left, strict=True))]
        ends, program = q.ends(), one_program(r, q.logs)
        body = [bodies(r, s) for s in q.logs]
        for name in r.axes:
            each = [
                mechanisms(r, s, name, x, float(k))
                for k, (s, x) in enumerate(zip(q.logs, q.left, strict=True))
            ]
            self._since(name, each, left)
            for k, s in enumerate(q.logs):
                each[k] |= {} if body[k] is None else {"payload": body[k][name]}
            for cause, x in local(r, q.logs, left, name, self.shapes).items():
                self.known[name, cause], self.prices[name, cause] = x, x.price
                for k, columns in enumerate(x.columns):
                    each[k][cause] = {"plant": columns}
            for k, s in enumerate(q.logs if not self.found else ()):
                told = descriptions(r, s, name, ends, (k, len(q.logs)), program=program)
                each[k] |= {f"describe:{w}": {"plant": x} for w, x in told.items()}
            for n, f in enumerate(self.found):
                for k, acts in enumerate(f.acts.get(name, ())):
                    each[k][f"found:{n}"] = acts
            out[name] = _shared(each)
        return out

    def _since(self, name: str, each: list[dict[str, Acts]], left: Sequence[Left]) -> None:
        """Add what begins at an instant of each log: friction, a zero, and the side of the play as a hidden state."""
        logs = self.q.logs
        for cause, part, equation in (
            ("friction_since", "coulomb", "plant"),
            ("zero_since", "zero", "plant"),
            ("encoder_step", "one", "encoders"),
        ):
            if (name, equation) not in left[0]:
                continue
            course = [
                s.axes[name]["dry"]
                if part == "coulomb"
                else s.axes[name]["one"]
                if part == "one"
                else e[part]["plant"]
                for s, e in zip(logs, each, strict=True)
                if part != "zero" or "zero" in e
            ]
            if len(course) < len(logs):
                continue
            begin = [
                _onset(s, x, y[name, equation], level=equation == "encoders")
                for s, x, y in zip(logs, course, left, strict=True)
            ]
            if max(begin) <= 1.0:
                continue
            self.onsets[f"{name}.{cause}"], self.prices[name, cause] = begin, 4.0 * len(logs)
            for s, e, x, t in zip(logs, each, course, begin, strict=True):
                e[cause] = {equation: x * (s.t > t) * (1e-4 if part == "one" else 1.0)}
        self._after_starts(name, each, left)
        if (name, "encoders") in left[0]:
            sides = [_sides(x[name, "encoders"]) for x in left]
            turns = [int(np.sum(x[1:] != x[:-1])) for x in sides]
            if min(turns) < 3:
                return  # a step, which a play is not: it comes back
            self.prices[name, "lost_motion_either_side"] = 3.0 * sum(turns)
            for s, e, x in zip(logs, each, sides, strict=True):
                e["lost_motion_either_side"] = {"encoders": -0.5e-4 * s.low(x)}

    def _after_starts(self, name: str, each: list[dict[str, Acts]], left: Sequence[Left]) -> None:
        """Add friction for a while after every start, as of a brake that releases late."""
        if not all(len(starts(s, name)) > 1 for s in self.q.logs):
            return
        size, best = self.r.widths[name]["effort"], (0.0, list[Floats]())
        for long in (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.6):
            x = [after_starts(s, name, long) * size for s in self.q.logs]
            num = sum(float(a @ y[name, "plant"]) for a, y in zip(x, left, strict=True))
            gain = num * abs(num) / max(sum(float(a @ a) for a in x), 1e-300)
            if gain > best[0]:
                best = (gain, x)
                self.onsets[f"{name}.friction_at_start"] = [long]
        self.prices[name, "friction_at_start"] = SETTINGS.place
        for e, x in zip(each, best[1], strict=False):
            e["friction_at_start"] = {"plant": x}

    def _valid_columns(self) -> dict[str, list[dict[str, Acts]]]:
        """Return the causes in the validation logs whose columns do not hang on the logs in question."""
        q, r = self.q, self.r
        if not q.valid:
            return {}
        out, ends = {}, q.ends()
        body = [bodies(r, s) for s in q.valid]
        for name in r.axes:
            each = []
            for k, (s, left) in enumerate(zip(q.valid, q.valid_left, strict=True)):
                acts = mechanisms(r, s, name, left, float(len(q.logs)))
                told = descriptions(r, s, name, ends, (0, len(q.logs)), program=False)
                acts |= {f"describe:{w}": {"plant": x} for w, x in told.items() if not w.endswith("time")}
                acts |= {} if body[k] is None else {"payload": body[k][name]}
                acts["friction_since"] = {"plant": s.axes[name]["dry"]}
                long = self.onsets.get(f"{name}.friction_at_start")
                if long is not None:
                    acts["friction_at_start"] = {
                        "plant": after_starts(s, name, long[0]) * r.widths[name]["effort"]
                    }
                tooth = self.known.get((name, "tooth"))
                if tooth is not None and tooth.place is not None:
                    x = np.exp(-(((s.axes[name]["q"] - tooth.place[0]) / tooth.place[1]) ** 2))
                    acts["tooth"] = {"plant": s.low(x) * r.widths[name]["effort"]}
                each.append(acts)
            out[name] = _shared(each)
        return out

    def _row(self, cause: str, axis: str, axes: Sequence[str]) -> Row | None:
        """Return the row of a cause; None of one that no machine can have, or that is not worth a word."""
        short, _, what = cause.partition(":")
        group, widths = GROUP[short], [x.count for x in self.found]
        keys = [
            (a, e)
            for a, e in self.keys
            if (a in axes and cause in self.cells[a][e].at)
            or any(f"found:{n}" in self.cells[a][e].at for n in range(len(self.found)))
        ]
        mine = [(a, e) for a, e in keys if a in axes and cause in self.cells[a][e].at]
        p = max((len(self.cells[a][e].at[cause]) for a, e in mine), default=0)
        if not p:
            return None
        before, described = sum(widths), short == "describe"
        prior = np.r_[np.full(before, 1e6), np.ones(p)] if described else None
        use = [(self.cells[a][e], self._index(a, e, cause if a in axes else "", p)) for a, e in keys]
        with_it = score(use, before + p, prior)
        alone = self._alone(keys, before)
        searched = group in ("time", "place")
        gains = [
            a - b
            for a, b in zip(
                with_it.full if searched else with_it.held,
                alone.full if searched else alone.held,
                strict=True,
            )
        ]
        theta, error = with_it.theta[before:], with_it.error[before:]
        low, high = POSSIBLE.get(short, (-np.inf, np.inf))
        if p == 1 and not low - 2.0 * error[-1] <= theta[-1] <= high:
            return None
        worth = self._worth(cause, axes, theta, searched=searched)
        if (short != "payload" and worth < (0.05 if searched else 0.01)) or small(group, theta[-1]):
            return None
        by = {"day": with_it.cost - alone.cost}
        for (_, e), g in zip(keys, gains, strict=True):
            by[e] = by.get(e, 0.0) + float(g.sum())
        price = self.prices.get((axis, short), 0.0) + (0.0 if searched else SETTINGS.number) * (
            1 if described else p
        )
        price += np.log(max(len(self.r.axes) - 1, 1)) if short == "cross_friction" else 0.0
        known = self.known.get((axis, short))
        every = np.concatenate(gains)
        return Row(
            name=short,
            axis=axis,
            group=group,
            score=float(sum(by.values()) - price),
            by=by,
            price=float(price),
            count=p,
            theta=float(theta[-1]),
            error=float(error[-1]),
            z=float(np.sqrt(np.sum((theta / np.maximum(error, 1e-300)) ** 2))),
            worth=worth,
            logs=_by_log([self.cells[a][e] for a, e in keys], gains, len(self.q.logs)),
            positive=float(np.maximum(every, 0.0).sum() / max(float(np.abs(every).sum()), 1e-9)),
            spread=_spread(every),
            closed=self._closed(keys, gains),
            valid=self._validated(cause, keys, theta),
            what=what,
            place=None if known is None else known.place,
            spans=() if known is None else known.spans,
            since=self.onsets.get(f"{axis}.{short}", ()),
            acts={a: [acts[cause] for acts in self.columns[a]] for a in axes},
            unseen=self._unseen(cause, axes),
            numbers=theta,
            errors=error,
        )

    def _unseen(self, cause: str, axes: Sequence[str]) -> dict[str, list[Acts]] | None:
        """Return the columns of a cause in the validation logs; None where they hang on the logs in question."""
        told = [self.valid_columns.get(a, []) for a in axes]
        if not all(each and all(cause in x for x in each) for each in told):
            return None
        return {a: [x[cause] for x in each] for a, each in zip(axes, told, strict=True)}

    def _index(self, axis: str, equation: str, cause: str, count: int) -> Ints:
        c = self.cells[axis][equation]
        old = [c.columns(f"found:{n}", f.count) for n, f in enumerate(self.found)]
        return np.concatenate([*old, c.columns(cause, count)]).astype(np.intp)

    def _alone(self, keys: Sequence[tuple[str, str]], count: int) -> Scored:
        """Return the score of the same equations with what was found alone."""
        if count:
            return score([(self.cells[a][e], self._index(a, e, "", 0)) for a, e in keys], count)
        each = [self.base[key] for key in keys]
        held, full = [x.held[0] for x in each], [x.full[0] for x in each]
        return replace(each[0], held=held, full=full, cost=sum(x.cost for x in each))

    def _worth(self, cause: str, axes: Sequence[str], theta: Floats, *, searched: bool) -> float:
        """Return the size of a cause in the effort, over the effort's own; 1 of what acts between encoders."""
        parts = [
            np.asarray(x).reshape(len(x), -1) @ theta
            for a in axes
            for acts in self.columns[a]
            for e, x in acts[cause].items()
            if e != "encoders"
        ]
        if not parts:
            return 1.0
        axis = axes[-1] if len(axes) > 1 else axes[0]
        size = float(np.std(np.concatenate([s.axes[axis]["u"] for s in self.q.logs])))
        y = np.concatenate(parts)
        return float(np.abs(y).max() if searched else np.sqrt(np.mean(y**2))) / max(size, 1e-300)

    def _closed(self, keys: Sequence[tuple[str, str]], gains: Sequence[Floats]) -> dict[str, float]:
        """Return equation -> share of what is open that goes."""
        out: dict[str, Floats] = {}
        nu = SETTINGS.freedom
        for key, g in zip(keys, gains, strict=True):
            c, held = self.cells[key[0]][key[1]], self.base[key].held[0]
            before, after = (
                float(np.sum(nu * np.expm1(-2.0 * (x - c.constant) / (nu + c.rows))))
                for x in (held, held + g)
            )
            row = np.array([before - after, max(before - float(c.rows.sum()), 5.0)])
            out[key[1]] = out.get(key[1], np.zeros(2)) + row
        return {e: float(a / b) for e, (a, b) in out.items()}

    def _validated(self, cause: str, keys: Sequence[tuple[str, str]], theta: Floats) -> float | None:
        """Return what the numbers as they are gain on a log that they have not seen."""
        if not self.valid or not all(e in self.valid[a] and cause in self.valid[a][e].at for a, e in keys):
            return None
        use = [self.valid[a][e] for a, e in keys]
        if any(len(c.at[cause]) != len(theta) for c in use):
            return None
        with_it = score([(c, c.at[cause]) for c in use], len(theta), fixed=theta)
        alone = score([(c, _none()) for c in use], 0)
        gain = sum(float(x.sum()) for x in with_it.full) - sum(float(x.sum()) for x in alone.full)
        return gain + with_it.cost - alone.cost


def small(group: str, theta: float) -> bool:
    """Whether a number is smaller than is worth a word: 1 % of a gain, 2 µm between encoders."""
    return abs(theta) < {"law": 0.01, "play": 0.02, "encoder": 0.02}.get(group, 0.0)


def _none() -> Ints:
    return np.zeros(0, dtype=np.intp)


def _shared(each: Sequence[dict[str, Acts]]) -> list[dict[str, Acts]]:
    """Return causes that all stretches have."""
    names = [n for n in each[0] if all(n in x for x in each)]
    return [{n: x[n] for n in names} for x in each]


def _less(s: Stretch, left: Left, found: Sequence[Row], k: int) -> Left:
    """Return what is left of a stretch without the causes that were found."""
    out = dict(left)
    for f in found:
        for axis, each in f.acts.items():
            for equation, x in each[k].items():
                if (axis, equation) in out:
                    out[axis, equation] = (
                        out[axis, equation] - np.asarray(x).reshape(len(s.t), -1) @ f.numbers
                    )
    return out


def _shapes(q: Question, found: Sequence[Row]) -> Shapes:
    """Return how large the causes are that were found, by axis and equation."""
    out: dict[tuple[str, str], float] = {}
    for f in found:
        for axis, each in f.acts.items():
            for equation in each[0]:
                size = abs(f.theta)
                if equation == "plant":
                    y = np.concatenate(
                        [
                            np.asarray(x[equation]).reshape(len(s.t), -1) @ f.numbers
                            for s, x in zip(q.logs, each, strict=True)
                        ]
                    )
                    u = np.concatenate([s.axes[axis]["u"] for s in q.logs])
                    size = float(np.std(y) / max(float(np.std(u)), 1e-300))
                out[axis, equation] = min(size, 1.0)
    return out


def _onset(s: Stretch, course: Floats, left: Floats, *, level: bool) -> float:
    """Return the instant [s] from which a course explains most of what is left; ``level``: beside a constant."""
    both, own, one = (np.cumsum(x[::-1])[::-1] for x in (left * course, course * course, course))
    if level:
        both, own = both - left.mean() * one, own - one**2 / len(left)
    gain = both**2 / np.maximum(own, 1e-6 * float(course @ course))
    return float(s.t[int(np.argmax(gain[: int(0.95 * len(gain))]))])


def _sides(r: Floats) -> Floats:
    """Return -1 or 1 for every row: the side on which a gap with two levels lies, with hysteresis."""
    low, high = np.quantile(r, 0.1), np.quantile(r, 0.9)
    middle, half = 0.5 * (high + low), 0.25 * (high - low)
    raw = np.where(r > middle + half, -1.0, np.where(r < middle - half, 1.0, 0.0))
    seen = np.maximum.accumulate(np.where(raw != 0.0, np.arange(len(r)), 0))
    return np.where(raw[seen] == 0.0, 1.0, raw[seen])


def _by_log(each: Sequence[Cells], gains: Sequence[Floats], count: int) -> list[float]:
    out = np.zeros(count)
    for c, g in zip(each, gains, strict=True):
        np.add.at(out, c.log, g)
    return [float(x) for x in out]


def _spread(gains: Floats) -> float:
    """Return how many cells carry a gain."""
    total = float(gains.sum())
    return total**2 / max(float((gains**2).sum()), 1e-9) if total > 0.0 else 0.0


def _best(rows: Sequence[Row]) -> list[Row]:
    """Return rows by score, of descriptions three an axis and of other axes' places one."""
    most, seen, out = {"cross_friction": 1, "describe": 3}, dict[tuple[str, str], int](), []
    for row in sorted(rows, key=lambda x: -x.score):
        key = (row.name, row.axis)
        seen[key] = seen.get(key, 0) + 1
        if seen[key] <= most.get(row.name, len(rows)):
            out.append(row)
    return out
