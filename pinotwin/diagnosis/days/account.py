"""What a model lacks, in the form of the contract: each cause with its numbers, what it closes, and its rivals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import Joined, named
from pinotwin.diagnosis.candidates.patterns import Pattern
from pinotwin.diagnosis.conclusion.explained import Closed, rival
from pinotwin.diagnosis.conclusion.sizes import body_sizes, largest
from pinotwin.diagnosis.data.samples import ROW_RATE
from pinotwin.diagnosis.days.causes import plain_row
from pinotwin.diagnosis.days.ground import Ground
from pinotwin.diagnosis.days.lack import Lack, judged, kin
from pinotwin.diagnosis.days.pushed import pushed, pushes_of
from pinotwin.diagnosis.days.score import errors
from pinotwin.diagnosis.days.structure import BAR, Lacking, Turn, beside, polished
from pinotwin.diagnosis.result import Found, Gap, Region, Size, Traces
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.units import of_axis

ROUNDED = 1e-9
"""Share of what a number is now below which it was none before: a fit leaves 2e-14 of what rests at zero."""


@dataclass(frozen=True, eq=False)
class Told:
    """A cause beside those that are named before it.

    Attributes:
        one: the cause. sized: the same by the noise that it leaves, for its numbers. turn: in which it stands.
        probability: of its class [1]. closed: joint -> what it closes.
    """

    one: Lack
    sized: Lack
    turn: Turn
    probability: float
    closed: Mapping[int, Closed]

    @property
    def sure(self) -> bool:
        """Whether it is named: it is likely, and no validation log contradicts it on every axis."""
        told = any(x.share > 0.0 or x.on != "validation" for x in self.closed.values())
        return told and self.probability >= SETTINGS.likely


class Account:
    """The causes of a search in the order in which they are named, and what is left beside them.

    Attributes:
        search: which found them. causes: without a name, none. patterns: axis -> what is left follows, in words.
        rest: the ground beside them.
    """

    def __init__(self, found: Lacking) -> None:
        # Names are told by half of the rows, numbers by all.
        g = self.start = Ground.of(found.start.c, ROW_RATE)
        self.search = found
        self.causes = list[Told]()
        self.disturbed = {x.joint for x in found.causes if x.searched}
        self.patterns = {x.axis: x.effect.says() for x in found.causes if isinstance(x.effect, Pattern)}
        for own in found.listed:
            g = beside(g, _again(g, own) or own)
        pairs = [(x, min(sum(p for y, p in x.probabilities() if kin(y, x.taken)), 1.0)) for x in found.named]
        # Those that are sure first, the largest before others, and pushes beside what comes with the motion.
        pairs.sort(key=lambda x: (x[1] < SETTINGS.likely, x[0].taken.effect is None, -x[0].taken.worth))
        for turn, sure in pairs:
            one = turn.taken
            again = None if isinstance(one.effect, Pattern) else _again(g, one)
            if again is None or (again.effect is not None and again.total <= BAR):
                continue
            closed = {j: self._closed(again, j) for j in again.fit.held}
            told = {j: x for j, x in closed.items() if j == again.joint or x.share >= RULES.share}
            rest = beside(g, again)
            sized = again
            if again.effect is not None:
                sized = judged(g.as_noisy_as(rest), again.effect, again.axis, again.tables) or again
            self.causes.append(Told(again, sized, turn, sure, told))
            g = rest if self.causes[-1].sure else g
        self.rest = g

    def _closed(self, one: Lack, j: int) -> Closed:
        """Return what a cause closes of an axis beside those named before it, by numbers that do not know the rows.

        Instants are told by the very rows that show them, so the logs in question judge all causes of such an axis.
        """
        told = j not in self.disturbed and len(self.start.parts[j]) > 1
        named_ = [x.one for x in self.causes if x.sure and j in x.one.fit.held]
        whole, gained = list[Floats](), list[Floats]()
        for k in (0, int(told)):
            p = self.start.parts[j][k]
            whole.append(np.add.reduceat(p.left**2, p.edges[:-1]))
            gained.append((_left(named_[-1], j, k) if named_ else whole[-1]) - _left(one, j, k))
        promised = float(gained[0].sum() / max(float(whole[0].sum()), 1e-300))
        on = "validation" if told else "fitted logs" if one.searched else "held-out blocks"
        return Closed(whole[1], gained[1], promised, on)

    @cached_property
    def together(self) -> dict[str, Closed]:
        """Axis -> what all named causes close together."""
        out = dict[int, list[Closed]]()
        for x in self.causes:
            for j, closed in x.closed.items() if x.sure else ():
                out.setdefault(j, []).append(closed)
        return {self.start.c.machine.names[j]: reduce(Closed.beside, out[j]) for j in sorted(out)}

    def found(self, gaps: Mapping[str, Mapping[str, Gap]]) -> list[Found]:
        """Return all causes in the form of the contract; ``gaps``: axis -> signal -> gap."""
        return [_found(x, gaps) for x in self.causes if x.sure or x.probability < SETTINGS.likely]

    def traces(self) -> list[Traces]:
        """Return arrays for plots: the residual before and after the named causes, by axis and log."""
        c, out = self.start.c, list[Traces]()
        for j, (p, *_) in self.start.parts.items():
            axis = c.machine.names[j]
            out += c.traces(axis, p.t, p.left, self.rest.left(j) if axis in self.together else p.left)
        return out

    def evidence(self) -> list[dict[str, Any]]:
        """Return the rows of the first turn, each with its probability when its axis was asked."""
        ranked = [x for x in self.search.first if not isinstance(x.effect, Pattern)]
        chance = {(x.name, x.axis): p for turn in self.search.named[::-1] for x, p in turn.probabilities()}
        out = []
        for x in (x for x in ranked if x.size > self.start.c.worth):
            p = chance.get((x.name, x.axis), 0.0)
            near = [y for y in ranked if chance.get((y.name, y.axis), 0.0) > p * np.exp(-SETTINGS.number)]
            out.append(plain_row(replace(x.row(), p=p, alike=[y.name for y in near if kin(x, y)]), x.axis))
        return out

    def pushed(self) -> list[Region]:
        """Return when axes were pushed, what closes most first."""
        return [r for x in self.causes if x.one.effect is None and x.sure for r in _times(x.one)]


def _left(one: Lack, j: int, part: int) -> Floats:
    """Return the squared residual that a cause leaves of every cell of a joint, (c,) [N² or N²·m²]."""
    found = one.fit.seen if part else one.fit.full if one.searched else one.fit.held
    return one.ground.power(j, found[j], part)


def _again(g: Ground, one: Lack) -> Lack | None:
    """Return a cause on another ground; one that swings may do so beyond the band by which its name was told."""
    if one.effect is None:
        return pushes_of(g, one.joint, pushed(g, one.joint))
    again = judged(g, one.effect, one.axis, g.table(one.effect))
    while again is not None and any(x.unit == "Hz" for x in one.effect.shapes()):
        before, again = again, polished(g, again)
        if again.total < before.total + 1.0:
            break
    return again


def alike(turn: Turn) -> list[list[str]]:
    """Return what these logs do not tell apart, as ``axis.effect``: a cause and its kin that are as probable.

    As probable is what lies within the price of one number.
    """
    one, found = turn.taken, turn.probabilities()
    if isinstance(one.effect, Pattern):
        return []
    own = max(p for x, p in found if (x.name, x.axis) == (one.name, one.axis))
    inseparable = [] if one.effect is None else [f"{one.axis}.{x}" for x in named(one.effect).inseparable]
    near = [x for x, p in found if p > own * np.exp(-SETTINGS.number) and kin(x, one)]
    same = [f"{x.axis}.{x.name}" for x in (*near, *_ratios(turn, one))]
    group = list(dict.fromkeys([f"{one.axis}.{one.name}", *inseparable, *same]))
    return [group] if len(group) > 1 else []


def _ratios(turn: Turn, one: Lack) -> list[Lack]:
    """Return factors on the effort of other axes that nobody knows beside this one: only their ratio shows."""
    g = turn.ground
    others = [
        x for x in turn.rivals if g not in (x.ground, one.ground) and x.joint != one.joint and x.total > BAR
    ]
    rest = beside(g, one) if others else g
    again = [(x, judged(rest, x.effect, x.axis, x.tables)) for x in others]
    return [x for x, y in again if y is None or abs(x.theta[0]) < 2.0 * y.fit.error[0]]


def _found(x: Told, gaps: Mapping[str, Mapping[str, Gap]]) -> Found:
    one, names = x.one, x.one.ground.c.machine.names
    acts = {names[j]: y.shrink(gaps[names[j]]["u"].rms, names[j]) for j, y in x.closed.items()}
    sizes = sizes_of(x.sized)
    if one.effect is None:
        effect, theta = None, {f"f{k}": -f for k, f in enumerate(_forces(one))}
        shape = {f"start{k}": a for k, (a, _) in enumerate(one.spans)}
    else:
        effect, coefficients = named(one.effect), one.effect.coefficients()
        theta = dict(zip((c.name for c in coefficients), x.sized.theta.tolist(), strict=True))
        shape = dict(zip((s.name for s in effect.shapes()), effect.shape_values(), strict=True))
        shape.update(("resonance", s.after) for s in sizes if s.name.endswith(".resonance"))
    rivals = [
        rival(r.name, r.axis, p, r.share, r.total)
        for r, p in x.turn.probabilities()
        if p > 0.005 and not isinstance(r.effect, Pattern) and (r.name, r.axis) != (one.name, one.axis)
    ]
    return Found(
        effect=one.name,
        axis=one.axis,
        confidence=x.probability,
        shape=shape,
        theta=theta,
        shrink={"u": acts[names[one.joint]]},
        alternatives=rivals[:5],
        gain=one.total,
        size=sizes,
        listed=effect,
        acts=acts,
    )


def sizes_of(one: Lack) -> list[Size]:
    """Return what changed from what to what, in the effect's own numbers, with 90 % intervals."""
    if one.effect is None:
        unit = of_axis("F", one.ground.c.machine.rotary[one.joint])
        loads = -np.array(_forces(one))  # a load on the axis has the other sign
        return [largest("largest disturbance", loads, one.theta, one.fit.error, unit)]
    if one.name == "payload":
        return body_sizes(one.theta, one.fit.covariance)
    (before, after, covariance), rows = one.numbers, list[Size]()
    half = 1.645 * errors(covariance)
    each = zip(one.effect.coefficients(), before, after, half, strict=True)
    for x, old, now, wide in each:
        least = -np.inf if one.effect.logged_effort else x.lower
        old, now = (float(old) if abs(old) > ROUNDED * abs(now) else 0.0), max(float(now), least)
        low, high = (float(max(now + h, least)) for h in (-wide, wide))
        rows.append(Size(f"{one.name}.{x.name}", old, float(now), x.unit, (low, high)))
    if isinstance(one.effect, Joined):  # its own number comes before that of what it rides on
        own = len(named(one.effect).coefficients())
        rows = [*rows[-own:], *rows[:-own]]
    return [*_resonance(one), *rows]


def _resonance(one: Lack) -> list[Size]:
    """Return the mode of a flexible drive with its motor free, from that with the motor held."""
    if one.name not in ("drive_flexibility", "joint_flexibility") or one.effect is None:
        return []
    carried, whole = one.inertias
    held, share, error = float(one.effect.shape_values()[0]), float(one.theta[-1]), float(one.fit.error[-1])

    def free(x: float) -> float:
        return held / float(np.sqrt(np.clip(1.0 - x * carried / whole, 1e-3, 1.0)))

    if not 0.0 < share * carried < whole:
        return []
    span = free(share - 1.645 * error), free(share + 1.645 * error)
    return [Size(f"{one.name}.resonance", float("nan"), free(share), "Hz", span)]


def _forces(one: Lack) -> list[float]:
    """Return the effort of every push at its largest [N or N·m]."""
    return [float(x[np.argmax(np.abs(x))]) for x in one.pushes()]


def _times(one: Lack) -> list[Region]:
    """Return when an axis was pushed, the largest first, with the share of the residual that pushes close there."""
    p = one.ground.parts[one.joint][0]
    course, whole = one.tables[0][one.joint] @ one.theta, max(float(p.left @ p.left), 1e-300)
    gone = (p.left**2 - (p.left - course) ** 2) / whole
    out = []
    for a, b in one.spans:
        at = (p.t >= a) & (p.t <= b)
        out.append(Region(one.axis, "u", "time", (a, b), "s", float(gone[at].sum()), float(at.mean()), None))
    return sorted(out, key=lambda r: -r.share)
