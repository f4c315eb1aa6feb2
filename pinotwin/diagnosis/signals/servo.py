r"""The controller's law, held against the twin's own logs: gains, feed-forward, a drive at its limit.

Most laws of motion control are linear in e = q_r - q, int e, v, v_r, a_r, q_r and a constant of every stretch, without
the plant. One is fitted to the twin's own logs and to the new ones by the same columns; where it does not hold on the
own logs it says nothing, and where it still holds on the new ones nothing in the servo has changed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.diagnosis.search.injections import posterior
from pinotwin.diagnosis.search.trials import TRIALS, shuffled
from pinotwin.diagnosis.signals.limits import exceeded, reached
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.solve.jackknife import block_sums, jackknife, solved, without_each
from pinotwin.twin import Twin

FEATURES = ("e", "int e", "v", "v_r", "a_r", "q_r")
FEEDBACK = ("e", "int e", "v", "v_r", "q_r")
FORWARD = ("a_r",)


@dataclass(frozen=True)
class ServoChange:
    """A change of one axis' servo."""

    effect: str  # ``feedforward``, ``loop_gain`` or ``saturation``
    axis: str
    name: str  # of the number that changed. before: its value. after: its value
    before: float
    after: float
    interval: tuple[float, float]  # 90 % interval of ``after``
    unit: str  # of that number
    share: float  # of the law's squared residual that it closes on blocks that were not fitted
    gap: tuple[float, float]  # RMS of the law's residual before and after [N or N·m]
    # share of trials that name it again: of a law, changed laws put into stretches of what the law leaves anyway;
    # of a limit, logs from which a stretch was left out
    confidence: float = 0.0


def servo_changes(
    comparison: Comparison,
    explained: Collection[str],
    leave_out: Collection[str] = (),
    rules: Rules = RULES,
    courses: Mapping[int, Floats] | None = None,
) -> list[ServoChange]:
    """Return what has changed in the servo of every axis; of a machine only the limits are looked at.

    Laws of axes whose logged effort was ``explained`` as scaled or late are not judged. ``courses``: joint -> what the
    named causes put into its logged effort, (n,): a law that holds once it is taken off has not changed either.
    """
    out = []
    motion = comparison.new.motion
    if motion.qr is None:
        return []
    for axis in comparison.machine.axes.values():
        if not comparison.gate.asks("servo", axis.name):
            continue
        usual = _own_error(comparison, axis.index)
        asked = partial(_asked, comparison.twin, axis.index)
        limited = reached([motion], axis.index, usual, asked)
        before = None if comparison.own is None else reached([comparison.own.motion], axis.index)
        if limited is not None and exceeded(_logged(comparison, axis.name), limited.level):
            limited = None
        if limited is not None and before is None and "saturation" not in leave_out:
            parts = _without_stretches(motion)
            again = [reached(part, axis.index, usual, asked) is not None for part in parts]
            sure = posterior(sum(again), len(again), rules)
            out.append(_limit(axis.name, axis.rotary, limited.level, limited.share, sure))
            continue
        if comparison.own is None or comparison.own.motion.qr is None or axis.name in explained:
            continue
        course = (courses or {}).get(axis.index)
        change = _law_change(comparison, axis.index, axis.name, rules, course)
        if change is not None and change.effect not in leave_out:
            out.append(change)
    return out


def _asked(twin: Twin, joint: int, motion: Motion) -> Floats:
    """Return the effort that the command of a motion asks of a drive: that of the twin if it were followed, (n,)."""
    pairs = ((motion.qr, motion.q), (motion.vr, motion.v), (motion.ar, motion.a))
    q, v, a = (measured if r is None else np.where(np.isfinite(r), r, measured) for r, measured in pairs)
    return np.asarray(twin.effort(replace(motion, q=q, v=v, a=a))[:, joint])


def _own_error(c: Comparison, joint: int) -> float:
    """Return the RMS of the tracking error on the twin's own logs; infinite where none tell it."""
    if c.own is None or c.own.motion.qr is None:
        return np.inf
    return max(rms(c.own.motion.error[:, joint]), 1e-300)


def _limit(axis: str, rotary: bool, level: float, share: float, sure: float) -> ServoChange:
    span, unit = (0.98 * level, 1.02 * level), "N·m" if rotary else "N"
    return ServoChange("saturation", axis, "limit", np.inf, level, span, unit, share, (0.0, 0.0), sure)


def _without_stretches(motion: Motion) -> list[list[Motion]]:
    """Return what is left of a motion when each of :data:`TRIALS` stretches is left out."""
    edges = np.linspace(0, len(motion), TRIALS + 1).astype(int)
    parts = [motion.cut(int(a), int(b)) for a, b in pairwise(edges)]
    return [[p for p in parts if p is not out] for out in parts]


@dataclass(frozen=True)
class _Decided:
    """What the law says of a servo: the effect, the gains that changed, what is left before and after."""

    effect: str
    names: Sequence[str]
    level: float
    left: float


def _decided(new: Law, gains: Floats, held: float, rules: Rules) -> _Decided | None:
    """Return how a law on new logs differs from that on the twin's own; None where it holds or the plant changed."""
    plain = new.left(gains)
    level = rms(plain)
    if level < rules.law_level * new.size:
        return None
    faint, scaled = level < rules.law_worse * held, new.scaled(gains)
    forward, feedback = (new.refitted(plain, which) for which in (FORWARD, FEEDBACK))
    if faint:
        ahead = _share(forward, level) > rules.law_part and forward < min(feedback, scaled)
    else:
        ahead = level**2 - forward**2 > rules.law_forward * (level**2 - held**2)
    if ahead:
        return _Decided("feedforward", FORWARD, level, forward)
    if scaled < rules.law_scaled * feedback and scaled < rules.law_holds * new.size:
        return None  # feedback and feed-forward went along with a load: its cause is in the plant
    least = rules.law_part if faint else rules.law_share
    if _share(feedback, level) > least and feedback < rules.law_worse * held:
        return _Decided("loop_gain", FEEDBACK, level, feedback)
    if faint:
        return None
    return _Decided("saturation", (), level, feedback) if level > rules.law_broken * new.size else None


def _share(left: float, level: float) -> float:
    return 1.0 - (left / level) ** 2


SAID = {"feedforward": "acceleration feed-forward", "loop_gain": "feedback gains"}


def broken_laws(c: Comparison, told: Collection[str], rules: Rules = RULES) -> dict[str, str]:
    """Return axis -> what is said of its controller where its law is gone, and nothing in the catalogue says why.

    An integrator that the controller limits leaves no plateau in the effort, but many times the law's effort.
    """
    out = {}
    for axis in c.machine.axes.values():
        if axis.name in told or axis.name in c.gate.strays or not c.gate.asks("servo", axis.name):
            continue
        laws = _laws(c, axis.index, rules)
        if laws is None:
            continue
        old, new, gains, rest = laws
        if _unsure(old, new, rules):
            continue
        times = rms(new.left(gains)) / new.size
        if times > max(rules.law_gone, rules.law_worse * rms(rest) / new.size):
            out[axis.name] = (
                f"has another control law than on the twin's data. Its gains miss the effort by {times:.2g} "
                "times its variation, as where a limit inside the controller stops an integrator"
            )
    return out


def _laws(c: Comparison, joint: int, rules: Rules) -> tuple[Law, Law, Floats, Floats] | None:
    """Return the law on own and new logs, the own gains and what they leave there; None where it says nothing."""
    if c.own is None or c.new.motion.qr is None:
        return None
    old, new = (Law.of(x.motion, joint) for x in (c.own, c.new))
    if old is None or new is None:
        return None
    gains, rest = old.fitted()
    return None if rms(rest) > rules.law_holds * old.size else (old, new, gains, rest)


def _unsure(old: Law, new: Law, rules: Rules) -> bool:
    """Whether the gains of the own logs are known too badly to say what they make of the new motion."""
    return old.unsure(new) > rules.law_unsure * new.size


def _law_change(
    c: Comparison, joint: int, axis: str, rules: Rules, course: Floats | None
) -> ServoChange | None:
    laws = _laws(c, joint, rules)
    if laws is None:
        return None
    old, new, gains, rest = laws
    held = rms(rest)
    found = _decided(new, gains, held, rules)
    less = None if course is None else Law.of(c.new.motion, joint, course)
    if found is not None and less is not None and rms(less.left(gains)) < found.level:
        new, found = less, _decided(less, gains, held, rules)
    if found is None:
        return None
    if found.effect == "saturation":
        return _saturation(c, joint, axis, rules)
    if axis in c.gate.strays or _unsure(old, new, rules):
        return None
    factor, error = new.factor(new.left(gains), gains, found.names)
    interval = turned(found.effect, factor, error, old.factor(rest, gains, found.names)[1], rules)
    if interval is None:
        return None
    share = _share(found.left, found.level)
    said = new.columns @ new.changed(gains, found.names)
    rng = np.random.default_rng(joint)
    size = max(1, round(1.0 / c.new.motion.step))
    wins = 0
    for _ in range(TRIALS):
        again = _decided(replace(new, u=said + shuffled(rest, len(said), size, rng)), gains, held, rules)
        wins += again is not None and again.effect == found.effect
    sure = posterior(wins, TRIALS, rules)
    gap, name = (found.level, found.left), SAID[found.effect]
    return ServoChange(found.effect, axis, name, 1.0, factor, interval, "of what it was", share, gap, sure)


def turned(
    effect: str, factor: float, error: float, known: float, rules: Rules
) -> tuple[float, float] | None:
    """Return the 90 % interval of a factor on gains; None where it holds 1, is not worth a word, or changes sign."""
    half = 1.645 * float(np.hypot(error, known))
    possible = effect == "feedforward" or factor > 0.0
    changed = abs(factor - 1.0) >= np.maximum(rules.law_turned, half)
    return (factor - half, factor + half) if possible and changed else None


def _saturation(c: Comparison, joint: int, axis: str, rules: Rules) -> ServoChange | None:
    """Return a limit where no gains bring the law back and the effort rests at its largest, or the axis runs off."""
    assert c.own is not None
    new, own = c.new.motion, c.own.motion
    strays = axis in c.gate.strays
    top = _rests([new], [own], joint, rules, strays=strays)
    if top is None or exceeded(_logged(c, axis), top):
        return None
    again = [_rests(part, [own], joint, rules, strays=strays) is not None for part in _without_stretches(new)]
    return _limit(axis, new.rotary[joint], top, 1.0, posterior(sum(again), len(again), rules))


def _rests(
    new: Sequence[Motion], own: Sequence[Motion], joint: int, rules: Rules, *, strays: bool
) -> float | None:
    """Return the largest effort, where it rests there longer than on the own logs or the axis runs off; else None."""
    errors = [
        rms(np.concatenate([m.error[:, joint] for m in part if m.qr is not None])) for part in (new, own)
    ]
    sizes = [np.abs(np.nan_to_num(np.concatenate([m.u[:, joint] for m in part]))) for part in (new, own)]
    rests = [float(np.mean(x > 0.97 * np.quantile(x, 0.999))) for x in sizes]
    top, before = (float(np.quantile(x, 0.999)) for x in sizes)
    off = errors[0] >= rules.left_behind * errors[1] and (top < rules.less_than_before * before or not strays)
    return top if off or rests[0] >= rules.at_limit * rests[1] else None


def _logged(c: Comparison, axis: str) -> list[Floats]:
    """Return the efforts of an axis as they were logged; none where they are those of motors."""
    logs = (*c.logs, *c.validation) if c.machine.transmission is None else ()
    return [one.log[f"{axis}.u"] for one in logs if f"{axis}.u" in one.log]


@dataclass(frozen=True, eq=False)
class Law:
    """The columns of the law on one motion, constants of its stretches taken out."""

    columns: Floats
    u: Floats
    blocks: Sequence[slice]
    size: float

    @classmethod
    def of(cls, motion: Motion, joint: int, course: Floats | None = None) -> Law | None:
        """Return the law on one motion, a course (n,) taken off its effort; None where it cannot be fitted."""
        if motion.qr is None or motion.vr is None or motion.ar is None:
            return None
        parts, efforts = [], []
        for s in motion.segments:
            e = motion.error[s, joint]
            table = [
                e,
                np.cumsum(e) * motion.step,
                motion.v[s, joint],
                motion.vr[s, joint],
                motion.ar[s, joint],
                motion.qr[s, joint],
            ]
            u = motion.u[s, joint] - (0.0 if course is None else course[s])
            if not np.isfinite(u).all():
                return None
            x = np.stack(table, axis=1)
            parts.append(x - x.mean(axis=0))
            efforts.append(u - u.mean())
        columns, u = np.concatenate(parts), np.concatenate(efforts)
        if not np.ptp(u) or not np.ptp(columns[:, 3]):
            return None
        count = int(np.clip(len(u) * motion.step / 0.5, 6, 40))
        edges = np.linspace(0, len(u), count + 1).astype(int)
        blocks = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        return cls(columns, u, blocks, float(np.std(u)))

    def fitted(self) -> tuple[Floats, Floats]:
        """Return the gains, and what the law leaves of each row of blocks that were not fitted, shape (n,)."""
        each, left = self._whole
        return each[-1], left

    @cached_property
    def _whole(self) -> tuple[Floats, Floats]:
        """All gains without each block and last with all blocks, and what is left held out."""
        return self._without_each(range(self.columns.shape[1]), self.u)

    def unsure(self, other: Law) -> float:
        """Return the standard error of the effort that this law foretells on another motion, RMS."""
        covariance = jackknife(self._whole[0][:-1])
        variance = np.einsum("ij,jk,ik->i", other.columns, covariance, other.columns)
        return float(np.sqrt(np.mean(np.maximum(variance, 0.0))))

    def changed(self, gains: Floats, names: Sequence[str]) -> Floats:
        """Return gains from elsewhere with some of them as they are here."""
        which = [FEATURES.index(x) for x in names]
        out = gains.copy()
        out[which] += self._without_each(which, self.left(gains))[0][-1]
        return out

    def _without_each(self, which: Sequence[int], y: Floats) -> tuple[Floats, Floats]:
        """Return gains of some columns without each block and last with all, and what is left held out."""
        X = self.columns[:, list(which)]
        N, g = block_sums(X, y, self.blocks)
        each = solved(without_each(N), without_each(g), 1e-9)
        left = y.copy()
        for b, gains in zip(self.blocks, each[:-1], strict=True):
            left[b] = y[b] - X[b] @ gains
        return each, left

    def left(self, gains: Floats) -> Floats:
        """Return what the law leaves with gains from elsewhere."""
        return self.u - self.columns @ gains

    def scaled(self, gains: Floats) -> float:
        """Return what the law leaves if all its gains are multiplied by the factor that suits best."""
        said = self.columns @ gains
        factor = float(said @ self.u) / max(float(said @ said), 1e-300)
        return rms(self.u - factor * said)

    def factor(self, plain: Floats, gains: Floats, names: Sequence[str]) -> tuple[float, float]:
        """Return the common factor on some gains that closes most of what is left, and its standard error."""
        which = [FEATURES.index(x) for x in names]
        said = self.columns[:, which] @ gains[which]
        own = np.array([said[b] @ said[b] for b in self.blocks])
        both = np.array([said[b] @ plain[b] for b in self.blocks])
        each = (both.sum() - both) / np.maximum(own.sum() - own, 1e-300)
        error = float(np.sqrt(jackknife(each[:, None])[0, 0]))
        return 1.0 + float(both.sum() / max(own.sum(), 1e-300)), error

    def refitted(self, plain: Floats, names: Sequence[str]) -> float:
        """Return what is left, held out, with the change of some gains that closes most."""
        which = [FEATURES.index(x) for x in names]
        return rms(self._without_each(which, plain)[1])
