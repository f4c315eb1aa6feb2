"""The controller's law along the measured signals, as a least-squares fit to healthy logs, and its physical numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import lsq_linear

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.stretch import Columns
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.signals import rms

TERMS = ("e", "ie", "v", "a", "vr", "ar", "jr", "qr", "du", "lead")
UP, DOWN = (0.0, np.inf), (-np.inf, 0.0)
SIGNS = {"e": UP, "ie": UP, "v": DOWN, "a": (-1e-9, 1e-9), "du": DOWN}
"""Gains that a controller can have, any where none are listed; a copy of the plant has others."""


@dataclass(frozen=True, eq=False)
class Law:
    """``u = sum of gains times terms + a constant of every log``; the gain of ``du`` is minus the filters' lag [s].

    Attributes:
        gains: of :data:`TERMS`, shape (10,), SI. inertia: the unit of an acceleration feed-forward [kg or kg·m²].
    """

    gains: Floats = field(default_factory=lambda: np.zeros(len(TERMS)))
    inertia: float = 1.0

    @classmethod
    def fitted(cls, logs: Sequence[Columns], *, signed: bool = False) -> Law:
        """Return the law of some logs; ``signed``: with the signs of a controller, where the plant fits as well.

        A healthy load is hardly ahead of its motor and shows no gain of that: it is ki, by which the loop integrates.
        """
        rows = [np.column_stack([*(c[k] for k in TERMS), c["u"]]) for c in logs]
        Z = np.concatenate([x - x.mean(axis=0) for x in rows])
        X, y = Z[:, :-1], Z[:, -1]
        bounds = np.transpose([(SIGNS if signed else {}).get(k, (-np.inf, np.inf)) for k in TERMS])
        gains = solved(X, y, bounds)
        for _ in range(3 if X[:, -1].any() else 0):  # ki comes nearer by a hundred times in each
            ki = cls(gains).cascade[1]
            gains = np.append(solved(X[:, :-1], y - ki * X[:, -1], bounds[:, :-1]), ki)
        return cls(gains, rms(y) / max(rms(X[:, TERMS.index("ar")]), np.finfo(float).tiny))

    def __getitem__(self, term: str) -> float:
        """Return the gain of a term, SI."""
        return float(self.gains[TERMS.index(term)])

    @cached_property
    def cascade(self) -> tuple[float, float]:
        """Position gain [1/s] and integral gain [N/m or N·m/rad] of ``kp kv e + ki (e + kp int e) - kv v``, else 0.

        ``e`` has the gain kv kp + ki and its integral ki kp, for which there are two roots. The command's speed has
        kv f of a velocity feed-forward f; the command ki (f - 1), or -ki where f is not integrated. That tells which.
        """
        e, integral, kv, forward, weight = self["e"], self["ie"], -self["v"], self["vr"], self["qr"]
        inside = e**2 - 4.0 * kv * integral
        if inside < -0.3 * e**2 or kv <= 0.0:
            return 0.0, 0.0
        roots = [(e + x * np.sqrt(max(inside, 0.0))) / (2.0 * kv) for x in (1.0, -1.0)]
        ahead = forward / kv, 0.0
        off = {(x, e - kv * x): min(abs((e - kv * x) * (f - 1.0) - weight) for f in ahead) for x in roots}
        if weight < 0.0:  # -ki: noise of the others does not spoil it as it does a root that is nearly double
            off[-integral / weight, -weight] = abs(kv * integral / weight + weight + e)
        kp, ki = min(off, key=lambda pair: off[pair])
        # Where noise made the root a double one, the integral knows the position gain better.
        told = ki > SETTINGS.told["law"] * kv * kp
        return (float(integral / ki), float(ki)) if told else (e / kv, 0.0)

    @property
    def stable(self) -> bool:
        """Whether damping, stiffness and integral have the signs of a controller: a copy of the plant has not."""
        return self["v"] < 0.0 < self["e"] and self["ie"] > -0.1 * self["e"]

    @property
    def proportional(self) -> float:
        """Gain of the error without that of its integral [N/m or N·m/rad]: of a cascade kv kp."""
        return -self["v"] * self.cascade[0] if self.cascade[0] else self["e"]

    @property
    def ahead(self) -> tuple[float, float, float]:
        """The share of the command's speed that is fed forward [1], and what a whole share adds to the gains vr and qr.

        What the loop integrates tells the share, unless it integrates none of it. Of one that is off, nothing tells how
        much of its proportional part it has: all.
        """
        kv, ki, least = max(-self["v"], np.finfo(float).tiny), self.cascade[1], SETTINGS.share
        direct = self["vr"] / kv
        share = 1.0 + self["qr"] / ki if ki else direct
        if direct**2 > least and share < direct / 2.0:
            share, ki = direct, 0.0
        weight = direct / share if share**2 > least else 1.0
        return share, weight * kv, ki

    @property
    def follows(self) -> dict[str, float]:
        """What a controller that is told of a load changes with it: name of a number -> change for a gain of 1 [1]."""
        return {"loop_gain": 1.0, "acceleration_feedforward": self["ar"] / self.inertia}

    def effort(self, c: Columns) -> Floats:
        """Return the effort that the law asks for along the measured signals, without its constant, shape (n,)."""
        return np.asarray(np.column_stack([c[k] for k in TERMS]) @ self.gains)

    def unfiltered(self, x: Floats, step: float) -> Floats:
        """Return an effort, (n,) or (n, p), sampled every ``step`` [s], as it is before the controller's filters."""
        return np.asarray(x - self["du"] * np.gradient(x, step, axis=0))

    def numbers(self) -> dict[str, Floats]:
        """Return what a change of each number of the controller adds to the gains, shape (10,) each.

        Of what may have been off it is no relative one: a velocity feed-forward is a share, that of the acceleration a
        part of ``inertia``, and the integral gain of a cascade a part of the gain by which a speed follows an error.
        """
        (kp, ki), p, (share, at_once, later) = self.cascade, self.proportional, self.ahead
        more = self["qr"] / ki if ki else share - 1.0
        added: dict[str, dict[str, float]] = {
            "position_gain": {"e": p, "ie": self["ie"] if kp else 0.0},
            "proportional_gain": {"e": p, "vr": self["vr"], "v": self["v"]},
            "loop_gain": {k: self[k] for k in ("e", "ie", "vr", "v", "qr", "lead")},
            "integral": {"e": p, "ie": p * kp, "qr": p * more, "lead": p} if kp else {"ie": self["ie"]},
            "velocity_feedforward": {"vr": at_once, "qr": later},
            "acceleration_feedforward": {"ar": self.inertia},
        }
        return {name: np.array([x.get(k, 0.0) for k in TERMS]) for name, x in added.items()}

    def columns(self, c: Columns) -> dict[str, Floats]:
        """Return what these changes add to the effort, shape (n,) each, and what a load ahead of its motor does.

        A command counts from where it starts. A healthy lead is small: it does not tell well what a large one does.
        """
        X = np.column_stack([c[k] for k in TERMS])
        X[:, TERMS.index("qr")] -= c["qr"][0]
        changes = {name: X @ gains for name, gains in self.numbers().items()}
        return changes | {"lead": X[:, -1] * self["lead"]}


def solved(X: Floats, y: Floats, bounds: Floats) -> Floats:
    """Return the gains (p,) within bounds (2, p) that leave least of y (n,); none of what stands still is known."""
    scale = np.abs(X).max(axis=0)
    scale[scale < np.finfo(float).eps] = np.inf
    return np.asarray(lsq_linear(X / scale, y, bounds, method="bvls").x / scale)
