"""What speaks for a cause, and the question that is asked."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.evidence import Left
from pinotwin.diagnosis.days.mechanisms import TOLD, Acts
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.stretch import Stretch, combined
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.effects import Effect

ALL = "*"
"""Axis of what acts on the whole machine."""


@dataclass(frozen=True, eq=False)
class Row:
    """What speaks for one cause.

    Attributes:
        name: of the cause. axis: where. axes: all on which it acts.
        group: of :data:`~pinotwin.diagnosis.days.mechanisms.GROUPS`.
        score: gain of the log density less the price [nats]. by: of every equation and of the healthy day.
        price: of numbers and search [nats]. count: numbers.
        theta: the last of them. error: its standard error. z: all of them over their errors.
        own: what it is on the twin's own days, where they speak for it.
        worth: size over the effort; 1 where it has none in the effort.
        logs: gain of every stretch [nats]. positive: gains over all changes of cells. spread: cells that carry it.
        closed: equation -> share of what is open.
        valid: gain on the validation log with the numbers as they are [nats]; None where there is none.
        what: other axis of a cross friction, channel of a description, READ, TOLD, or the axis of what acts on several.
        place, spans: of what acts at places or instants. p: probability [1]. alike: of its class, as probable.
        acts: axis -> of every stretch equation -> columns. unseen: likewise of the validation log, None where they
            cannot be told there. numbers, errors: all of them, shape (count,) each.
        beside: numbers and errors of what was found as they are beside it, shape (2, f).
        form: the effect whose columns these are. scale: what its coefficients were divided by, shape (count,).
    """

    name: str
    axis: str
    group: str
    score: float = 0.0
    by: Mapping[str, float] = field(default_factory=dict)
    price: float = 0.0
    count: int = 0
    theta: float = 0.0
    error: float = 0.0
    z: float = 0.0
    worth: float = 0.0
    logs: Sequence[float] = ()
    positive: float = 0.0
    spread: float = 0.0
    closed: Mapping[str, float] = field(default_factory=dict)
    valid: float | None = None
    what: str = ""
    axes: Sequence[str] = ()
    place: tuple[float, float] | None = None
    spans: Sequence[tuple[int, float, float]] = ()
    since: Sequence[float] = ()
    acts: Mapping[str, list[Acts]] = field(default_factory=dict, repr=False)
    unseen: Mapping[str, list[Acts]] | None = field(default=None, repr=False)
    numbers: Floats = field(default_factory=lambda: np.zeros(0), repr=False)
    errors: Floats = field(default_factory=lambda: np.zeros(0), repr=False)
    beside: Floats = field(default_factory=lambda: np.zeros((2, 0)), repr=False)
    p: float = 0.0
    alike: Sequence[str] = ()
    form: Effect | None = None
    scale: Floats = field(default_factory=lambda: np.ones(1), repr=False)
    own: float = 0.0

    def acts_on(self, axes: Collection[str]) -> bool:
        """Whether it acts on any of some axes."""
        return self.axis == ALL or not {self.axis, *self.axes}.isdisjoint(axes)

    def courses(self, axis: str, equation: str, *, unseen: bool = False) -> list[Floats]:
        """Return what it adds to an equation of an axis in every stretch, (n,) each, SI; none where it does not act.

        ``unseen``: in those of validation.
        """
        acts = (self.unseen or {}) if unseen else self.acts
        return [combined(x[equation], self.numbers) for x in acts.get(axis, ()) if equation in x]

    def meets(self, other: Row) -> bool:
        """Whether it acts on any axis on which another acts."""
        return other.axis == ALL or self.acts_on({other.axis, *other.axes})

    @property
    def rescales(self) -> bool:
        """Whether the effort was read in another unit: the log is put right, and asked again."""
        return self.name == "effort_scale" and "law" in self.by

    @property
    def refitted(self) -> Row:
        """What is fitted again with every cause beside it; the gains that follow a body are a healthy day's then."""
        if self.what != TOLD:
            return self
        body = self.count - sum("law" in each[0] for each in self.acts.values())  # one gain a law
        acts = {a: [{"plant": x["plant"][:, :body]} for x in each] for a, each in self.acts.items()}
        return replace(self, acts=acts, count=body, numbers=self.numbers[:body])

    def renewed(self, numbers: Floats) -> Row:
        """Return the row with the first of its numbers, and their errors, as they are beside others, shape (2, n)."""
        told = np.array([self.numbers, self.errors])
        told[:, : numbers.shape[1]] = numbers
        return replace(
            self, numbers=told[0], errors=told[1], theta=float(told[0, -1]), error=float(told[1, -1])
        )

    @property
    def contradicted(self) -> bool:
        """Whether a log that the numbers have not seen speaks against them by more than they cost."""
        return self.valid is not None and self.valid < -self.price

    def plain(self) -> dict[str, Any]:
        """Return what `train` reads."""
        hidden = ("acts", "unseen", "numbers", "errors", "beside", "form", "scale")
        return {k: v for k, v in vars(self).items() if k not in hidden}


@dataclass(frozen=True, eq=False)
class Question:
    """Logs in question, and what the equations leave of them; validation logs, likewise."""

    reference: Reference
    logs: Sequence[Stretch]
    left: Sequence[Left]
    valid: Sequence[Stretch] = ()
    valid_left: Sequence[Left] = ()
    worth: float = SETTINGS.share  # of the effort: the smallest cause worth a word [1]

    @classmethod
    def of(cls, r: Reference, logs: Sequence[Stretch], valid: Sequence[Stretch] = ()) -> Question:
        """Return the question what has changed in some stretches."""
        return cls(r, logs, [r.residuals(s) for s in logs], valid, [r.residuals(s) for s in valid])

    def without(self, found: Sequence[Row]) -> Question:
        """Return the question with the efforts put right that were read in another unit."""
        factors = {f.axis: 1.0 / (1.0 + f.theta) for f in found if f.rescales}
        if not factors:
            return self
        logs, valid = ([s.scaled(factors) for s in x] for x in (self.logs, self.valid))
        return replace(Question.of(self.reference, logs, valid), worth=self.worth)

    def ends(self) -> dict[str, tuple[float, float]]:
        """Return axis -> ends of its travel in all logs [m or rad]."""
        every = [*self.reference.logs, *self.logs, *self.valid]
        places = {k: np.concatenate([s.axes[k]["q"] for s in every]) for k in self.reference.axes}
        return {k: (float(q.min()), float(q.max())) for k, q in places.items()}
