"""Which effects: every candidate judged jointly with the base, one admitted at a time, with re-checks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.catalogue import families, searched_families
from pinotwin.diagnosis.catalogue.position import waves
from pinotwin.diagnosis.context import Candidate, Context, Family
from pinotwin.diagnosis.ledger import Ledger, Worth, build_ledger, sums, worth
from pinotwin.diagnosis.null import draws
from pinotwin.diagnosis.stage import Piece, Stage

LEAST_SHARE = 2e-4  # of a candidate's columns that the base must leave open
LEAST_SHARE_OF_POSITION = 0.01  # the same where a table interpolates between its knots
BATCH = 64
POSITION = ("ripple", "ripple_modulated", "position_table")


@dataclass(frozen=True)
class Judged:
    """The best candidate of a family.

    Attributes:
        candidate: at its best shape.
        G: held-out gain less the price of its search [whitened deviance].
        gain: in-sample gain.
        theta: coefficients, shape (k,).
        deviation: their standard errors.
        share: of its columns that the base leaves open.
        by_fold: held-out gain per fold.
        identifiable: whether the log can tell it from the base at all.
    """

    candidate: Candidate
    G: float
    gain: float
    theta: Floats
    deviation: Floats
    share: float
    by_fold: Floats
    identifiable: bool

    @property
    def key(self) -> tuple[str, str | None]:
        """Effect and axis."""
        return self.candidate.effect, self.candidate.axis


@dataclass(frozen=True)
class Screened:
    """All families judged on one stage.

    Attributes:
        judged: best first.
        threshold: held-out gain that healthy draws reach with the stated probability.
        null: the largest gain of every draw, shape (draws,).
    """

    judged: tuple[Judged, ...]
    threshold: float
    null: Floats

    @property
    def named(self) -> tuple[Judged, ...]:
        """The ones above the threshold."""
        return tuple(j for j in self.judged if self.threshold < j.G)


@dataclass(frozen=True)
class Settings:
    """How a search decides.

    Attributes:
        draws: healthy draws for the threshold.
        alpha: probability that a healthy machine exceeds it.
        most: most effects that are named.
        leave_out: effects that are not considered.
        seed: of the draws.
    """

    draws: int = 200
    alpha: float = 0.02
    most: int = 3
    leave_out: frozenset[str] = frozenset()
    seed: int = 0


RARE = {"geometric_error": 4.0, "position_table": 4.0, "encoder_error": 2.0, "backlash": 2.0,
        "wrist_coupling": 2.0, "viscous_asymmetric": 2.0, "ripple_modulated": 2.0}  # fmt: skip
"""Deviance that an uncommon effect must bring beyond a common one that does the same."""

Cache = dict[tuple[str, str | None], list[tuple[Family, list[Floats | None]]]]
"""Whitened columns of families whose candidates do not depend on what was admitted."""


def screen(
    context: Context,
    ledger: Ledger,
    settings: Settings,
    taken: Sequence[tuple[str, str | None]] = (),
    cache: Cache | None = None,
) -> Screened:
    """Judge every family of the catalogue on a ledger.

    Args:
        context: what candidates are made from.
        ledger: of the base with what was admitted already, drawn efforts included.
        settings: see :class:`Settings`.
        taken: effects already admitted; they are not judged again.
        cache: columns of an earlier screen of the same rows; filled and used.
    """
    judged, tops = [], []
    for key, parts in _parts(context, ledger, settings, {} if cache is None else cache):
        if key in taken:
            continue
        found, top = _judge(parts, ledger)
        judged.append(found)
        tops.append(top)
    null = np.max(np.array(tops), axis=0) if tops else np.zeros(0)
    judged.sort(key=lambda j: -j.G)
    return Screened(tuple(judged), _quantile(null, settings.alpha), null)


def _quantile(null: Floats, alpha: float) -> float:
    """Return the upper quantile of a sample of maxima by a Gumbel law fitted to its moments."""
    if len(null) < 8:
        return 20.0
    beta = float(np.std(null)) * np.sqrt(6.0) / np.pi
    fitted = float(np.mean(null)) - 0.5772 * beta - beta * np.log(-np.log(1.0 - alpha))
    return max(fitted, 8.0)


def _parts(context: Context, ledger: Ledger, settings: Settings, cache: Cache):  # type: ignore[no-untyped-def]
    """Yield (key, batches of candidates with their whitened columns) of every family."""
    if not cache:
        for family in families(context, leave_out=settings.leave_out):
            key = (family[0].effect, family[0].axis)
            cache[key] = [(p, _stacked(ledger.stage, p)) for p in _batches(family)]
    yield from cache.items()
    scan = _scanner(context, ledger)
    for family in searched_families(context, scan, leave_out=settings.leave_out):
        key = (family[0].effect, family[0].axis)
        yield key, [(p, _stacked(ledger.stage, p)) for p in _batches(family)]


def _judge(
    parts: Sequence[tuple[Family, list[Floats | None]]], ledger: Ledger
) -> tuple[Judged, Floats]:
    """Return the best of a family and, per draw, the largest gain in it."""
    best: Judged | None = None
    top = np.full(ledger.right.shape[2] - 1, -np.inf)
    for part, stacked in parts:
        w = worth(ledger, sums(ledger, stacked))
        least = LEAST_SHARE_OF_POSITION if part[0].effect in POSITION else LEAST_SHARE
        positive = np.array([c.positive for c in part])[:, None]
        rare = RARE.get(part[0].effect, 0.0)
        G = w.G - np.array([c.price + rare for c in part])[:, None]
        G = np.where((positive & (w.sign < 0)) | (w.share <= least)[:, None], -1e3, G)
        if G.shape[1] > 1:
            top = np.maximum(top, G[:, 1:].max(axis=0))
        k = int(np.argmax(G[:, 0]))
        if best is None or G[k, 0] > best.G:
            best = _row(part[k], w, k, float(G[k, 0]), bool(w.share.max() > least))
    assert best is not None
    return best, top


def _row(candidate: Candidate, w: Worth, k: int, G: float, seen: bool) -> Judged:
    return Judged(
        candidate, G, float(w.gain[k]), w.theta[k], w.deviation[k], float(w.share[k]),
        w.by_fold[:, k], seen,
    )  # fmt: skip


def _batches(family: Family) -> Iterator[Family]:
    """Yield parts of a family whose candidates have the same joints and number of columns."""
    part: list[Candidate] = []
    for candidate in family:
        if part and (len(part) >= BATCH or _form(candidate) != _form(part[0])):
            yield part
            part = []
        part.append(candidate)
    if part:
        yield part


def _form(candidate: Candidate) -> tuple[tuple[int, int], ...]:
    return tuple((joint, x.shape[1]) for joint, x in candidate.columns[0])


def _stacked(stage: Stage, family: Family) -> list[Floats | None]:
    parts = [stage.project(c.columns) for c in family]
    out: list[Floats | None] = []
    for piece in range(len(stage.pieces)):
        values = [p[piece] for p in parts]
        present = [x for x in values if x is not None]
        out.append(np.stack(present, axis=1) if present else None)
    return out


def _scanner(context: Context, ledger: Ledger):  # type: ignore[no-untyped-def]
    """Return the function that scans pitches of a sinusoid on one joint."""
    stage = ledger.stage
    plain = replace_draws(ledger)

    def scan(joint: int, pitches: Sequence[float]) -> Floats:
        gain = []
        for first in range(0, len(pitches), 100):
            part = pitches[first : first + 100]
            columns = [_many_waves(s.motion.q[:, joint], part) for s in context.scenes]
            batch: list[Floats | None] = []
            for piece in stage.pieces:
                if piece.channel.joint != joint:
                    batch.append(None)
                    continue
                rows = stage.whitened(piece, columns[piece.channel.log])
                batch.append(rows.reshape(len(rows), len(part), 2))
            gain.append(worth(plain, sums(plain, batch)).gain)
        return np.concatenate(gain)

    return scan


def _many_waves(q: Floats, pitches: Sequence[float]) -> Floats:
    return np.concatenate([waves(q, p) for p in pitches], axis=1)


def replace_draws(ledger: Ledger) -> Ledger:
    """Return the ledger with the measured effort alone."""
    return replace(
        ledger, right=ledger.right[:, :, :1], Y=tuple(y[:, :1] for y in ledger.Y),
        groups=tuple(replace(g, Sy=g.Sy[:, :1]) for g in ledger.groups),
    )  # fmt: skip


def admit(stage: Stage, judged: Sequence[Judged]) -> Stage:
    """Return the stage with the columns of candidates added to its base."""
    p = stage.base.count
    pieces = list(stage.pieces)
    for item in judged:
        width = len(item.theta)
        values = stage.project(item.candidate.columns)
        for n, x in enumerate(values):
            if x is not None:
                pieces[n] = _wider(pieces[n], x, np.arange(p, p + width))
        p += width
    mean = np.concatenate([stage.base.mean, np.zeros(p - stage.base.count)])
    precision = np.zeros((p, p))
    precision[: stage.base.count, : stage.base.count] = stage.base.precision
    base = replace(stage.base, mean=mean, precision=precision)
    return replace(stage, base=base, pieces=tuple(pieces))


def _wider(piece: Piece, x: Floats, index: Ints) -> Piece:
    return replace(
        piece,
        B=np.concatenate([piece.B, x], axis=1),
        columns=np.concatenate([piece.columns, index.astype(int)]),
    )


def ledger_with_draws(
    stage: Stage, theta: Floats, settings: Settings, step: int, best: Sequence[Judged] = ()
) -> Ledger:
    """Return a ledger that also holds healthy draws.

    Args:
        stage: whitened rows.
        theta: sets the size of the run-to-run scatter.
        settings: number and seed of the draws.
        step: which step of the search it is.
        best: what is about to be admitted: the draws are made from the residual that it leaves, for
            under the hypothesis that it is right, that is what a healthy machine shows.
    """
    under = admit(stage, best)
    plain = build_ledger(under, theta)
    rng = np.random.default_rng([settings.seed, step])
    return build_ledger(stage, theta, draws(under, plain, settings.draws, rng))
