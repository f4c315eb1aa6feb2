"""A long motion in short: what its shapes are searched on before the whole log settles the digits."""

from __future__ import annotations

import numpy as np

from pinotwin.identification.assemble import Rows
from pinotwin.motion import Motion

LONG, SHORT = 50_000, 24_000
"""Fitted rows beyond which a motion is abridged, and to how many: 48 s at 500 Hz, where the thesis took 12 s."""
PIECES = 12
"""Pieces of it, evenly spread, so that an axis that moves for a part of the log is among them."""
LEAST = 100
"""Fitted rows of a piece that filters and friction at rest leave something of."""


def abridged(motion: Motion, rows: Rows) -> Motion | None:
    """Return pieces of a long motion, None if it is not long.

    A search over all values of a shape costs hundreds of times what the last digits do, and which value it is a
    minute shows as well as an hour.

    Args:
        motion: prepared log(s).
        rows: what would be fitted.
    """
    if len(rows.sample) <= LONG:
        return None
    least, width = LEAST * motion.decimation, SHORT * motion.decimation // PIECES
    pieces = []
    for start in np.linspace(0, len(motion) - width, PIECES).astype(int):
        for s in motion.segments:
            a, b = max(int(start), s.start), min(int(start) + width, s.stop)
            if b - a > least:
                pieces.append(motion.cut(a, b))
    return Motion.join(pieces) if pieces else None
