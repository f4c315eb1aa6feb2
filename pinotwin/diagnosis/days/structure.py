"""What a machine's model lacks, by the one score: every effect of the catalogue at the shapes that explain most.

One cause after the other: the best is put among the nuisances, with its tangents, before the next is sought. A pattern
without a name is sought alike, and names nothing.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from scipy.optimize import minimize

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import candidates, named
from pinotwin.diagnosis.candidates.patterns import Curve, patterns
from pinotwin.diagnosis.data.comparison import Comparison, foretells
from pinotwin.diagnosis.days.ground import Ground, Tables
from pinotwin.diagnosis.days.lack import BODIES, Lack, judged, kin
from pinotwin.diagnosis.days.places import instants
from pinotwin.diagnosis.days.pushed import chance, pushed, pushes_of
from pinotwin.diagnosis.days.rows import least_share
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.effects import Effect
from pinotwin.effects.layout import effect_slices

Admits = Callable[[str, str | None], bool]
KEPT, ASKED, POLISHED = 2, 8, 4
"""Instances of one name on one axis that are kept, most of them that are scored, and names of one turn whose shapes are
polished."""
LEAST = 0.2  # Of what is left of its axis, squared, that a cause closes
BAR = 14.0  # Gain less price from which a cause is taken [nats]
WIDTH = 8.0
"""By how much the logarithms of the odds of two causes of a machine are smaller than the difference of their scores
[nats]: so the mean probability of 94 causes of known machines was the share of those that were right."""
STRONGER = 2.5  # Times what a twin's own strongest push closes, squared, that one of a change must close
LAPSE = 0.04  # Of the names that were wrong whatever their score: 5 of 125 on known machines
FEW = 3  # Numbers by which nobody follows any rest of a form


class Finder:
    """The candidates of a comparison, and what of them holds from turn to turn."""

    def __init__(self, c: Comparison, leave_out: Collection[str], admits: Admits) -> None:
        self.c = c
        self.groups: dict[tuple[str, str], list[Effect]] = defaultdict(list)
        for e in (*candidates(c, leave_out), *patterns(c)):
            if c.gate.admits(named(e).name, named(e).axis) and admits(named(e).name, named(e).axis):
                self.groups[named(e).name, str(named(e).axis)].append(e)
        self.pushed = "external_force" not in leave_out
        self.tables: dict[Effect, Tables | None] = {}
        self.kept: dict[tuple[str, str], tuple[set[int], list[Lack]]] = {}
        self.finished: dict[Lack, Lack] = {}  # by the candidate as it was kept
        self.usual: dict[int, float] = {}  # joint -> what the strongest push in a twin's own logs closes

    def ranked(self, g: Ground, axis: str | None = None) -> list[Lack]:
        """Return the best candidate of every name and axis, or of one axis, shapes polished, best first."""
        names = self.c.machine.names
        off = {names[j] for j in g.parts if not foretells(self.c, j)}
        quiet = {names[j] for j in g.parts if not g.loud(j)}
        changed = set(g.found[-1][0][0]) if g.found else set(g.parts)
        best: dict[tuple[str, str], Lack] = {}
        asked = [(key, self._instances) for key in self.groups]
        asked += [(("external_force", names[j]), self._pushes) for j in g.parts if self.pushed]
        for key, look in asked:
            few = len(self.groups.get(key, ())) <= KEPT or key[0] in BODIES  # no search, or shows elsewhere
            if key[1] in off or axis not in (None, key[1]) or (key[1] in quiet and not few):
                continue
            if axis is not None or key not in self.kept or self.kept[key][0] & changed:
                self.kept[key] = look(g, key)
            for one in self.kept[key][1]:
                if key not in best or one.total > best[key].total:
                    best[key] = one
        out = sorted(best.values(), key=lambda x: -x.total)
        top = max((x.total for x in out), default=0.0)
        near = [x for k, x in enumerate(out) if x.total > 0.0 and (k < POLISHED or x.total > 0.7 * top)]
        self.finished |= {x: self._news(g, polished(g, x)) for x in near if x not in self.finished}
        out = [*(self.finished[x] for x in near), *(x for x in out if x not in near)]
        return sorted(out, key=lambda x: -x.total)

    def _news(self, g: Ground, one: Lack) -> Lack:
        """Return a candidate, dearer by what the same closes of as many rows on which nothing has changed."""
        past, j = g.past, one.joint
        if past is None or one.effect is None or not set(one.tables[0]) <= set(past.parts):
            return one
        same = judged(past, one.effect, one.axis, past.table(one.effect))
        usual = 0.0 if same is None else max(same.total + same.price, 0.0)
        here, there = (len(x.parts[j][0].left) / x.noise[j][1] for x in (g, past))
        return replace(one, price=one.price + usual * here / there)

    def _instances(self, g: Ground, key: tuple[str, str]) -> tuple[set[int], list[Lack]]:
        """Return the joints that a name on an axis acts on, and its best instances that a machine can have.

        Of every number of coefficients there are some.
        """
        group, found, joints, asked = self.groups[key], list[Lack](), set[int](), Counter[int]()
        if len(group) > KEPT:
            rough = g.explains(group)
            order = [int(k) for k in np.argsort(rough)[::-1] if rough[k] > 0.0]
            group = [group[k] for k in order] or group[:1]
        for e in group:
            count = len(e.coefficients())
            asked[count] += 1
            if asked[count] > ASKED or sum(len(x.theta) == count for x in found) == KEPT:
                continue
            if e not in self.tables:
                self.tables[e] = g.table(e)
            joints |= set((self.tables[e] or [{}])[0])
            one = judged(g, e, key[1], self.tables[e])
            if one is not None and one.ground is not g:
                joints |= set(g.parts)
            if one is not None and one.possible:
                found.append(one)
        return joints or set(g.parts), found

    def _pushes(self, g: Ground, key: tuple[str, str]) -> tuple[set[int], list[Lack]]:
        j = self.c.machine.names.index(key[1])
        columns = pushed(g, j) if self.c.gate.admits(*key) else []
        one = pushes_of(g, j, columns)
        if one is not None and g.past is not None:
            # A twin's misfit comes and goes as pushes do: the strongest must close more than that of its own logs.
            if j not in self.usual:
                self.usual[j] = _strongest(g.past, j, pushed(g.past, j))[1]
            worth, closes = _strongest(g, j, columns)
            worth *= closes > STRONGER * self.usual[j]
            one = replace(one, price=one.price + one.total - worth)
        elif one is not None:
            one = replace(one, price=one.price + instants(len(columns)) - chance(g, j, columns))
        return {j}, [one] if one is not None and one.possible else []


def _strongest(g: Ground, j: int, columns: Sequence[Floats]) -> tuple[float, float]:
    """Return what the strongest of some pushes on a joint is worth [nats], and what it closes; none, of none."""
    g = g.fine(j)
    one = pushes_of(g, j, columns[:1])
    return (0.0, 0.0) if one is None else (one.total, g.base[j].left[j] - one.fit.left[j])


def polished(g: Ground, one: Lack) -> Lack:
    """Return a candidate with its shapes moved to where it is worth most."""
    shapes = () if one.effect is None else one.effect.shapes()
    if one.effect is None or not shapes or type(one.effect).searched == 0:
        return one
    log, best = np.array([s.log for s in shapes]), one

    def taken(x: Floats) -> Floats:
        return np.asarray(np.where(log, np.log(np.maximum(x, 1e-300)), x))

    low, high = (taken(np.array([getattr(s, k) for s in shapes])) for k in ("lower", "upper"))

    def loss(x: Floats) -> float:
        nonlocal best
        x = np.clip(x, low, high)
        shaped = best.effect.shaped(np.where(log, np.exp(np.where(log, x, 0.0)), x).tolist())  # type: ignore[union-attr]
        found = judged(g, shaped, one.axis, g.table(shaped))
        if found is None or not found.possible:
            return 0.0
        best = found if found.total > best.total else best
        return -found.total

    rugged = type(one.effect).searched >= 3
    for size, most in ((0.3, 50), (0.05, 24)) if rugged else ((0.05, 24),):
        assert best.effect is not None
        start = taken(np.array(best.effect.shape_values()))
        simplex = np.vstack([start, start + np.diag(np.where(log, size, size * (high - low)))])
        minimize(loss, start, method="Nelder-Mead", options={"maxfev": most, "initial_simplex": simplex})
    return best


@dataclass(frozen=True, eq=False)
class Turn:
    """One turn of a search: the ground, rivals not told yet, best first, and the one that was taken."""

    ground: Ground
    rivals: Sequence[Lack]
    taken: Lack

    def probabilities(self) -> list[tuple[Lack, float]]:
        """Return what is worth a word on the axis of what was taken, best first, each with its probability [1].

        That something is there, its score says: the probability is that of the name.
        """
        one = self.taken
        every = [x for x in self.rivals if x.joint == one.joint and x.size > self.ground.c.worth]
        every = [x for x in every if x is one or not isinstance(x.effect, Curve)]
        # A twin's own logs tell how many rows count as one.
        width = WIDTH if self.ground.past is None else 1.0
        score = np.array([x.total for x in every]) / width
        share = np.exp(score - score.max(initial=-np.inf))
        return list(zip(every, ((1.0 - LAPSE) * share / share.sum()).tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Lacking:
    """What a machine's model lacks.

    Attributes:
        start: the ground without any cause. first: its candidates, best first; none where none were asked for.
        named: causes, each in the turn of all others, in the order in which they were found.
        listed: what stands for an effect that the machine has, with its shape led astray: it names nothing.
    """

    start: Ground
    first: Sequence[Lack]
    named: Sequence[Turn]
    listed: Sequence[Lack]

    @property
    def causes(self) -> list[Lack]:
        """The causes."""
        return [x.taken for x in self.named]


def lacking(
    c: Comparison, leave_out: Collection[str] = (), admits: Admits = lambda *_: True, most: int = 5
) -> Lacking:
    """Return what a model lacks, at most so many causes: none of ``leave_out``, none that ``admits`` refuses."""
    finder, turns, first = Finder(c, leave_out, admits), list[Turn](), list[Lack]()
    g = start = Ground.of(c)
    while len(turns) < most:
        ranked = finder.ranked(g)
        first = first or ranked
        turn = _turn(g, ranked, [x.taken for x in turns])
        if turn is None:
            break
        turns.append(turn)
        g = beside(g, turn.taken)
    own = [x.taken for x in turns if listed(x.taken)]
    return Lacking(start, first, [x for x in _revised(finder, start, turns) if x.taken not in own], own)


def _turn(g: Ground, ranked: Sequence[Lack], told: Sequence[Lack]) -> Turn | None:
    """Return a turn: what is taken of that which is worth a word and was not told yet; None if nothing is.

    No machine follows a law to the last. A free curve stands back behind a cause that closes half of what it does, and
    the best cause behind a simpler one of its kin that it outdoes by no more than the rest of a form. What closes
    nearly all that others leave, by few numbers, is no rest of theirs.
    """
    known = {(x.name, x.axis) for x in told}
    rest = 1.0 + SETTINGS.trace**2

    def stands(x: Lack, share: float = LEAST) -> bool:
        form = SETTINGS.trace * max((y.worth for y in told if y.joint == x.joint), default=0.0)
        if x.count <= FEW:
            form *= float(np.sqrt(np.clip(1.0 - x.share, 0.0, 1.0)))
        # pushes must close more than anything that comes with the motion
        others = [y.share for y in ranked if y.joint == x.joint and y is not x and y.total > 0.0]
        closes = max(share, rest * max(others, default=0.0) if x.searched else 0.0)
        least = g.least(x.joint, least_share("time" if x.searched and g.past is None else "form", g.c.worth))
        return x.total > BAR and x.size > least and x.worth > form and x.share > closes

    new = [x for x in ranked if (x.name, x.axis) not in known or (x.effect and named(x.effect).several)]
    able = [x for x in new if stands(x)]
    if not able:
        return None
    able = [x for x in able if x.joint == able[0].joint]
    if isinstance(able[0].effect, Curve):
        causes = [x for x in new if x.joint == able[0].joint and not isinstance(x.effect, Curve)]
        able = [x for x in causes if stands(x, 0.5 * able[0].share)] or able

    def plain(x: Lack) -> tuple[int, int]:
        last = g.c.machine.names.index(x.axis) if x.name == "payload" else 0
        return x.count, -last  # a body sits on the last link that it can sit on

    def closes(x: Lack) -> float:  # on all axes that the best acts on, squared, in units of their noise
        return sum(
            (x.ground.base[j].left[j] - x.fit.left[j]) / g.noise[j][0] ** 2
            for j in able[0].fit.left
            if j in x.fit.left
        )

    good = [x for x in able if kin(x, able[0]) and plain(x) < plain(able[0])]
    good = [x for x in good if closes(able[0]) < rest * closes(x)]
    if g.past is not None:  # some of what it closes may be no news
        good = [x for x in good if able[0].total < rest * x.total]
    rivals = [x for x in new if not x.searched or x in able]
    return Turn(g, rivals, min([able[0], *good], key=plain))


def beside(g: Ground, one: Lack) -> Ground:
    """Return the ground beside a cause, whose form stays uncertain."""
    if one.effect is None:
        return g.beside(one.tables, len(one.theta))
    return g.beside(*g.spanned(one.effect, one.tables, one.theta))


def _revised(finder: Finder, start: Ground, turns: Sequence[Turn]) -> list[Turn]:
    """Return the causes as they are beside each other: what was found alone may have stood for what came after it."""
    out = list(turns)
    for k, one in enumerate([x.taken for x in turns]):
        rest = [x.taken for x in out if x is not out[k]]
        if any(one.joint in x.tables[0] for x in rest):
            g = reduce(beside, rest, start)
            out[k] = _turn(g, finder.ranked(g, one.axis), rest) or out[k]
    return out


def listed(one: Lack) -> bool:
    """Whether a cause stands for an effect that the machine lists, whose shape was fitted to something larger."""
    g, j = one.ground, one.joint
    effects = () if g.c.change else g.c.twin.effects
    pairs = zip(effects, effect_slices(effects), strict=True)
    own = [where for e, where in pairs if (e.name, e.axis) == (one.name, one.axis) and e.shapes()]
    if not own:
        return False
    before = g.columns(0, j)
    u = g.samples[0].effort[j]

    def left(X: Floats) -> float:
        return float(np.sum((u - X @ np.linalg.lstsq(X, u, rcond=1e-9)[0]) ** 2))

    both = np.hstack([before, one.tables[0][j]])
    alone, least = left(before), left(both)
    return any(left(np.delete(both, np.r_[w], axis=1)) - least < 0.3 * (alone - least) for w in own)
