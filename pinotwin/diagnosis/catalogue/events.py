"""Pushes from outside that nobody logged: half-sine efforts of one axis at moments of one log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pinotwin.arrays import Floats
from pinotwin.diagnosis.context import Family, Scene, Shape, on
from pinotwin.diagnosis.ledger import Ledger
from pinotwin.diagnosis.stage import Piece, Stage

WIDTHS = (0.05, 0.1, 0.2, 0.4)  # [s]
MOST = 6  # events per log


@dataclass(frozen=True)
class Event:
    """One push.

    Attributes:
        log: index of the log.
        start: [s], on the log's clock.
        width: [s].
        gain: whitened deviance that it takes away.
    """

    log: int
    start: float
    width: float
    gain: float


def find_events(ledger: Ledger, joint: int) -> tuple[list[Event], float, Floats]:
    """Return the events on one joint, the price of one, and the largest net gain in every draw.

    Args:
        ledger: of the base; its draws are searched as well.
        joint: joint that is pushed.
    """
    stage = ledger.stage
    theta = ledger.solve(0, ledger.right[0])
    found: list[Event] = []
    tops, count = [np.full(theta.shape[1], -np.inf)], 0
    for k, piece in enumerate(stage.pieces):
        if piece.channel.joint != joint:
            continue
        R = ledger.Y[k] - piece.B @ theta[piece.columns]
        # A push stands out of what is left elsewhere; it does not explain a gap that is there always.
        R = R / np.maximum(1.4826 * np.median(np.abs(R), axis=0), 1.0)
        for width in WIDTHS:
            for first, gain in _matched(stage, piece, R, width):
                count += len(gain)
                tops.append(gain.max(axis=0))
                found += _events(stage, piece, first, gain[:, 0], width)
    price = 2.0 * np.log(max(count, 2)) + 2.0
    top = np.max(np.array(tops), axis=0)[1:] - price
    return _apart([e for e in found if e.gain > price]), price, top


def _matched(stage: Stage, piece: Piece, R: Floats, width: float):  # type: ignore[no-untyped-def]
    """Yield (row, gain of a push that starts there) of every unbroken run of rows; gain (m, d)."""
    step = stage.rows.row_step
    pulse = np.sin(np.pi * (np.arange(max(round(width / step), 2)) + 0.5) * step / width)
    model = stage.noise.models[piece.channel.joint]
    template = np.convolve(np.maximum(pulse, 0.0), np.concatenate([[1.0], -model]))
    cuts = np.flatnonzero(np.diff(piece.kept) > 1) + 1
    for a, b in zip(np.r_[0, cuts], np.r_[cuts, len(piece.kept)], strict=True):
        if b - a > len(template):
            score = np.einsum("mdl,l->md", sliding_window_view(R[a:b], len(template), axis=0), template)
            yield int(a), score**2 / float(template @ template)


def _events(stage: Stage, piece: Piece, first: int, gain: Floats, width: float) -> list[Event]:
    """Return the peaks of a run."""
    motion = stage.rows.motions[piece.channel.log]
    padded = np.concatenate([[-1.0], gain, [-1.0]])
    peaks = np.flatnonzero((gain >= padded[:-2]) & (gain > padded[2:]))
    best = peaks[np.argsort(gain[peaks])[::-1][: 2 * MOST]]
    rows = piece.channel.centres[piece.kept[first + best]]
    return [
        Event(piece.channel.log, float(motion.t[n]), width, float(gain[k]))
        for n, k in zip(rows, best, strict=True)
    ]


def _apart(events: Sequence[Event]) -> list[Event]:
    """Return the strongest events that do not overlap, a few per log."""
    kept: list[Event] = []
    for e in sorted(events, key=lambda e: -e.gain):
        own = [o for o in kept if o.log == e.log]
        free = all(e.start + e.width <= o.start or o.start + o.width <= e.start for o in own)
        if free and len(own) < MOST:
            kept.append(e)
    return kept


def pushes(axis: str, joint: int, events: Sequence[Event], price: float) -> Family:
    """Return the family of some events, one coefficient each."""

    def values(s: Scene, _: Shape) -> Floats:
        out = np.zeros((len(s.motion), len(events)))
        for k, e in enumerate(events):
            if e.log == s.log:
                x = (s.motion.t - e.start) / e.width
                out[:, k] = np.where((x > 0.0) & (x < 1.0), np.sin(np.pi * x), 0.0)
        return out

    shape = {
        f"{name}{k}": x
        for k, e in enumerate(events)
        for name, x in (("log", float(e.log)), ("start", e.start), ("width", e.width))
    }
    names = tuple(f"push{k}" for k in range(len(events)))
    return Family(
        "external_force",
        axis,
        names,
        on(joint, values),
        (shape,),
        price=price * len(events),
        local=True,
    )
