"""Which effects: every candidate judged jointly with the base on data it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.admission import RARE, Judged, Key, admit, measured
from pinotwin.diagnosis.bank import Batch, Shelf, shelf, stacked
from pinotwin.diagnosis.catalogue.events import find_events, pushes
from pinotwin.diagnosis.catalogue.position import modulated
from pinotwin.diagnosis.context import Context, Family, Shape
from pinotwin.diagnosis.ledger import Ledger, build_ledger, residual_of, sums
from pinotwin.diagnosis.worth import Worth, worth

LEAST_SHARE = 2e-4  # of a candidate's columns that the base must leave open
LEAST_SHARE_OF_POSITION = 0.01  # the same where a table interpolates between its knots
POSITION = ("ripple", "ripple_modulated", "position_table")
PEAKS = 2  # pitches of a plain ripple at which a modulated one is tried


@dataclass(frozen=True)
class Screened:
    """All families judged on one stage.

    Attributes:
        judged: best first.
        keys: of every family, in the order of ``tops``.
        tops: largest gain of every family in every draw, shape (families, draws).
    """

    judged: tuple[Judged, ...]
    keys: tuple[Key, ...]
    tops: Floats

    def threshold(self, alpha: float, columns: slice = slice(None)) -> float:
        """Return the gain that the best of all families exceeds with a probability in healthy draws."""
        return _extreme(self.tops[:, columns].max(axis=0), alpha)

    def thresholds(self, alpha: float) -> dict[str | None, float]:
        """Return the same per axis, the probability shared out among them.

        What one axis leaves open must not hide the effect of another.
        """
        axes = sorted({axis for _, axis in self.keys}, key=str)
        own = {a: [k for k, (_, axis) in enumerate(self.keys) if axis == a] for a in axes}
        return {a: _extreme(self.tops[own[a]].max(axis=0), alpha / len(axes)) for a in axes}


def _extreme(null: Floats, alpha: float) -> float:
    """Return what largest gains exceed with a probability: a Gumbel law by its moments."""
    beta = float(np.std(null)) * np.sqrt(6.0) / np.pi
    fitted = float(np.mean(null)) - 0.5772 * beta - beta * np.log(-np.log(1.0 - alpha))
    return max(fitted, 8.0)


@dataclass(frozen=True)
class Settings:
    """How a search decides.

    Attributes:
        draws: healthy draws for the threshold.
        injections: effects put into healthy draws, for the confidence.
        alpha: probability that a healthy machine exceeds the threshold.
        most: most effects that are named.
        leave_out: effects that are not considered.
        seed: of the draws.
    """

    draws: int = 160
    injections: int = 200
    alpha: float = 0.02
    most: int = 3
    leave_out: frozenset[str] = frozenset()
    seed: int = 0


def screen(
    context: Context,
    shelves: Sequence[Shelf],
    ledger: Ledger,
    settings: Settings,
    taken: Sequence[Key] = (),
) -> Screened:
    """Judge every family of the catalogue on a ledger.

    Args:
        context: what candidates are made from.
        shelves: the bank.
        ledger: of the base with what was admitted already, drawn efforts included.
        settings: see :class:`Settings`.
        taken: effects already admitted; they are not judged again.
    """
    judged: list[Judged] = []
    tops: list[Floats] = []

    def take(found: tuple[Judged, Floats] | None) -> None:
        if found is not None and found[0].key not in taken:
            judged.append(found[0])
            tops.append(found[1])

    for s in shelves:
        if s.family.key not in taken or s.family.effect == "ripple":
            worths = [b.worth(ledger) for b in s.batches]
            take(_best(context, s.family, s.batches, worths))
            if s.family.effect == "ripple" and "ripple_modulated" not in settings.leave_out:
                take(_modulated(context, ledger, s, worths))
    if "external_force" not in settings.leave_out:
        for axis, joint in _axes(context):
            if ("external_force", axis) not in taken:
                take(_pushed(context, ledger, axis, joint))
    order = np.argsort([-j.G for j in judged], kind="stable")
    return Screened(
        tuple(judged[k] for k in order),
        tuple(judged[k].key for k in order),
        np.array([tops[k] for k in order]),
    )


def _axes(context: Context) -> list[tuple[str, int]]:
    seen = {c.joint for c in context.rows.channels}
    return [(a.name, a.index) for a in context.machine.axes.values() if a.index in seen]


def _modulated(
    context: Context, ledger: Ledger, plain: Shelf, worths: Sequence[Worth]
) -> tuple[Judged, Floats] | None:
    joint = context.machine.axis(str(plain.family.axis)).index
    if not context.machine.rotary[joint]:
        return None
    gain = np.concatenate([w.gain[:, 0] for w in worths])
    padded = np.concatenate([[-1.0], gain, [-1.0]])
    peaks = np.flatnonzero((gain >= padded[:-2]) & (gain > padded[2:]))
    best = peaks[np.argsort(gain[peaks])[::-1][:PEAKS]]
    family = modulated(plain.family, joint, [plain.family.shapes[k]["period"] for k in best])
    return judge(context, ledger, shelf(context, ledger.stage, family))


def _pushed(context: Context, ledger: Ledger, axis: str, joint: int) -> tuple[Judged, Floats] | None:
    events, price, top = find_events(ledger, joint)
    if not events:
        return None
    found, _ = judge(
        context, measured(ledger), shelf(context, ledger.stage, pushes(axis, joint, events, price))
    )
    # A push stands out of what is left elsewhere, once the base is fitted beside it.
    level = _spread_beside(ledger, found, joint)
    return replace(found, G=found.G - found.gain * (1.0 - 1.0 / level**2)), top


def _spread_beside(ledger: Ledger, found: Judged, joint: int) -> float:
    """Return the robust size of what is left of a joint beside an effect, in units of the noise."""
    under = admit(ledger.stage, [found])
    theta = build_ledger(under).theta
    left = [np.abs(residual_of(p, theta)) for p in under.pieces if p.channel.joint == joint]
    return max(1.4826 * float(np.median(np.concatenate(left))), 1.0)


def judge(context: Context, ledger: Ledger, s: Shelf) -> tuple[Judged, Floats]:
    """Return the best of a family and, per draw, the largest gain in it."""
    worths = [b.worth(ledger) for b in s.batches]
    return _best(context, s.family, s.batches, worths)


def _best(
    context: Context, family: Family, batches: Sequence[Batch], worths: Sequence[Worth]
) -> tuple[Judged, Floats]:
    least = LEAST_SHARE_OF_POSITION if family.effect in POSITION else LEAST_SHARE
    price = family.price + RARE.get(family.effect, 0.0)
    top: Floats | None = None
    best: tuple[float, Batch, Worth, int] | None = None
    seen = False
    for batch, w in zip(batches, worths, strict=True):
        G = (w.gain if family.local else w.G) - price
        closed = (family.positive & (w.sign < 0)) | (w.share <= least)[:, None]
        G = np.where(closed, -1e3, G)
        high = G[:, 1:].max(axis=0)
        top = high if top is None else np.maximum(top, high)
        k = int(np.argmax(G[:, 0]))
        seen = seen or bool(w.share.max() > least)
        if best is None or G[k, 0] > best[0]:
            best = float(G[k, 0]), batch, w, k
    assert best is not None
    assert top is not None
    G0, batch, w, k = best
    candidate = family.at(context, batch.shapes[k])
    row = Judged(
        family,
        candidate,
        G0,
        float(w.gain[k, 0]),
        w.theta[k],
        float(w.share[k]),
        seen,
    )
    return row, top


def polish(context: Context, ledger: Ledger, judged: Judged) -> Judged:
    """Return an effect with its shapes between the points of its grid."""
    family = judged.family
    plain = measured(ledger)
    for width in (1.0, 0.35):
        for name, half in family.fine.items():
            around = _around(judged.candidate.shape, name, width * half)
            columns = stacked(plain.stage, [family.at(context, s).columns for s in around])
            batch = Batch(around, columns)
            w = worth(plain, sums(plain, columns), family.ridge)
            found, _ = _best(context, family, [batch], [w])
            if found.gain > judged.gain:
                judged = replace(found, identifiable=judged.identifiable)
    return judged


def _around(shape: Shape, name: str, half: float) -> list[Shape]:
    steps = half * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    return [{**shape, name: float(shape[name] * np.exp(x))} for x in steps]
