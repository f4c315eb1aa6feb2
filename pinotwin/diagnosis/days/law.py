"""The controller's law along the measured signals, as a least-squares fit to healthy logs, and its physical numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.stretch import Columns

TERMS = ("e", "ie", "v", "a", "vr", "ar", "jr", "qr", "lead")
FOLLOWS = ("loop_gain", "acceleration_feedforward")
"""Numbers of a controller that follow the load which it is told of."""
SIGNS = {"e": (0.0, np.inf), "ie": (0.0, np.inf), "v": (-np.inf, 0.0), "a": (-1e-9, 1e-9)}
"""Gains that a controller can have, any where none are listed; a copy of the plant has others."""


@dataclass(frozen=True, eq=False)
class Law:
    """``u = sum of gains times terms + a constant of every log``.

    Attributes:
        gains: of :data:`TERMS`, shape (9,), SI.
        cascade: whether the gains are those of a position loop around a velocity loop with an integral:
            ``kp kv e + ki (e + kp int e) - kv v``.
        kp: position gain of the cascade [1/s]. ki: its integral gain [N/m or N·m/rad]; both 0 of other laws.
    """

    gains: Floats
    cascade: bool
    kp: float
    ki: float

    @classmethod
    def fitted(cls, logs: Sequence[Columns], *, signed: bool = False) -> Law:
        """Return the law of some logs; ``signed``: with the signs of a controller, where the plant fits as well.

        A healthy load is hardly ahead of its motor and shows no gain of that: it is ki, by which the loop integrates.
        """
        rows = [np.column_stack([*(c[k] for k in TERMS), c["u"]]) for c in logs]
        Z = np.concatenate([x - x.mean(axis=0) for x in rows])
        X, y = Z[:, :-1], Z[:, -1]
        bounds = np.transpose([(SIGNS if signed else {}).get(k, (-np.inf, np.inf)) for k in TERMS])
        gains = _solved(X, y, bounds)
        for _ in range(3 if X[:, -1].any() else 0):  # ki comes nearer by a hundred times in each
            ki = _cascade(gains)[2]
            gains = np.append(_solved(X[:, :-1], y - ki * X[:, -1], bounds[:, :-1]), ki)
        return cls(gains, *_cascade(gains))

    @property
    def stable(self) -> bool:
        """Whether damping, stiffness and integral have the signs of a controller: a copy of the plant has not."""
        return bool(self.gains[2] < 0.0 < self.gains[0] and self.gains[1] > -0.1 * self.gains[0])

    def effort(self, c: Columns) -> Floats:
        """Return the effort that the law asks for along the measured signals, without its constant, shape (n,)."""
        return np.asarray(np.column_stack([c[k] for k in TERMS]) @ self.gains)

    def numbers(self) -> dict[str, Floats]:
        """Return what a relative change of each number of the controller adds to the gains, shape (9,) each."""
        e, integral, damping, _, forward, ahead, _, weight, lead = self.gains
        outer, inside = (-damping * self.kp, 1.0) if self.cascade else (e, 0.0)
        added: dict[str, dict[str, float]] = {
            "position_gain": {"e": outer, "ie": inside * integral},
            "proportional_gain": {"e": outer, "vr": forward, "v": damping},
            "loop_gain": {"e": e, "ie": integral, "vr": forward, "v": damping, "qr": weight, "lead": lead},
            "integral": {"e": self.ki, "ie": integral, "qr": inside * weight, "lead": lead},
            "velocity_feedforward": {"vr": forward, "qr": inside * weight + self.ki},
            "acceleration_feedforward": {"ar": ahead},
        }
        return {name: np.array([x.get(k, 0.0) for k in TERMS]) for name, x in added.items()}

    def columns(self, c: Columns) -> dict[str, Floats]:
        """Return what these changes add to the effort, shape (n,) each, and what a load ahead of its motor does.

        A command counts from where it starts. A healthy lead is small: it does not tell well what a large one does.
        """
        X = np.column_stack([c[k] for k in TERMS])
        X[:, TERMS.index("qr")] -= c["qr"][0]
        return {
            **{name: X @ gains for name, gains in self.numbers().items()},
            "lead": X[:, -1] * self.gains[-1],
        }


def _solved(X: Floats, y: Floats, bounds: Floats) -> Floats:
    """Return the gains (p,) within bounds (2, p) that leave least of an effort; none of what stands still is known."""
    scale = np.abs(X).max(axis=0)
    scale[scale < np.finfo(float).eps] = np.inf
    return np.asarray(lsq_linear(X / scale, y, bounds, method="bvls").x / scale)


def _cascade(gains: Floats) -> tuple[bool, float, float]:
    """Return whether a law is a cascade, its position gain and integral gain.

    ``e`` has the gain kv kp + ki and its integral ki kp, for which there are two roots. The command's speed has kv f
    of a velocity feed-forward f; the command has ki (f - 1), or -ki where f is not integrated: that tells the root.
    """
    e, integral, kv, forward, weight = gains[0], gains[1], -gains[2], gains[4], gains[7]
    inside = e**2 - 4.0 * kv * integral
    if inside < -0.3 * e**2 or kv <= 0.0:
        return False, 0.0, 0.0
    roots = [(e + x * np.sqrt(max(inside, 0.0))) / (2.0 * kv) for x in (1.0, -1.0)]
    ahead = forward / kv, 0.0
    kp = float(min(roots, key=lambda kp: min(abs((e - kv * kp) * (f - 1.0) - weight) for f in ahead)))
    return True, kp, float(e - kv * kp)
