"""The whitened stage: rows of all logs with their noise made white, base columns, and block sums.

Everything that is decided later is decided on sums over blocks (Gram matrices of whitened columns), so
that a candidate costs one product. Friction that scatters from run to run is integrated out of every
block: with scatter S ~ N(0, Sigma), V^-1 = I - S (S'S + Sigma^-1)^-1 S' in whitened rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.base import Base, is_scattered
from pinotwin.diagnosis.noise import Noise
from pinotwin.diagnosis.rows import Channel, Rows
from pinotwin.effects.layout import effect_slices

Blocks = list[tuple[int, Floats]]


@dataclass(frozen=True)
class Piece:
    """One channel of the stage, whitened.

    Attributes:
        channel: where its rows come from.
        kept: rows that have a full past, indices into the channel's rows, shape (m,).
        block: fold of every kept row, shape (m,).
        columns: base columns that are not zero here, shape (k,).
        B: whitened base columns, shape (m, k).
        y: whitened effort, shape (m,).
    """

    channel: Channel
    kept: Ints
    block: Ints
    columns: Ints
    B: Floats
    y: Floats


@dataclass(frozen=True)
class Stage:
    """All pieces, and what is known of the noise.

    Attributes:
        rows: the rows.
        base: the base model.
        noise: whitener and scatter.
        pieces: per channel.
        blocks: number of folds.
    """

    rows: Rows
    base: Base
    noise: Noise
    pieces: tuple[Piece, ...]
    blocks: int

    @property
    def fitted(self) -> Stage:
        """The stage without validation logs: all that may be fitted to."""
        flags = self.rows.validation
        kept = tuple(p for p in self.pieces if not flags[p.channel.log])
        return replace(self, pieces=kept)

    def whitened(self, piece: Piece, values: Floats) -> Floats:
        """Return columns (n, k) of the piece's joint as whitened rows, shape (m, k)."""
        channel = piece.channel
        thin = self.rows.thinner.apply(values, channel.centres)
        return self.noise.whiten(channel, thin)[piece.kept]

    def project(self, columns: Sequence[Blocks]) -> list[Floats | None]:
        """Return whitened candidate columns per piece; ``columns`` holds (joint, values) per log."""
        out: list[Floats | None] = []
        for piece in self.pieces:
            parts = [x for joint, x in columns[piece.channel.log] if joint == piece.channel.joint]
            out.append(self.whitened(piece, parts[0]) if parts else None)
        return out


def build_stage(rows: Rows, base: Base, noise: Noise, blocks: int = 6) -> Stage:
    """Return the whitened stage."""
    labels, count = _blocks(rows, blocks)
    columns = [base.columns(motion) for motion in rows.motions]
    pieces = []
    for channel in rows.channels:
        parts = [(w, x) for j, w, x in columns[channel.log] if j == channel.joint]
        index = np.concatenate([np.arange(w.start, w.stop) for w, _ in parts])
        values = np.concatenate([x for _, x in parts], axis=1)
        B = rows.thinner.apply(values, channel.centres)
        alive = np.abs(B).max(axis=0) > 1e-12
        B, index = B[:, alive], index[alive]
        y = channel.y - B @ base.mean[index] if base.change else channel.y
        white = noise.whiten(channel, np.column_stack([B, y]))
        kept = noise.kept(channel)
        block = labels[channel.log][channel.centres[kept]]
        pieces.append(Piece(channel, kept, block, index, white[kept, :-1], white[kept, -1]))
    return Stage(rows, base, noise, tuple(pieces), count)


def _blocks(rows: Rows, blocks: int) -> tuple[list[Ints], int]:
    """Return the fold of every sample of every log: by command where there are several, else by time.

    Validation logs are in no fold; they carry label 0 and are never summed.
    """
    fitted = [c for c, flag in zip(rows.commands, rows.validation, strict=True) if not flag]
    commands = sorted(set(fitted))
    out = []
    if len(commands) >= 3:
        for label, motion in zip(rows.commands, rows.motions, strict=True):
            out.append(np.full(len(motion), commands.index(label) if label in commands else 0))
        return out, len(commands)
    share = max(2, blocks // len(commands))
    for label, motion in zip(rows.commands, rows.motions, strict=True):
        part = np.minimum(np.arange(len(motion)) * share // len(motion), share - 1)
        out.append(part + share * commands.index(label) if label in commands else 0 * part)
    return out, share * len(commands)


def scatter_precision(base: Base, noise: Noise, theta: Floats) -> Floats:
    """Return the precision of the run-to-run scatter per base column, inf where there is none."""
    out = np.full(base.count, np.inf)
    theta = np.resize(theta, base.count)
    for effect, where in zip(base.effects, effect_slices(base.effects), strict=True):
        if is_scattered(effect):
            deviation = noise.scatter * np.maximum(np.abs(theta[where]), 1e-9)
            out[where] = 1.0 / deviation**2
    return out


def steady(piece: Piece, r: Floats, precision: Floats) -> Floats:
    """Return a residual (m,) of one piece without what this run's own friction explains.

    Friction scatters a little from run to run; that much, twice its standard deviation at most, is noise
    of the second level, not a gap.
    """
    scattered = np.isfinite(precision[piece.columns])
    if not scattered.any():
        return r
    S = piece.B[:, scattered]
    M = S.T @ S + np.diag(precision[piece.columns[scattered]])
    limit = 2.0 / np.sqrt(precision[piece.columns[scattered]])
    return np.asarray(r - S @ np.clip(np.linalg.solve(M, S.T @ r), -limit, limit))
