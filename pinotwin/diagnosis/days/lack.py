"""A candidate of what a model lacks, or of what has changed: its columns, and what they are worth by the one score."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import Joined, named, same_cause
from pinotwin.diagnosis.candidates.patterns import Pattern
from pinotwin.diagnosis.days.coupled import coupled
from pinotwin.diagnosis.days.forms import known, parts
from pinotwin.diagnosis.days.ground import Fit, Ground, Tables
from pinotwin.diagnosis.days.mechanisms import group_of
from pinotwin.diagnosis.days.row import Row
from pinotwin.diagnosis.days.rows import positive, spread
from pinotwin.diagnosis.days.score import errors
from pinotwin.diagnosis.payload import possible as body_can_be
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.effects import Effect
from pinotwin.effects.family import TRANSMISSION
from pinotwin.effects.layout import rigid_body_of
from pinotwin.signals import rms

BODIES = ("inertial_coupling", "wrist_coupling", "payload", "geometric_error")
"""A load shows on the axis that lifts it, whichever carries it."""


@dataclass(frozen=True, eq=False)
class Lack:
    """A candidate: an effect at its shapes, or pushes (no effect), its columns and what they are worth.

    ``total`` is the gain less the price [nats], ``own`` that on its own axis alone; the price of a change holds what
    the same closes of logs on which nothing has changed.
    """

    name: str
    axis: str
    effect: Effect | None
    tables: Tables = field(repr=False)
    fit: Fit = field(repr=False)
    ground: Ground = field(repr=False)
    joint: int
    price: float

    @property
    def theta(self) -> Floats:
        """Coefficients, shape (p,)."""
        return self.fit.theta

    @property
    def count(self) -> int:
        """How many numbers it has, searched ones with them: of a push its instant and its length."""
        return 3 * len(self.theta) if self.effect is None else len(self.theta) + type(self.effect).searched

    @property
    def searched(self) -> bool:
        """Whether instants were searched: no fold tells the pushes of another."""
        return self.effect is None

    def gains(self, j: int) -> Floats:
        """Return the gain of every cell of a joint [nats]."""
        base = self.ground.base[j]
        if self.searched:
            return self.fit.full[j] - base.full[j]
        return self.fit.held[j] - base.held[j]

    def seen(self, j: int) -> float:
        """Return the gain on the validation rows of a joint by the numbers as they are [nats]."""
        return float((self.fit.seen[j] - self.ground.base[j].seen[j]).sum())

    @property
    def day(self) -> float:
        """What the healthy day becomes more likely by [nats]."""
        return self.fit.cost - sum(self.ground.base[j].cost for j in self.fit.held)

    @property
    def total(self) -> float:
        """Gain less price [nats]."""
        return sum(float(self.gains(j).sum()) + self.seen(j) for j in self.fit.held) + self.day - self.price

    @property
    def own(self) -> float:
        """The same on its own axis alone; of a change without the day, which takes up a part of any [nats]."""
        day = 0.0 if self.ground.c.change else self.day
        return float(self.gains(self.joint).sum()) + self.seen(self.joint) + day - self.price

    @property
    def share(self) -> float:
        """Share of the squared residual of its axis that it closes [1]."""
        return 1.0 - self.fit.left[self.joint] / max(self.ground.base[self.joint].left[self.joint], 1e-300)

    @property
    def worth(self) -> float:
        """RMS of what it closes over the variation of the effort [1]."""
        return self.ground.open(self.joint) * float(np.sqrt(max(self.share, 0.0)))

    @cached_property
    def size(self) -> float:
        """RMS of what it adds to the effort while it acts, over the variation of that [1].

        The twin's own numbers take up most of some causes: they close little, and are as large on other motions. What
        special cases of it do that the machine lists is not its own. A pattern is as large as what it closes.
        """
        if isinstance(self.effect, Pattern):
            return self.worth
        X, course = self.ground.own[0][self.joint][:, self.listed], self.tables[0][self.joint] @ self.theta
        course -= X @ np.linalg.lstsq(X, course, rcond=1e-9)[0]
        acts = course != 0.0 if self.searched else slice(None)
        return rms(course[acts]) / max(self.ground.samples[0].size(self.joint), 1e-300)

    @cached_property
    def listed(self) -> list[int]:
        """Free columns of the twin's effects that are special cases of this one, as viscous friction of warming."""
        if self.effect is None or self.ground.c.change:
            return []
        twin, e = self.ground.c.twin, named(self.effect)
        parts_ = {*e.contains, *(x.name for x in parts(self.effect)[:-1])}
        pairs = zip(twin.effects, twin.slices, strict=True)
        return [k for x, s in pairs if x.axis == e.axis and x.name in parts_ for k in range(s.start, s.stop)]

    @cached_property
    def numbers(self) -> tuple[Floats, Floats, Floats]:
        """Numbers before and after, shape (p,) each, and the covariance of those after, shape (p, p).

        Those of a machine's effects that are special cases of this one are in it.
        """
        assert self.effect is not None
        g, twin, own = self.ground, self.ground.c.twin, self.listed
        if g.c.change:
            before = known(twin, self.effect)
            return before, before + self.theta, self.fit.covariance
        found = g.instead(self.joint, self.tables[0][self.joint], own) if own else None
        if found is None:
            return np.zeros(len(self.theta)), self.theta, self.fit.covariance
        turn, theta, covariance = found
        before = turn @ twin.theta[own]
        return before, before + theta, covariance

    @property
    def spans(self) -> list[tuple[float, float]]:
        """When an axis was pushed [s], from and to, in order; what overlaps, or is in several logs, is one."""
        t, out = self.ground.parts[self.joint][0].t, list[tuple[float, float]]()
        rows = [np.flatnonzero(x) for x in self.tables[0][self.joint].T]
        for a, b in sorted((float(t[k[0]]), float(t[k[-1]])) for k in rows):
            if out and a <= out[-1][1] + self.ground.step:
                a, b = out[-1][0], max(out.pop()[1], b)
            out.append((a, b))
        return out

    def pushes(self) -> list[Floats]:
        """Return the course of every push, (n,) each [N or N·m]."""
        course, t = self.tables[0][self.joint] @ self.theta, self.ground.parts[self.joint][0].t
        return [course[(t >= a) & (t <= b)] for a, b in self.spans]

    @property
    def possible(self) -> bool:
        """Whether a machine can have such an effect, within two standard errors, and it pays on its own axis."""
        if self.own <= 0.0:
            return False
        e, c, covariance = self.effect, self.ground.c, self.fit.covariance
        if e is None:  # what goes to and fro is a vibration
            each = self.pushes()
            return sum(abs(x.sum()) for x in each) > 0.5 * sum(np.abs(x).sum() for x in each)
        if isinstance(e, Pattern):
            return True
        if self.name == "payload":
            return body_can_be(self.theta, covariance, c.twin.model, removal=c.change)
        low, high = np.transpose([(x.lower, x.upper) for x in e.coefficients()])
        if e.family is TRANSMISSION and not c.change and self.theta[-1] > high[-1]:
            # The twin's inertia was fitted without the spring: that is no bound.
            carried, whole = self.inertias
            high = np.r_[high[:-1], whole / max(carried, 1e-300)]
        if e.logged_effort and e.axis in c.gate.turned:
            factor = np.isfinite(low)  # that drive counts its effort the other way
            low, high = np.where(factor, -np.inf, low), np.where(factor, low, high)
        _, value, covariance = self.numbers
        slack = 2.0 * errors(covariance)
        slack *= -1.0 if e.logged_effort else 1.0  # a factor that is not told from zero measures no effort
        within = bool(np.all((low - slack <= value) & (value <= high + slack))) and e.possible(self.theta)
        return within and (not isinstance(e, Joined) or self._brakes(value))

    def _brakes(self, value: Floats) -> bool:
        """Whether friction of numbers (p,) that changes in the course of a log brakes in every cell of it."""
        g, j = self.ground, self.joint
        course = self.tables[0][j] @ value * g.samples[0].motion.v[g.samples[0].samples(j), j]
        power = np.add.reduceat(course, g.parts[j][0].edges[:-1])
        return bool((power >= -1e-9 * np.abs(power).max(initial=0.0)).all())

    @cached_property
    def inertias(self) -> tuple[float, float]:
        """Mean inertia of its axis in the twin, and of a machine as refitted beside it [kg or kg·m²]; 0 if unknown."""
        g, c, j = self.ground, self.ground.c, self.joint
        mass, m = c.new.motion.mass, c.machine
        carried = 0.0 if mass is None else float(np.mean(mass[:, j, j]))
        if c.change or not carried:
            return carried, carried
        middle = c.new.motion.q.mean(axis=0, keepdims=True)
        still, push = np.zeros_like(middle), np.eye(middle.shape[1])[j : j + 1]
        rest, more = (m.base.regressor(m.model, middle, still, a)[0, j] for a in (still, push))
        at = rigid_body_of(c.twin.effects)[1]
        return carried, carried + float((more - rest) @ g.refitted(j, self.fit)[at])

    def row(self) -> Row:
        """Return its row of evidence, by which a decision is trained."""
        g, j = self.ground, self.joint
        every = np.concatenate([self.gains(k) for k in self.fit.held])
        p = g.parts[j][0]
        logs = np.bincount(p.log[p.edges[:-1]], self.gains(j))
        pattern = isinstance(self.effect, Pattern)
        gain = self.total + self.price - self.day
        return Row(
            name="describe" if pattern else self.name,
            axis=self.axis,
            group="describe" if pattern else group_of(self.name),
            score=self.total,
            by={"plant": gain, "day": self.day},
            price=self.price,
            count=len(self.theta),
            theta=float(self.theta[-1]),
            error=float(self.fit.error[-1]),
            z=float(np.linalg.norm(np.clip(self.theta / np.maximum(self.fit.error, 1e-300), -1e9, 1e9))),
            worth=self.worth,
            logs=[float(x) for x in logs],
            positive=positive(every),
            spread=spread(every),
            closed={"plant": self.share},
            valid=sum(self.seen(k) for k in self.fit.seen) if len(g.parts[j]) > 1 else None,
            what=self.name if pattern else "",
        )


def judged(g: Ground, effect: Effect | None, axis: str, tables: Tables | None) -> Lack | None:
    """Return a candidate with what it is worth but for the search; None where the twin's own columns leave none of it.

    ``effect``: at its shapes, None of pushes.
    """
    if not tables or not tables[0]:
        return None
    names, price = g.c.machine.names, 0.0
    if effect is not None and not g.c.change and effect.name == "effort_scale":
        g, tables, price = coupled(g, names.index(axis))
    first = tables[0]
    j = names.index(axis) if axis in names and names.index(axis) in first else next(iter(first))
    size = np.sqrt(sum(np.mean(x**2, axis=0) / g.noise[k][0] ** 2 for k, x in first.items()))
    p, x = g.parts[j][0], first[j]
    rest = x - p.twin @ (p.twin.T @ x) / len(x)
    if not np.isfinite(size).all() or not (size > 0.0).all() or np.sum(rest**2) < 1e-5 * np.sum(x**2):
        return None
    scaled = [{k: x / size for k, x in t.items()} for t in tables]
    fit = g.fit(scaled)
    fit = replace(fit, theta=fit.theta / size, covariance=fit.covariance / np.outer(size, size))
    # Numbers that are fitted pay for themselves: no cell is judged by numbers that know it.
    numbers = 0.0 if effect is None else 0.25 * len(size) + type(effect).searched
    price += SETTINGS.number * numbers + len(fit.held) - 1.0  # of two alike that on fewer axes
    name = "external_force" if effect is None else named(effect).name
    out = Lack(name, axis, effect, tables, fit, g, j, price)
    if name in BODIES:
        out = replace(out, joint=max(fit.held, key=lambda k: float(out.gains(k).sum())))
    return out


def kin(a: Lack, b: Lack) -> bool:
    """Whether two causes are one as far as any motion can tell, or of one axis where one looks like the other."""
    if a.effect is None or b.effect is None:
        return (a.name, a.axis) == (b.name, b.axis)
    x, y = named(a.effect), named(b.effect)
    if x.name == y.name == "payload":
        return True  # a load may be named on any link that it moves with
    like = y.name in (*x.contains, *x.imitates) or x.name in (*y.contains, *y.imitates)
    return same_cause(x, y) or (like and a.axis == b.axis and not isinstance(a.effect, Pattern))
