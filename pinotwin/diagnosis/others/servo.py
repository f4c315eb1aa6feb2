r"""The controller's law, held against the twin's own logs: gains, feed-forward, a drive at its limit.

Inverse dynamics holds whatever the controller does. Its law relates command, position and effort without
the plant. Most laws of motion control are linear in

    e, int e, v, v_r, a_r, q_r and a constant of every stretch of the log

with e = q_r - q. The law is fitted to the twin's own logs and to the new ones by the same columns; where
it does not hold on the own logs it says nothing, and where it still holds on the new ones nothing in the
servo has changed, whatever the plant does.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.others.limits import reached
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.motion import Motion
from pinotwin.signals import rms

FEATURES = ("e", "int e", "v", "v_r", "a_r", "q_r")
FEEDBACK = ("e", "int e", "v", "v_r")
FORWARD = ("a_r",)


@dataclass(frozen=True)
class ServoChange:
    """A change of one axis' servo.

    Attributes:
        effect: ``feedforward``, ``loop_gain`` or ``saturation``.
        axis: whose.
        name: of the number that changed. before: its value. after: its value.
        interval: 90 % interval of ``after``.
        unit: of that number.
        share: of the law's squared residual that it closes on blocks that were not fitted.
        gap: RMS of the law's residual before and after [N or N·m].
    """

    effect: str
    axis: str
    name: str
    before: float
    after: float
    interval: tuple[float, float]
    unit: str
    share: float
    gap: tuple[float, float]


def servo_changes(
    comparison: Comparison, explained: Collection[str], leave_out: Collection[str] = (), rules: Rules = RULES
) -> list[ServoChange]:
    """Return what has changed in the servo of every axis.

    Args:
        comparison: a twin with its own logs and new ones; of a machine only the limits are looked at.
        explained: axes whose logged effort was found scaled or late: their laws are not judged.
        leave_out: effects that are not named.
        rules: thresholds.
    """
    out = []
    motion = comparison.new.motion
    if motion.qr is None:
        return []
    for axis in comparison.machine.axes.values():
        limited = reached([motion], axis.index)
        before = None if comparison.own is None else reached([comparison.own.motion], axis.index)
        if limited is not None and before is None and "saturation" not in leave_out:
            unit = "N·m" if axis.rotary else "N"
            spread = (0.98 * limited.level, 1.02 * limited.level)
            out.append(
                ServoChange(
                    "saturation",
                    axis.name,
                    "limit",
                    np.inf,
                    limited.level,
                    spread,
                    unit,
                    limited.share,
                    (0.0, 0.0),
                )
            )
            continue
        if comparison.own is None or comparison.own.motion.qr is None or axis.name in explained:
            continue
        change = _law_change(comparison, axis.index, axis.name, rules)
        if change is not None and change.effect not in leave_out:
            out.append(change)
    return out


def _law_change(c: Comparison, joint: int, axis: str, rules: Rules) -> ServoChange | None:
    assert c.own is not None
    old = _Law.of(c.own.motion, joint)
    new = _Law.of(c.new.motion, joint)
    if old is None or new is None:
        return None
    if _left_behind(c, joint, rules):
        level = float(np.quantile(np.abs(c.new.motion.u[:, joint]), 0.999))
        unit = "N·m" if c.new.motion.rotary[joint] else "N"
        return ServoChange(
            "saturation", axis, "limit", np.inf, level, (0.98 * level, 1.02 * level), unit, 1.0, (0.0, 0.0)
        )
    gains, held = old.fitted()
    if held > rules.law_holds * old.size:
        return None  # this law is not that controller's
    plain = new.left(gains)
    level = rms(plain)
    if level < rules.law_worse * held:
        return None
    found = []
    for effect, names in (("feedforward", FORWARD), ("loop_gain", FEEDBACK)):
        which = [FEATURES.index(x) for x in names]
        column = new.columns[:, which] @ gains[which]
        factor, error, after = new.scaled(plain, column)
        found.append((1.0 - float(np.mean(after**2) / np.mean(plain**2)), effect, 1.0 + factor, error, after))
    share, effect, factor, error, after = max(found)
    if share < rules.law_share:
        return None
    interval = (factor - 1.645 * error, factor + 1.645 * error)
    name = "acceleration feed-forward" if effect == "feedforward" else "feedback gains"
    return ServoChange(
        effect, axis, name, 1.0, factor, interval, "of what it was", share, (level, rms(after))
    )


def _left_behind(c: Comparison, joint: int, rules: Rules) -> bool:
    """Whether an axis falls far behind its command while its effort rests at its largest size."""
    assert c.own is not None
    new, own = c.new.motion, c.own.motion
    errors = [rms(m.qr[:, joint] - m.q[:, joint]) for m in (new, own) if m.qr is not None]
    size = np.abs(np.nan_to_num(new.u[:, joint]))
    top = float(np.quantile(size, 0.999))
    before = np.abs(np.nan_to_num(own.u[:, joint]))
    at = float(np.mean(size > 0.97 * top))
    usual = float(np.mean(before > 0.97 * np.quantile(before, 0.999)))
    return errors[0] > rules.left_behind * errors[1] and at > max(rules.at_limit, 2.0 * usual)


@dataclass(frozen=True, eq=False)
class _Law:
    """The columns of the law on one motion, constants of its stretches taken out."""

    columns: Floats
    u: Floats
    blocks: Sequence[slice]
    size: float

    @classmethod
    def of(cls, motion: Motion, joint: int) -> _Law | None:
        if motion.qr is None or motion.vr is None or motion.ar is None:
            return None
        parts, efforts = [], []
        for s in motion.segments:
            e = motion.qr[s, joint] - motion.q[s, joint]
            table = [
                e,
                np.cumsum(e) * motion.step,
                motion.v[s, joint],
                motion.vr[s, joint],
                motion.ar[s, joint],
                motion.qr[s, joint],
            ]
            u = motion.u[s, joint]
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

    def fitted(self) -> tuple[Floats, float]:
        """Return the gains, and what the law leaves of blocks that were not fitted."""
        scale = np.maximum(self.columns.std(axis=0), 1e-300)
        X = self.columns / scale
        N, g = X.T @ X, X.T @ self.u
        ridge = 1e-9 * len(X) * np.eye(X.shape[1])
        left = np.empty_like(self.u)
        for b in self.blocks:
            theta = np.linalg.solve(N - X[b].T @ X[b] + ridge, g - X[b].T @ self.u[b])
            left[b] = self.u[b] - X[b] @ theta
        return np.linalg.solve(N + ridge, g) / scale, rms(left)

    def left(self, gains: Floats) -> Floats:
        """Return what the law leaves with gains from elsewhere."""
        return self.u - self.columns @ gains

    def scaled(self, plain: Floats, column: Floats) -> tuple[float, float, Floats]:
        """Return the factor on a part of the law that closes most, its error, and what is left held out."""
        xx = np.array([column[b] @ column[b] for b in self.blocks])
        xr = np.array([column[b] @ plain[b] for b in self.blocks])
        each = (xr.sum() - xr) / np.maximum(xx.sum() - xx, 1e-300)
        after = plain.copy()
        for b, f in zip(self.blocks, each, strict=True):
            after[b] = plain[b] - f * column[b]
        K = len(each)
        error = float(np.sqrt((K - 1) / K * np.sum((each - each.mean()) ** 2)))
        return float(xr.sum() / max(xx.sum(), 1e-300)), error, after


def at_limit_rows(motion: Motion, joint: int) -> Mask | None:
    """Return the rows in which a drive stands at its limit, None if it never does."""
    found = reached([motion], joint)
    return None if found is None else found.samples[0]
