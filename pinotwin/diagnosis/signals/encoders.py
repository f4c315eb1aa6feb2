r"""The second encoder: what lies between motor and load, straight from their difference.

With q at the motor and q_l at the load, both prepared alike, the twist d = q - q_l obeys

    d = T / k - (c / k) d' + h sign(v) + e(q_l) + tau v + d_0,      T = u - J a

T: motor effort less its own rotor's, J; k, c: stiffness and damping of the drive train; 2 h: lost motion; e: error
along the stroke (pitch of the screw, scale of an encoder); tau: time between the encoders. Motor-side friction goes
with v and sign(v). All is linear, every stretch is predicted from the others; k, c, J, h are not below zero, and tau,
of one clock, is within a few samples. Nothing is inferred from the effort alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.conclusion.explained import drawn, stated_of
from pinotwin.diagnosis.conclusion.sizes import sized
from pinotwin.diagnosis.conclusion.where import concentrated, regimes
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.result import Found, Gap, Region, Shrink, Size
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.signals.blocks import Blocked, blocks_of, by_blocks, posterior
from pinotwin.motion import Motion
from pinotwin.signals import low_pass, roughness
from pinotwin.solve.jackknife import jackknife
from pinotwin.units import of_axis

SLOWEST = 0.02  # Of the top speed: below it the direction of lost motion is not known
MOST_ROWS = 20_000
LATEST = 3.0  # Samples between two encoders on one clock, at most: what comes later is no delay between them
FINEST = 0.01
"""Of a stiffness or a lost motion: half its narrowest interval; filters alone move them by some 0.5 %."""
KNOTS = 13  # Places along the stroke at which its error is stated
FLEXIBLE = ("drive_flexibility", "joint_flexibility")
"""Effects of the effort that the second encoder measures: looked for elsewhere only where it sees them."""


@dataclass(frozen=True, eq=False)
class _Twist:
    """The twist of one axis on some rows, with the columns that it is made of."""

    d: Floats  # twist, shape (n,)
    parts: Mapping[str, Floats]  # name -> columns, each of shape (n, p)
    blocks: Sequence[slice]  # stretches
    rows: Ints  # rows of the motion
    knots: Floats  # places of the table [m or rad]
    noise: float  # of one row
    step: float  # sampling interval [s]
    travel: float  # of the load [m or rad]

    def table(self, names: Sequence[str]) -> Floats:
        """Return the columns of some parts side by side."""
        return np.hstack([self.parts[n] for n in names])

    def fit(self, names: Sequence[str]) -> Blocked:
        """Return the fit of the twist by named parts, within what a machine can have."""
        X = self.table(names)
        bounds = np.concatenate([self._bounds(n) for n in names], axis=1)
        size, held = np.sqrt(np.mean(X**2, axis=0)), np.zeros(X.shape[1])
        free = np.ones(X.shape[1], dtype=bool)
        while True:
            found = by_blocks(X[:, free], self.d - X @ held, self.blocks)
            theta, folds = held.copy(), np.tile(held, (len(found.folds), 1))
            theta[free], folds[:, free] = found.theta, found.folds
            nearest = np.clip(theta, *bounds)
            off = size * np.abs(theta - nearest) * free
            worst = int(np.argmax(off))
            if off[worst] == 0.0:
                return replace(found, theta=theta, folds=folds)
            free[worst], held[worst] = False, nearest[worst]

    def _bounds(self, name: str) -> Floats:
        """Return the least and the largest coefficients of a part, shape (2, p)."""
        least, most = {
            "lag": ([-LATEST * self.step], [LATEST * self.step]),
            "spring": ([0.0, -np.inf, -np.inf], [np.inf, 0.0, 0.0]),
            "lost": ([0.0], [np.inf]),
        }.get(name, ([-np.inf], [np.inf]))
        return np.array([least, most]) * np.ones(self.parts[name].shape[1])

    def reverse(self, names: Sequence[str]) -> tuple[float, float]:
        """Return the stiffness by which the effort is explained with the twist, and its 90 % half interval."""
        u, others = self.parts["spring"][:, 0], self.parts["spring"][:, 1:]
        rest = [self.parts[n] for n in names if n != "spring"]
        found = by_blocks(np.hstack([self.d[:, None], others, *rest]), u, self.blocks)
        return float(found.theta[0]), 1.645 * float(found.error[0])

    def at(self, names: Sequence[str], name: str) -> int:
        """Return the first column of a part among those of several."""
        return sum(self.parts[n].shape[1] for n in names[: names.index(name)])


NUISANCE = ("zero", "lag")
"""No finding: the offset of the zeros, and what goes with v (the instant of the two encoders, and behind a spring
the friction of the motor's side)."""
PARTS = ("spring", "lost", "table")


def _twist(motion: Motion, joint: int) -> _Twist | None:
    if motion.ql is None:
        return None
    q, ql, u = (x[:, joint] for x in (motion.q, motion.ql, motion.u))
    v, a = motion.v[:, joint], motion.a[:, joint]
    fast = np.abs(v) > SLOWEST * np.abs(v[motion.inside]).max(initial=0.0)
    rows = np.flatnonzero(motion.moving(joint) & np.isfinite(ql) & fast)
    rows = rows[:: max(1, len(rows) // MOST_ROWS)]
    if len(rows) < 200 or not np.ptp(ql[rows]) > 0.0:
        return None
    d, long = q - ql, [s for s in motion.segments if s.stop - s.start > 30]
    rate = np.zeros_like(d)
    for s in long:
        rate[s] = np.gradient(d[s], motion.step)
    x = ql[rows]
    places = np.linspace(x.min(), x.max(), KNOTS)
    hats = np.stack([np.interp(x, places, e) for e in np.eye(len(places))[1:]], axis=1)
    parts = {
        "zero": np.ones((len(rows), 1)),
        "lag": v[rows, None],
        "spring": np.stack([u[rows], a[rows], rate[rows]], axis=1),
        "lost": low_pass(np.sign(v)[:, None], 1.0 / motion.step, motion.cutoff, segments=long)[rows],
        "table": hats,
    }
    step = motion.step * max(1.0, len(motion) / len(rows))
    noise = roughness([d[s] for s in motion.segments if s.stop - s.start > 8] or [d])
    blocks, travel = blocks_of(len(rows), step), float(np.ptp(x))
    return _Twist(d[rows], parts, blocks, rows, places, noise, motion.step, travel)


@dataclass(frozen=True, eq=False)
class Seen:
    """What the second encoder of one axis says."""

    gap: Gap  # of its signal
    effects: Sequence[Found]  # causes that it measures
    where: Sequence[Region]  # regions in which the gap lies
    spring: bool  # whether the drive train was seen to give
    lost: bool  # whether there is lost motion
    notes: Sequence[str]  # what else is worth a line


def second_encoders(c: Comparison, rng: np.random.Generator) -> dict[str, Seen]:
    """Return what lies between motor and load by the load encoder of each axis; of a twin its own days tell."""
    axes = {} if c.change else {k: x.index for k, x in c.machine.axes.items() if k not in c.gate.remains}
    twists = {(k, j): _twist(c.new.motion, j) for k, j in axes.items()}
    return {k: _seen(c, k, j, twist, rng) for (k, j), twist in twists.items() if twist is not None}


def admitted(measured: Mapping[str, Seen], effect: str, axis: str | None) -> bool:
    """Whether an effect of the drive train is looked for in the effort: not where both encoders do not show it."""
    seen = measured.get(str(axis))
    if seen is None:
        return True
    if effect in FLEXIBLE:
        return seen.spring
    return seen.lost or effect != "backlash"


def with_encoders(
    named: Sequence[Found], measured: Mapping[str, Seen], leave_out: Sequence[str] = ()
) -> list[Found]:
    """Return the named effects with what the second encoders measure of them, and what they add."""
    out = list(named)
    for e in [x for seen in measured.values() for x in seen.effects if x.effect not in leave_out]:
        alike = FLEXIBLE if e.effect in FLEXIBLE else (e.effect,)
        at = next((k for k, x in enumerate(out) if x.axis == e.axis and x.effect in alike), None)
        if at is None:
            out.append(e)
        else:
            both = {**out[at].shrink, **e.shrink}
            out[at] = replace(out[at], size=[*e.size, *out[at].size], shrink=both)
    return out


def _seen(c: Comparison, name: str, joint: int, new: _Twist, rng: np.random.Generator) -> Seen:
    chosen, steps = _chosen(new)
    now, before = (*NUISANCE, *chosen), new.fit(NUISANCE)
    after = [before, *chosen.values()][-1]
    mass = c.new.motion.mass
    inertia = float("nan") if mass is None else float(np.mean(mass[:, joint, joint]))  # [kg or kg·m²]
    effects = []
    for part, (shrink, sure) in steps.items():
        names = now[: now.index(part) + 1]
        told = _Told(name, c.machine.rotary[joint], new, chosen[part], names, "table" in chosen)
        found = told.named(part, shrink, inertia, sure)
        effects.append(replace(found, shrink={"ql": stated_of(before.left, shrink)}))
    gap = Gap(before.left, before.left / max(new.travel, 1e-300), new.noise, min(after.left, before.left))
    cells = regimes(c.new.motion, new.rows, joint) if steps else []
    where = concentrated(cells, before.rest**2, name, "ql", rng)[:3] if cells else []
    return Seen(gap, effects, where, "spring" in steps, "lost" in steps, _notes(name, after, new))


def _chosen(new: _Twist) -> tuple[dict[str, Blocked], dict[str, tuple[Shrink, float]]]:
    """Return the parts that the twist has, most telling first, and what those that can be real close, and how surely.

    A part comes with the fit of it beside those before it.
    """
    chosen, steps, now = dict[str, Blocked](), dict[str, tuple[Shrink, float]](), new.fit(NUISANCE)
    while not set(PARTS) <= set(chosen):
        trials = {p: new.fit([*NUISANCE, *chosen, p]) for p in PARTS if p not in chosen}
        best = min(trials, key=lambda p: trials[p].left)
        fit = trials[best]
        closed = float(np.sqrt(max(now.left**2 - fit.left**2, 0.0)))
        before, after = drawn(now.powers, fit.powers)
        each = 1.0 - after / np.maximum(before, 1e-300)
        low, high = np.quantile(each, [0.05, 0.95]).tolist()
        share = 1.0 - (fit.left / max(now.left, 1e-300)) ** 2
        if share < RULES.encoder_share or low <= 0.0 or closed < new.noise:
            break
        chosen[best] = fit
        k = new.at([*NUISANCE, *chosen], best)  # springs and play are positive
        if best == "table" or fit.theta[k] > np.sqrt(RULES.encoder_strength) * fit.error[k]:
            told = Shrink(now.left, fit.left, share, (low, min(high, 1.0)), share, "held-out blocks")
            steps[best] = told, posterior(int(np.sum(each > RULES.encoder_share)), len(each))
        now = fit
    return chosen, steps


@dataclass(frozen=True, eq=False)
class _Told:
    """What the twist of one axis is said to be, in the machine's own numbers."""

    axis: str  # whose
    rotary: bool  # whether it turns
    new: _Twist  # its twist
    fit: Blocked  # what it is made of
    names: Sequence[str]  # parts of the fit: those found so far
    placed: bool  # whether there is an error along the stroke

    def named(self, part: str, shrink: Shrink, inertia: float, sure: float) -> Found:
        shape, unit = dict[str, float](), of_axis("x", self.rotary)
        if part == "spring":
            effect, sizes = FLEXIBLE[0], self._spring()
            shape = _mode(sizes[0].after, sizes[1].after, inertia - sizes[2].after)
        elif part == "lost":
            gap, error = (
                2.0 * float(x[self.new.at(self.names, "lost")]) for x in (self.fit.theta, self.fit.error)
            )
            half = max(1.645 * error, FINEST * abs(gap))
            effect, sizes = "backlash", [Size("backlash.gap", 0.0, gap, unit, (gap - half, gap + half))]
            shape = {"gap": sizes[0].after}
        else:
            effect, sizes = "encoder_error", self._table(unit)
        theta = {s.name.partition(".")[2]: s.after for s in sizes}
        return Found(effect, self.axis, sure, shape, theta, {"ql": shrink}, [], size=sizes, gain=shrink.share)

    def _spring(self) -> list[Size]:
        """Return stiffness, damping and rotor's inertia."""
        fit, at = self.fit, self.new.at(self.names, "spring")
        ranges = [_inverse(fit, at)]
        if self.placed:
            table = "table" in self.names
            more = [n for n in self.names if n != "table"] if table else [*self.names, "table"]
            ranges.append(_inverse(self.new.fit(more), self.new.at(more, "spring")))
        softest, half = self.new.reverse(self.names)
        ranges.append((max(softest - half, 0.0), softest + half))
        between = np.sqrt(max(softest, 0.0) * fit.theta[at])  # 1 where both agree
        rows = []
        for name, unit, i in (("stiffness", "F/x", 0), ("damping", "F·s/x", 2), ("rotor", "I", 1)):
            now, each = _physical(fit.theta, at, i), _physical(fit.folds, at, i)
            half = 1.645 * float(_errors(each))
            span = (max(float(now) - half, 0.0), float(now) + half)
            if i == 0:
                now = now * between if between > 0.0 else now
                low, high = min(r[0] for r in ranges), max(r[1] for r in ranges)
                span = (min(low, (1.0 - FINEST) * float(now)), max(high, (1.0 + FINEST) * float(now)))
            rows.append(Size(f"drive_flexibility.{name}", 0.0, float(now), of_axis(unit, self.rotary), span))
        return rows

    def _table(self, unit: str) -> list[Size]:
        """Return the largest error along the stroke, then the whole table, its mean taken off."""
        at = self.new.at(self.names, "table")
        now, error = _course(self.fit.theta, at), _errors(_course(self.fit.folds, at))
        labels = [f"at {x:.6g} {unit}" for x in self.new.knots]
        order = [int(np.argmax(np.abs(now))), *range(KNOTS)]
        return [
            sized(f"encoder_error.{name}", 0.0, now[k], unit, error[k])
            for name, k in zip(["largest", *labels], order, strict=True)
        ]


def _physical(theta: Floats, at: int, i: int) -> Floats:
    """Return stiffness (i = 0), rotor's inertia (1) or damping (2) from coefficients (..., p)."""
    yields = theta[..., at]
    return 1.0 / yields if i == 0 else -theta[..., at + i] / yields


def _errors(each: Floats) -> Floats:
    """Return standard errors from estimates without each block, shape (K, ...)."""
    return np.sqrt(np.diag(jackknife(each.reshape(len(each), -1)))).reshape(each.shape[1:])


def _course(theta: Floats, at: int) -> Floats:
    """Return the table in coefficients (..., p), its mean taken off, shape (..., KNOTS)."""
    x = np.concatenate([np.zeros((*theta.shape[:-1], 1)), theta[..., at : at + KNOTS - 1]], axis=-1)
    return np.asarray(x - x.mean(axis=-1, keepdims=True))


def _mode(k: float, damping: float, load: float) -> dict[str, float]:
    """Return the mode of the load with the motor held, as machine.yaml has it; empty where it is not known."""
    if not (k > 0.0 and load > 0.0):
        return {}
    w = np.sqrt(k / load)
    ratio = float(np.clip(0.5 * damping * w / k, 0.005, 0.7))
    return {"frequency": float(w / (2.0 * np.pi)), "damping": ratio}


def _inverse(fit: Blocked, at: int) -> tuple[float, float]:
    """Return the 90 % interval of a stiffness, of which the coefficient is the inverse."""
    y, half = float(fit.theta[at]), 1.645 * float(fit.error[at])
    if y + half <= 0.0:
        return 0.0, float("inf")
    return 1.0 / (y + half), (1.0 / (y - half) if y > half else float("inf"))


def _notes(axis: str, fit: Blocked, new: _Twist) -> list[str]:
    """Return the time between the two encoders where it is sure, longer than half a sample, and one that can be."""
    at = new.at(NUISANCE, "lag")
    lag, error = float(fit.theta[at]), float(fit.error[at])
    if abs(lag) < max(5.0 * error, 0.5 * new.step) or abs(lag) >= LATEST * new.step:
        return []
    how = "later" if lag > 0.0 else "earlier"
    return [
        f"{axis}.ql is taken {1e3 * abs(lag):.2f} ± {1e3 * error:.2f} ms {how} than {axis}.q: whatever goes with "
        "speed between motor and load (friction behind the spring) cannot be separated from that"
    ]
