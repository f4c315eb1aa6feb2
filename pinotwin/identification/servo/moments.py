r"""The gains of a controller from its own signals, by moments that noise and plant do not reach.

Least squares on effort, command and position are biased: the encoder's steps reach the effort and through the loop the
position again. An output error (:mod:`output_error`) takes up errors of the plant, of friction above all. With Z the
slopes of the law's effort on the *simulated* motion, which no noise of the log has reached,

    Z' (u - law(q, qr; x)) = 0

holds for the true law whatever the plant (instrumental variables in closed loop: Gilson and Van den Hof 2005,
Automatica 41). Dead time, and what the moments leave open, are the output error's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.identification.servo.law_alone import LawAlone
from pinotwin.identification.servo.output_error import Found, Search, polish, search_of
from pinotwin.identification.servo.problem import DRIVES, AxisProblem, Usual
from pinotwin.loop.servo import SHAPES, Servo

LATER = (0.7, 1.4)
"""Shares of the velocity's lag from which a cascade is searched: each way round it has one of its own."""


@dataclass(frozen=True)
class Solved:
    """Where the moments vanish."""

    servo: Servo  # the controller
    information: Floats  # of a search begun at the servo: R'R is the inverse of a covariance, shape (k, k)
    error: float  # sum of squares of the law's whitened error
    rows: int  # their number

    def worse(self, other: Solved) -> float:
        """Return how much larger the error is than another's, over its variance."""
        return (self.error / other.error - 1.0) * other.rows


def solve(  # noqa: PLR0913, its last numbers say when a search has ended
    law: LawAlone,
    start: Servo,
    usual: Usual,
    known: Sequence[Servo] = (),
    turns: int = 20,
    renewed: int = 4,
    close: float = 1e-4,
    rough: float = 1e-2,
    longest: float = 0.3,
) -> Solved | None:
    """Return the law of a form whose moments vanish, or None where the search ends at a known one, or not at all.

    Usual shapes hold what the moments leave open; dead time and offset stay. For ``renewed`` of at most ``turns``
    steps the instruments follow; then they stay: any near the answer are as good. A step is ``longest`` at most in
    units of the search, which ends at a ``close`` one; a last one beyond ``rough`` is no end.
    """
    search, x = search_of(start)
    (P, middle), servo, moved = _belief(search, usual), start, np.inf
    Z = law.instruments(search, x)
    for turn in range(turns):
        if 0 < turn < renewed:
            Z = law.instruments(search, x)
        r = law.left(search.servo(x))
        A, W = Z.T @ Z, np.linalg.pinv(_scatter(Z, r, law), hermitian=True)
        try:
            move = np.linalg.solve(P + A.T @ W @ A, A.T @ W @ (Z.T @ r) - P @ (x - middle))
        except np.linalg.LinAlgError:  # windows between holes that tell nothing of a gain
            return None
        x = x + move * min(1.0, longest / max(float(np.abs(move).max()), 1e-300))
        if not np.isfinite(x).all():
            return None
        servo = search.servo(x)
        lags = {x: getattr(servo, x) / law.clock.h for x in SHAPES}  # far below the clock they make none
        moved = float(np.abs(move * [min(1.0, lags.get(name, 1.0)) for name in search.names]).max())
        if moved < close:
            break
        if any(_same(servo, other, 0.01) for other in known):
            return None
    if moved > rough:
        return None
    r = law.left(servo)
    Z = law.instruments(*search_of(servo))
    A, W = Z.T @ Z, np.linalg.pinv(_scatter(Z, r, law), hermitian=True)
    size, axes = np.linalg.eigh(A.T @ W @ A)
    root = np.sqrt(np.maximum(size, 0.0))[:, None] * axes.T
    return Solved(servo, root, float(r @ r), len(r))


def _scatter(Z: Floats, r: Floats, law: LawAlone, seconds: float = 0.2) -> Floats:
    """Return the covariance of Z' r from the sums of blocks of a length, whose scores count as independent, (k, k)."""
    block = max(1, int(seconds / law.clock.step))
    sums = np.add.reduceat(Z * r[:, None], np.arange(0, len(r), block))
    return np.asarray(sums.T @ sums)


def _belief(search: Search, usual: Usual) -> tuple[Floats, Floats]:
    """Return precision (k, k) and middle (k,) of what is believed of a search before the log, in its units."""
    precision, middle = np.full(len(search.names), 1e-8), np.zeros(len(search.names))
    for k, (name, begun) in enumerate(zip(search.names, search.scale, strict=True)):
        if name in ("dead", "offset"):
            precision[k] = 1.0
        elif name in usual:
            precision[k], middle[k] = 1.0 / usual[name][1] ** 2, np.log(usual[name][0] / begun)
    return np.diag(precision), middle


def answers(law: LawAlone, servo: Servo, usual: Usual) -> list[Solved]:
    """Return the laws of a form whose moments vanish, the least error first; of a cascade either way round."""
    begun = [servo]
    if servo.form == "cascade":
        free = solve(law, replace(servo, form="general"), usual)
        begun += [] if free is None else _cascades(free.servo)
    found: list[Solved] = []
    for start in begun:
        known = [f.servo for f in found]
        answer = solve(law, start, usual, known)
        if answer is not None and not any(_same(answer.servo, other) for other in known):
            found.append(answer)
    return sorted(found, key=lambda f: f.error)


def _cascades(servo: Servo) -> list[Servo]:
    """Return cascades of set-point weight 1 near a law, either way round, with two lags of the velocity each."""
    kept = {k: getattr(servo, k) for k in ("output_lag", "notch", "dead", "step")}
    ways = servo.cascades()
    if len(ways) == 2 and abs(ways[0]["rate"] - ways[1]["rate"]) < 0.01 * ways[0]["rate"]:  # a double root
        ways = ways[:1]
    named = [{k: x for k, x in c.items() if k != "weight"} for c in ways]
    return [Servo.of_cascade(**c, velocity_lag=f * servo.velocity_lag, **kept) for c in named for f in LATER]


def _same(a: Servo, b: Servo, apart: float = 0.04) -> bool:
    """Whether two cascades are one answer: kp and 1/ti alike."""
    x, y = a.named(), b.named()
    return all(abs(x[k] - y[k]) < apart * abs(y[k]) for k in ("kp", "rate") if k in x)


def by_moments(p: AxisProblem, near: Servo, tells: float = 25.0, steps: int = 12) -> list[Found]:
    """Return the controller that the moments speak for, after it what they speak for as well; or none.

    Two ways round of kp and 1/ti are ordered with the output error, which settles in ``steps`` what the moments leave
    open (:func:`beside_moments`); ``near`` is its own law, whose form is kept. A rise of the whitened squared error
    over its variance by ``tells`` puts an answer out.
    """
    near = _without_feedforward(p, near, tells, steps) or near
    law, q = LawAlone.of(p, near), beside_moments(p)
    solved = [] if law is None else answers(law, near, DRIVES)
    likely = [s for s in solved if s.worse(solved[0]) < tells]
    found = [(s, polish(q, s.servo, steps=steps, known=s.information)) for s in likely]

    def doubt(s: Solved, f: Found) -> float:
        return s.worse(solved[0]) + f.cost * len(f.residual) / (2.0 * p.correlated)

    kept = [(doubt(s, f), f) for s, f in found if f is not None and p.holds(f.servo)]
    return [f for _, f in sorted(kept, key=lambda pair: pair[0])]


def _without_feedforward(p: AxisProblem, near: Servo, tells: float, steps: int) -> Servo | None:
    """Return a proportional law without feed-forward, which takes part of both gains; None where its error needs it."""
    e, _, v, *forward = near.gains
    if near.form != "proportional" or not any(forward):
        return None
    bare = polish(p, replace(near, gains=(e, 0.0, v, 0.0, 0.0, 0.0)), steps=steps)
    law = None if bare is None else LawAlone.of(p, bare.servo)
    if bare is None or law is None:
        return None
    plain, ahead = (solve(law, s, DRIVES) for s in (bare.servo, near))
    r = law.left(near)
    least = min(float(r @ r), np.inf if ahead is None else ahead.error)
    told = plain is not None and (plain.error / least - 1.0) * plain.rows < tells
    return bare.servo if told else None


def beside_moments(p: AxisProblem, share: float = 30.0) -> AxisProblem:
    """Return the axis with the output error's covariance counted as more: the plant's errors are not scatter."""
    return replace(p, noise=np.sqrt(share) * p.noise)
