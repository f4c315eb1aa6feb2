"""How probable each cause is: one conditional logit over nothing, something unknown, and every cause (McFadden 1974).

    P(c) = exp(w x_c + b_group) / (exp(s_none) + exp(s_unknown) + sum exp(w x_c + b_group))

The weights are made by ``python -m benchmarks train`` on machines with known faults; nobody sets them.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.mechanisms import GROUPS, READ
from pinotwin.diagnosis.days.reference import SEVERAL
from pinotwin.diagnosis.days.row import ALL, Row

GROUP_NAMES = tuple(x for x in GROUPS if x != "describe")
FEATURES: Mapping[str, int] = {
    "score": 1,
    "behind the best": 1,
    "ahead of rivals": 1,
    "over descriptions": 1,
    "cells that gain": 1,
    "validation": 1,
    "over its error": 1,
    "size": 1,
    "healthy day": 0,
    "numbers": -1,
    "over healthy logs": 1,
    "stays open": -1,
}
"""What speaks for a cause, and the sign that its weight must have; 0 for either."""
Numbers = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Case:
    """The rows of one question: causes that are worth a word, and descriptions.

    Attributes:
        causes, described: rows. open: axis and equation -> misfit over a healthy one.
        noise: axis -> noise of its effort over the effort. touched: axis and equation on which what was found acts.
    """

    causes: Sequence[Row]
    described: Sequence[Row]
    open: Numbers
    noise: Numbers
    touched: Collection[str] = ()

    @classmethod
    def of(cls, rows: Sequence[Row], open_: Numbers, noise: Numbers, touched: Collection[str] = ()) -> Case:
        """Return the case of a question's rows.

        What gains nothing, or a validation log contradicts, is no cause. Neither is what acts at instants or places,
        is no larger than the noise of the effort [1], and is few pulses or is in the reading: at a constant speed the
        steps of an encoder, sampled, come and go slowly (aliasing).
        """
        best = {(r.name, r.axis): r for r in sorted(rows, key=lambda r: r.score)}

        def stands(r: Row) -> bool:
            speaks = r.score > 0.0 and not r.contradicted
            if not speaks or r.group not in ("time", "place"):
                return speaks
            read = best[r.name, r.axis].what == READ
            return r.worth >= 2.0 * noise.get(r.axis, 0.0) or not (read or r.spread < 8.0)

        causes = [r for r in rows if r.group != "describe" and stands(r)]
        return cls(causes, [r for r in rows if r.group == "describe"], open_, noise, touched)

    @property
    def apart(self) -> dict[str, float]:
        """Misfits [1] of what nothing acts on that was found: what is open there needs a cause of its own."""
        return {k: x for k, x in self.open.items() if k not in self.touched}

    def features(self, null: Numbers) -> Floats:
        """Return a row for nothing, one for something unknown, and one for every cause, shape (2 + causes, k)."""
        f, g = len(FEATURES), len(GROUP_NAMES)
        X = np.zeros((len(self.causes) + 2, f + g + 8))
        top = max([r.score for r in self.causes], default=0.0)
        over = max([r.score - null.get(channel(r), 10.0) for r in self.described], default=0.0)
        excess = max([r.score - null.get(r.group, 10.0) for r in self.causes], default=-20.0)
        wide = float(np.arcsinh(np.clip(max(self.apart.values(), default=0.0) - 1.5, 0.0, 50.0)))
        X[0, f + g : f + g + 2] = 1.0, wide
        X[1, f + g + 2 :] = (
            1.0,
            self._stays_open(),
            np.arcsinh(over / 5.0),
            np.arcsinh((over - max(excess, 0.0)) / 10.0),
            np.arcsinh(top / 5.0),
            np.arcsinh(excess / 5.0),
        )
        for i, r in enumerate(self.causes):
            X[i + 2, :f] = self._speaks(r, top, null)
            X[i + 2, f + GROUP_NAMES.index(r.group)] = 1.0
        return X

    def _stays_open(self) -> float:
        """Return what the best cause of an equation leaves of it, of the one that is least explained, 0 to 1."""
        each, left = [(r.score, self._left(r)) for r in self.causes], [0.0]
        for key, off in self.apart.items():
            _, stays = max([(score, x[key]) for score, x in each if key in x], default=(0.0, off))
            left.append(min(off - 2.0, 1.0) * (stays - 1.0) / (off - 1.0) if off > 2.0 else 0.0)
        return float(np.clip(max(left), 0.0, 1.0))

    def _left(self, r: Row) -> dict[str, float]:
        """Return axis and equation -> how far what a cause closes stays off beside it, over a healthy misfit."""
        out = {}
        for key, off in self.open.items():
            axis, _, equation = key.rpartition(" ")
            if equation in r.closed and r.acts_on([axis]):
                out[key] = max(off - r.closed[equation] * max(off - 1.0, 0.1), 1.0)
        return out

    def _others(self, r: Row) -> float:
        """Return what the best other names of the equations in which a cause acts gain together [nats]."""
        out = 0.0
        for e in r.by.keys() - {"day"}:
            best = dict[str, float]()
            for x in self.causes:
                if e in x.by and (x.axis, x.group) != (r.axis, r.group) and x.meets(r):
                    key = ALL if len(x.axes) > 1 else x.axis
                    best[key] = max(best.get(key, 0.0), min(x.by[e], x.score))
            out += max(best.pop(ALL, 0.0), sum(best.values()))
        return out

    def _speaks(self, r: Row, top: float, null: Numbers) -> list[float]:
        gain, day = max(sum(r.by.values()), 1e-9), r.by.get("day", 0.0)
        words = [x.score for x in self.described if x.axis == r.axis]
        size = {"law": min(r.worth, abs(r.theta)), "play": abs(r.theta)}.get(r.group, r.worth)
        main = max(r.closed, key=lambda e: r.by[e], default="")
        left = [x for k, x in self._left(r).items() if k.endswith(f" {main}")]
        foretold = 0.0 if r.valid is None else float(np.clip(r.valid / max(gain, 5.0), -1.0, 1.0))
        return [
            np.arcsinh(r.score / 5.0),
            -np.arcsinh((top - r.score) / 5.0),
            np.arcsinh((r.score - self._others(r)) / 10.0),
            float(np.clip(np.arcsinh((r.score - max([*words, 0.0])) / 10.0), -4.0, 4.0)),
            r.positive,
            0.5 if r.group in ("recording", "limit") else foretold,
            np.log10(max(r.z, 0.1)),
            float(np.clip(np.log10(max(size, 1e-3)), -2.0, 0.5)),
            np.arcsinh(day / 10.0) if day > 0.0 else 5.0 * max(day / max(gain, 5.0), -1.0),
            float(np.log(r.count)),
            np.arcsinh((r.score - null.get(r.group, 10.0)) / 5.0),
            float(np.log(min(max([1.0, *left]), 1e2))),
        ]


def channel(r: Row) -> str:
    """Return whose healthy scores a row is held against: its group, or the channel of a description."""
    word = r.what.removeprefix("dry ").split()[0] if r.what else ""
    return r.group if r.group != "describe" else {"program": "time", "acceleration": "speed"}.get(word, word)


@dataclass(frozen=True, eq=False)
class Decision:
    """The trained weights.

    Attributes:
        mean, scale: of the columns of causes. weights: of all columns.
        null: group or channel -> score that 95 % of healthy questions stay below [nats].
        limits: what is known of days -> false-alarm rate -> P(nothing) below which something is said.
        bars: the same -> group -> score at which that is reached at the least of these rates [nats].
    """

    mean: Floats
    scale: Floats
    weights: Floats
    null: Numbers
    limits: Mapping[str, Mapping[float, float]]
    bars: Mapping[str, Mapping[str, float]]

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> Decision:
        """Return the weights that ``train`` wrote."""
        mean, scale, weights = (np.array(data[k], dtype=float) for k in ("mean", "scale", "weights"))
        limits = {k: {float(a): float(x) for a, x in row.items()} for k, row in data["limits"].items()}
        return cls(mean, scale, weights, data["null"], limits, data["bars"])

    def probabilities(self, case: Case, one: Row | None = None) -> Floats:
        """Return P of nothing, of something unknown, and of every cause, shape (2 + causes,).

        ``one``: the unknown is only what may stand for this cause: what its own equations leave.
        """
        X = case.features(self.null)
        if one is not None:
            own = {key: off for key, off in case.open.items() if key.rpartition(" ")[2] in one.by}
            told = case.described if "plant" in one.by else []
            X[1] = replace(case, open=own, described=told).features(self.null)[1]
        cause = X[:, len(FEATURES) : len(FEATURES) + len(GROUP_NAMES)].sum(axis=1)
        value = ((X - self.mean * cause[:, None]) / self.scale) @ self.weights
        share = np.exp(value - value.max())
        return np.asarray(share / share.sum())

    def limit(self, false_alarm: float, days: int) -> float:
        """Return the P(nothing) [1] below which something is said at a false-alarm rate [1], between those measured."""
        at = self.limits[known(days)]
        return float(np.interp(false_alarm, sorted(at), [at[x] for x in sorted(at)]))


def known(days: int) -> str:
    """Return what a twin of so many logs knows of days: each can be held against the others, or none."""
    return "several" if days >= SEVERAL else "few"


@cache
def trained() -> Decision:
    """Return the decision that comes with the package."""
    text = files("pinotwin.diagnosis.days").joinpath("weights.json").read_text(encoding="utf-8")
    return Decision.read(json.loads(text))
