"""What this log can tell apart, and how sure an answer is: known before the data are looked at.

Effects of the catalogue are put into healthy noise on the log's own motion, and the same screen is run
on them. Noise-free injections give the confusion that is to be expected; noisy ones, a quarter of them
with their own family taken away, give the temperature of the evidence and the share of right answers
among those that look equally sure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.diagnosis.admission import Key
from pinotwin.diagnosis.advice import same_class
from pinotwin.diagnosis.bank import BATCH, Shelf
from pinotwin.diagnosis.context import Context
from pinotwin.diagnosis.healthy import white_draws
from pinotwin.diagnosis.ledger import Ledger, build_ledger
from pinotwin.diagnosis.search import LEAST_SHARE, Screened, Settings, screen
from pinotwin.diagnosis.stage import Stage

SIZES = (8.0, 3000.0)  # whitened deviance that an injection brings beyond the base, log-uniform
REFERENCE = 200.0  # the same of the noise-free ones
OUTSIDE = 0.25  # share of injections whose own family is taken away
ALONE = 80  # draws of noise alone, for the threshold
SUREST = 0.92
"""No answer is surer. Of 64 that injections called surer than 0.95, 86 % were right (development seed 3):
the laws of a machine are not those of the catalogue to the letter, which injections cannot show."""
PARTIAL = 0.6
"""Confidence of an answer that leaves part of the gap open, over that of one that does not.

Injections cannot tell: their effects have the catalogue's own form, so that among them only those from
outside it leave anything. On virtual machines 41 of 74 such answers were right, of the others 272 of 309
(development seeds 3 and 8).
"""
STAYS = 0.15  # share of the gap's power above which an answer is only partial
PATTERN = 60.0  # deviance that a cousin must leave to be seen as one,
PATTERN_OF_GAIN = 0.02  # and its share of what there was
WARMTHS = np.geomspace(1e-4, 0.3, 25)


@dataclass(frozen=True)
class Calibration:
    """What injections taught.

    Attributes:
        warmth: temperature of the evidence per unit of gain.
        sure: confidences before recalibration, ascending, shape (n,).
        right: share of right answers at them, shape (n,).
        predicted: true -> named -> probability at the reference size.
    """

    warmth: float
    sure: Floats
    right: Floats
    predicted: Mapping[Key, Mapping[Key, float]]

    def confidence(self, p: float, *, partial: bool) -> float:
        """Return the share of right answers among injections that looked as sure as ``p``.

        Args:
            p: probability by evidence alone.
            partial: the answer leaves part of the gap open.
        """
        full = min(float(np.interp(p, self.sure, self.right)) if len(self.sure) else p, SUREST)
        return PARTIAL * full if partial else full


def tempered(G: Floats, threshold: float, warmth: float) -> Floats:
    """Return the probability of every option and of none (last), from held-out gains (options,)."""
    all_ = np.append(G, threshold)
    T = 1.0 + warmth * max(float(all_.max()), 0.0)
    p = np.exp(np.clip((all_ - all_.max()) / (2.0 * T), -700.0, 0.0))
    return np.asarray(p / p.sum())


def calibrate(
    context: Context, stage: Stage, theta: Floats, shelves: Sequence[Shelf], settings: Settings
) -> Calibration:
    """Return what this motion can tell apart; the measured effort is not looked at."""
    rng = np.random.default_rng([settings.seed, 1234])
    blind = _without_effort(stage)
    plain = build_ledger(blind, theta)
    low, high = np.log(SIZES)
    sizes = np.exp(rng.uniform(low, high, settings.injections))
    which = rng.integers(0, len(shelves), settings.injections)
    quiet = np.arange(len(shelves))
    pushed = _injected(plain, shelves, np.r_[which, quiet], np.r_[sizes, np.full(len(quiet), REFERENCE)], rng)
    noise = white_draws(blind, plain, settings.injections, rng, theta)
    drawn = [_with_noise(x, n) for x, n in zip(pushed, noise, strict=True)]
    seen = screen(context, shelves, build_ledger(blind, theta, drawn), settings)
    count, end = settings.injections, settings.injections + len(quiet)
    threshold = seen.threshold(settings.alpha, slice(end, None))
    keys = [s.family.key for s in shelves]
    outside = rng.random(count) < OUTSIDE
    truth = [keys[int(k)] for k in which]
    G = seen.tops[:, :count].copy()
    for n in np.flatnonzero(outside):
        G[[k for k, key in enumerate(seen.keys) if alike(key, truth[n])], n] = -1e3
    warmth, sure, right = _recalibrated(_Answers(seen, G, truth, outside, sizes, threshold))
    return Calibration(warmth, sure, right, _predicted(seen, keys, seen.tops[:, count:end]))


def _with_noise(pushed: Floats, noise: Floats) -> Floats:
    """Return noisy injections, the noise-free ones after them, and some noise alone."""
    out = pushed.copy()
    out[:, : noise.shape[1]] += noise
    return np.concatenate([out, noise[:, :ALONE]], axis=1)


def _without_effort(stage: Stage) -> Stage:
    pieces = tuple(replace(p, y=np.zeros_like(p.y)) for p in stage.pieces)
    return replace(stage, pieces=pieces)


def _injected(
    ledger: Ledger,
    shelves: Sequence[Shelf],
    which: Ints,
    gains: Floats,
    rng: np.random.Generator,
) -> list[Floats]:
    """Return whitened efforts of effects of stated gain, per piece of shape (m, len(which))."""
    out = [np.zeros((len(p.y), len(which))) for p in ledger.stage.pieces]
    for n, (k, gain) in enumerate(zip(which, gains, strict=True)):
        family = shelves[k].family
        at = int(rng.integers(len(family.shapes)))
        batch = shelves[k].batches[at // BATCH]
        columns = [None if x is None else x[:, at % BATCH, :] for x in batch.columns]
        theta = np.abs(rng.standard_normal(len(family.names)))
        if not family.positive:
            theta *= rng.choice([-1.0, 1.0], len(theta))
        S = batch.known(ledger).S[0][at % BATCH]  # what the base and its scatter leave open
        raw = batch.known(ledger).raw[0][at % BATCH]
        theta /= np.sqrt(np.maximum(raw, 1e-300))
        open_ = float(theta @ S @ theta)
        if open_ <= LEAST_SHARE * float(theta**2 @ raw):
            continue  # the base does the same: there is nothing to tell apart
        for piece, x in enumerate(columns):
            if x is not None:
                out[piece][:, n] = x @ theta * np.sqrt(gain / open_)
    return out


@dataclass(frozen=True)
class _Answers:
    """What the screen said of injections: options G (families, n), truth, and whether it was taken away."""

    seen: Screened
    G: Floats
    truth: Sequence[Key]
    outside: Mask
    gains: Floats
    threshold: float

    def named(self, warmth: float) -> tuple[Floats, Mask, Mask]:
        """Return of every detected injection how sure the answer is, whether right, whether partial."""
        sure, right, partial = [], [], []
        for n in range(self.G.shape[1]):
            best = int(np.argmax(self.G[:, n]))
            if self.G[best, n] > self.threshold:
                p = tempered(self.G[:, n], self.threshold, warmth)
                key = self.seen.keys[best]
                same = [k for k, other in enumerate(self.seen.keys) if alike(other, key)]
                sure.append(float(p[same].sum()))
                right.append(not self.outside[n] and alike(key, self.truth[n]))
                partial.append(self._leaves(n, float(self.G[best, n])))
        return np.array(sure), np.array(right, dtype=bool), np.array(partial, dtype=bool)

    def _leaves(self, n: int, found: float) -> bool:
        """Whether the answer to an injection would be seen to leave something over.

        A cousin of an effect that is in no catalogue leaves a pattern (:mod:`pinotwin.diagnosis.patterns`).
        """
        left = float(self.gains[n]) - found
        if self.outside[n] and left > max(PATTERN, PATTERN_OF_GAIN * float(self.gains[n])):
            return True
        return left > STAYS * float(self.gains[n])


def _recalibrated(answers: _Answers) -> tuple[float, Floats, Floats]:
    """Return the warmth, and confidences before and after recalibration, of answers that leave nothing."""
    index = {key: k for k, key in enumerate(answers.seen.keys)}
    own = np.array([index.get(key, -1) for key in answers.truth])
    known = np.flatnonzero(~answers.outside & (own >= 0))
    losses = []
    for w in WARMTHS:
        p = [tempered(answers.G[:, n], answers.threshold, w)[own[n]] for n in known]
        losses.append(-float(np.sum(np.log(np.maximum(p, 1e-12)))))
    warmth = float(WARMTHS[int(np.argmin(losses))])
    sure, right, partial = answers.named(warmth)
    order = np.argsort(sure[~partial])
    x, y = _isotonic(sure[~partial][order], right[~partial][order].astype(float))
    return warmth, x, y


def alike(a: Key, b: Key) -> bool:
    """Whether two answers count as one: the same class on the same axis."""
    if not same_class(a[0], b[0]):
        return False
    return a[1] == b[1] or a[0] == "payload" == b[0]


def _isotonic(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return pooled x and the non-decreasing fit of y (Zadrozny & Elkan 2002).

    It is shrunk to the share of right answers among all by as much as two answers weigh.
    """
    from scipy.optimize import isotonic_regression

    if len(x) < 20:
        return np.zeros(0), np.zeros(0)
    fit = np.asarray(isotonic_regression(y).x)
    levels, first, count = np.unique(fit, return_index=True, return_counts=True)
    middle = np.array([x[f : f + c].mean() for f, c in zip(first, count, strict=True)])
    return middle, (levels * count + 2.0 * y.mean()) / (count + 2.0)


def _predicted(seen: Screened, keys: Sequence[Key], tops: Floats) -> dict[Key, dict[Key, float]]:
    """Return the predicted confusion of noise-free injections."""
    predicted: dict[Key, dict[Key, float]] = {}
    index = {key: k for k, key in enumerate(seen.keys)}
    for n, true in enumerate(keys):
        if true in index and tops[index[true], n] > 0.2 * REFERENCE:
            p = tempered(tops[:, n], -1e3, 0.0)
            predicted[true] = {o: float(p[k]) for o, k in index.items() if p[k] > 0.01}
    return predicted
