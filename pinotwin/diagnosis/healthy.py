"""Healthy draws: what the search would find in data that hold no effect.

Half of the draws are white noise with run-to-run scatter of friction, as the model states them; the
other half are the stage's own residual with the sign of every stretch of it drawn at random (a wild
block bootstrap), which keeps whatever the noise model misses. Repeats of a command share their signs.
"""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.ledger import Ledger, residual_of
from pinotwin.diagnosis.stage import Stage, scatter_precision

STRETCH = 0.5  # [s] length of the stretches whose sign is drawn


def healthy_draws(stage: Stage, ledger: Ledger, count: int, rng: np.random.Generator) -> list[Floats]:
    """Return whitened efforts without effects per piece, each of shape (m, count)."""
    flipped = count // 2
    noise = white_draws(stage, ledger, count - flipped, rng, ledger.theta)
    signs = _Signs(rng, flipped)
    out = []
    for piece, white in zip(stage.pieces, noise, strict=True):
        residual = residual_of(piece, ledger.theta)
        t = piece.channel.centres[piece.kept] * stage.rows.motions[0].step
        label = stage.rows.commands[piece.channel.log]
        flips = signs.at(label, piece.channel.joint, (t / STRETCH).astype(int))
        out.append(np.concatenate([white, residual[:, None] * flips], axis=1))
    return out


def white_draws(
    stage: Stage, ledger: Ledger, count: int, rng: np.random.Generator, theta: Floats
) -> list[Floats]:
    """Return white noise with run-to-run scatter of friction, per piece of shape (m, count)."""
    base = stage.base
    precision = scatter_precision(base, stage.noise, np.resize(theta, base.count))
    S = np.flatnonzero(np.isfinite(precision))
    logs = len(stage.rows.motions)
    scatter = rng.standard_normal((logs, len(S), count)) / np.sqrt(precision[S])[None, :, None]
    out = []
    for piece in stage.pieces:
        own = np.zeros((base.count, count))
        own[S] = scatter[piece.channel.log]
        out.append(rng.standard_normal((len(piece.y), count)) + piece.B @ own[piece.columns])
    return out


class _Signs:
    """Random signs per command, joint and stretch, drawn once."""

    def __init__(self, rng: np.random.Generator, count: int) -> None:
        self.rng, self.count = rng, count
        self.known: dict[tuple[int, int], Floats] = {}

    def at(self, label: int, joint: int, stretch: Floats) -> Floats:
        """Return signs, shape (len(stretch), count)."""
        key = (label, joint)
        if key not in self.known:
            self.known[key] = self.rng.choice([-1.0, 1.0], size=(4096, self.count))
        return self.known[key][np.minimum(stretch, 4095)]
