"""Evidence rows: for every cause that may have acted what speaks for it, in the same numbers for all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.days.evidence import cells
from pinotwin.diagnosis.days.forms import possible
from pinotwin.diagnosis.days.healthy import Shapes
from pinotwin.diagnosis.days.mechanisms import POSSIBLE, READ, Acts, group_of
from pinotwin.diagnosis.days.places import Sought
from pinotwin.diagnosis.days.row import Question, Row
from pinotwin.diagnosis.days.score import Scored, opened, score
from pinotwin.diagnosis.days.stretch import combined
from pinotwin.diagnosis.days.tried import Tried, less
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.signals import rms

NONE: Ints = np.zeros(0, dtype=np.intp)


class Asked:
    """The evidence of a question beside the causes that were found so far; no ``search``: without what is sought."""

    def __init__(self, q: Question, found: Sequence[Row] = (), *, search: bool = True) -> None:
        self.q, self.r, self.found = q, q.reference, tuple(f.refitted for f in found)
        shapes = _shapes(q, self.found)
        self.tried = tried = Tried(q, found, shapes, search=search)
        self.cells = {
            k: cells(self.r, q.logs, q.left, k, self.tried.columns[k], found=shapes) for k in self.r.axes
        }
        # what cannot be told in a validation log is left there
        left = [less(x, [f.unseen or {} for f in found], found, k) for k, x in enumerate(q.valid_left)]
        self.valid = {k: cells(self.r, q.valid, left, k, x, found=shapes) for k, x in tried.unseen.items()}
        self.keys = [(k, e) for k in self.r.axes for e in self.cells[k]]
        self.base = {key: score([(self.cells[key[0]][key[1]], NONE)], 0) for key in self.keys}
        rest, known = {key: x.left[0] for key, x in self.base.items()}, self._touched("", ())
        if known:
            rest |= zip(known, self._alone(known, sum(x.count for x in self.found)).left, strict=True)
        self.open = {key: opened(self.cells[key[0]][key[1]], x) for key, x in rest.items()}

    def rows(self, *, every: bool = False) -> list[Row]:
        """Return the rows of all causes, best first; of descriptions and other axes the best of each axis, or all."""
        acts, wide = {k: self.tried.columns[k][0] for k in self.r.axes}, self.tried.wide
        own = [(x, k) for k, each in acts.items() for x in each if x not in wide]
        out = [self._row(cause, name, [name]) for cause, name in own if not cause.startswith("found:")]
        out += [self._row(x, axis, [k for k in acts if x in acts[k]]) for x, axis in wide.items()]
        found = [x for x in out if x is not None]
        return found if every else _best(found)

    def _row(self, cause: str, axis: str, axes: Sequence[str]) -> Row | None:
        """Return the row of a cause; None of one that no machine can have, or that is not worth a word."""
        short, _, what = cause.partition(":")
        group, old = group_of(short), sum(x.count for x in self.found)
        keys = self._touched(cause, axes)
        p = max((len(self.cells[a][e].columns(cause, 0)) for a, e in keys if a in axes), default=0)
        if not p:
            return None
        prior = np.ones(p) if short == "describe" else None
        use = [(self.cells[a][e], self._index(a, e, cause if a in axes else "", p)) for a, e in keys]
        with_it, alone = score(use, old + p, prior, form=prior is None), self._alone(keys, old)
        searched = group in ("time", "place")
        told = [(x.full, x.left_full) if searched else (x.held, x.left) for x in (alone, with_it)]
        (off, before), (on, after) = told
        gains = [a - b for a, b in zip(on, off, strict=True)]
        theta, error = with_it.theta[old:], with_it.error[old:]
        worth = self._worth(cause, axes, theta, searched=searched)
        at = self.tried.sought.get((axis, short), Sought())
        fits = at.form is None or possible(self.r, at, theta, error)
        small = abs(theta[-1]) < SETTINGS.told.get(group, 0.0)
        small |= worth < least_share(group, min(self.q.worth, SETTINGS.share))  # larger: see judge
        if small or not fits or not _can_be(short, theta, error):
            return None
        by = {"day": with_it.cost - alone.cost}
        for (_, e), g in zip(keys, gains, strict=True):
            by[e] = by.get(e, 0.0) + float(g.sum())
        numbers = 0 if searched else 1 if short == "describe" else p
        price = at.price + SETTINGS.number * (numbers + (what == READ))
        price += np.log(max(len(self.r.axes) - 1, 1)) if short == "cross_friction" else 0.0
        every = np.concatenate(gains)
        return Row(
            name=short,
            axis=axis,
            group=group,
            axes=axes,
            score=float(sum(by.values()) - price),
            by=by,
            price=float(price),
            count=p,
            theta=float(theta[-1]),
            error=float(error[-1]),
            z=float(np.linalg.norm(np.clip(theta / np.maximum(error, 1e-300), -1e9, 1e9))),
            worth=worth,
            logs=self._by_log(keys, gains, with_it.costs - alone.costs),
            positive=positive(every),
            spread=spread(every),
            closed=self._closed(keys, before, after),
            valid=self._validated(cause, axes, theta),
            what=what,
            form=at.form,
            scale=at.scale,
            place=at.place,
            spans=at.spans,
            since=at.since,
            acts={a: [acts[cause] for acts in self.tried.columns[a]] for a in axes},
            unseen=self._unseen(cause, axes),
            numbers=theta,
            errors=error,
            beside=np.array([with_it.theta[:old], with_it.error[:old]]),
        )

    def _by_log(self, keys: Sequence[tuple[str, str]], gains: Sequence[Floats], costs: Floats) -> list[float]:
        """Return the gain of every log [nats], the cost of its healthy day with it."""
        logs = [self.cells[a][e].log for a, e in keys]
        each = [np.asarray(np.bincount(k, g), dtype=float) for k, g in zip(logs, gains, strict=True)]
        return [float(x) for x in _sum([np.zeros(len(self.q.logs)), costs, *each])]

    def error(self, cause: str, axis: str) -> tuple[float, float] | None:
        """Return the standard error of a cause's number beside a healthy day, and from where it is worth a word.

        Both in its unit; None where it does not act, or is not told from a change as large as the effort.
        """
        axes = self.r.axes if cause in self.tried.wide else (axis,)
        keys = [(a, e) for a in axes for e in self.cells[a] if cause in self.cells[a][e].at]
        use = [(self.cells[a][e], self.cells[a][e].at[cause]) for a, e in keys]
        if not use or len(use[0][1]) != 1:
            return None
        one = self._worth(cause, [a for a, _ in keys], np.ones(1), searched=False)
        told = max(SETTINGS.told.get(group_of(cause), 0.0), self.q.worth / max(one, 1e-300))
        error = float(score(use, 1).error[0])
        return (error, told) if one > 0.0 and error * one < 1.0 else None  # 0 of a part that the twin has not

    def _touched(self, cause: str, axes: Sequence[str]) -> list[tuple[str, str]]:
        """Return the equations that a cause, or what was found, acts on."""
        found = [f"found:{n}" for n in range(len(self.found))]
        return [
            (a, e)
            for a, e in self.keys
            if (a in axes and cause in self.cells[a][e].at) or any(f in self.cells[a][e].at for f in found)
        ]

    def _unseen(self, cause: str, axes: Sequence[str]) -> dict[str, list[Acts]] | None:
        """Return the columns of a cause in the validation logs; None where they hang on the logs in question."""
        told = [self.tried.unseen.get(a, []) for a in axes]
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
        left, left_full = [x.left[0] for x in each], [x.left_full[0] for x in each]
        costs = _sum([x.costs for x in each])
        return Scored(held, full, left, left_full, np.zeros(0), np.zeros((0, 0)), [], costs)

    def _worth(self, cause: str, axes: Sequence[str], theta: Floats, *, searched: bool) -> float:
        """Return the size of a cause in the effort, over the effort's own, where it is largest.

        What acts on the plant is as large as it is there, whatever follows it; 1 of what acts between encoders.
        """
        shares = list[float]()
        for a in axes:
            each = [acts[cause] for acts in self.tried.columns[a]]
            main = [next((x[e] for e in ("plant", "law") if e in x), None) for x in each]
            if parts := [combined(x, theta) for x in main if x is not None]:
                y, u = np.concatenate(parts), np.concatenate([s.axes[a]["u"] for s in self.q.logs])
                most = max(float(np.abs(y).max()), 1e-300)
                size = most * (1.0 if searched else rms(y / most))
                shares.append(size / max(float(np.std(u)), 1e-300))
        return max(shares, default=1.0)

    def _closed(
        self, keys: Sequence[tuple[str, str]], without: Sequence[Floats], with_it: Sequence[Floats]
    ) -> dict[str, float]:
        """Return equation -> share of what is open that goes, from squared residuals without a cause and with it."""
        out: dict[str, Floats] = {}
        for (axis, equation), before, after in zip(keys, without, with_it, strict=True):
            rest = float(before.sum() - self.cells[axis][equation].rows.sum())
            row = np.array([float(before.sum() - after.sum()), max(rest, 5.0)])
            out[equation] = out.get(equation, np.zeros(2)) + row
        return {e: float(a / b) for e, (a, b) in out.items()}

    def _validated(self, cause: str, axes: Sequence[str], theta: Floats) -> float | None:
        """Return what the numbers as they are gain on a log that they have not seen."""
        keys = [(a, e) for a in axes for e in self.cells[a] if cause in self.cells[a][e].at]
        if not self.valid or not all(e in self.valid[a] and cause in self.valid[a][e].at for a, e in keys):
            return None
        use = [self.valid[a][e] for a, e in keys]
        if any(len(c.at[cause]) != len(theta) for c in use):
            return None
        with_it = score([(c, c.at[cause]) for c in use], len(theta), fixed=theta)
        alone = score([(c, NONE) for c in use], 0)
        gain = sum(float(x.sum()) for x in with_it.full) - sum(float(x.sum()) for x in alone.full)
        return gain + with_it.cost - alone.cost


def _can_be(name: str, theta: Floats, error: Floats) -> bool:
    """Whether a machine can have a number after the change, within two standard errors."""
    low, high = POSSIBLE.get(name, (-np.inf, np.inf))
    if name == "effort_scale" and abs(1.0 + theta[-1]) < 2.0 * error[-1]:
        return False  # a factor that is not told from zero measures no effort
    return bool(len(theta) > 1 or low - 2.0 * error[-1] <= theta[-1] <= high)


def least_share(group: str, worth: float) -> float:
    """Return the least of an effort worth a word [1]: ``worth``, and more of what acts for a while."""
    return worth * (5.0 if group in ("time", "place") else 1.0)


def _shapes(q: Question, found: Sequence[Row]) -> Shapes:
    """Return how far the causes that were found may be off, by axis and equation: a tenth of their size.

    Of a body the gains of the controllers may follow all of it, for they are told what is carried.
    """
    out: dict[tuple[str, str], float] = {}
    for f in found:
        for axis, each in f.acts.items():
            for equation in each[0]:
                if equation == "plant":
                    y = np.concatenate(f.courses(axis, equation))
                    u = np.concatenate([s.axes[axis]["u"] for s in q.logs])
                    size = float(np.std(y) / max(float(np.std(u)), 1e-300))
                elif f.group != "body":
                    size = abs(f.theta)
                out[axis, equation] = 0.1 * min(size, 1.0)
                if f.group == "body":
                    out[axis, "law"] = min(size, 1.0)
    return out


def _sum(parts: Sequence[Floats]) -> Floats:
    """Return the sum of gains by log, each as long as the logs that it knows."""
    out = np.zeros(max(len(x) for x in parts))
    for x in parts:
        out[: len(x)] += x
    return out


def positive(gains: Floats) -> float:
    """Return the share of gains among all changes [1]."""
    return float(np.maximum(gains, 0.0).sum() / max(float(np.abs(gains).sum()), 1e-9))


def spread(gains: Floats) -> float:
    """Return how many cells carry a gain."""
    total = float(gains.sum())
    return total**2 / max(float((gains**2).sum()), 1e-9) if total > 0.0 else 0.0


def by_score(row: Row) -> float:
    """Return the key that puts the best row first; of two within a nat, with one column, the first that is listed."""
    return -round(row.score)


def _best(rows: Sequence[Row]) -> list[Row]:
    """Return rows by score, of descriptions three an axis and of other axes' places one."""
    most, seen, out = {"cross_friction": 1, "describe": 3}, dict[tuple[str, str], int](), []
    for row in sorted(rows, key=by_score):
        key = (row.name, row.axis)
        seen[key] = seen.get(key, 0) + 1
        if seen[key] <= most.get(row.name, len(rows)):
            out.append(row)
    return out
