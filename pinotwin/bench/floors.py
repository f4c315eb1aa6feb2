"""What others would do: stepwise BIC, and orthogonal matching pursuit, on inverse-dynamics regressors.

Both take the same catalogue of columns on the same rows, white noise assumed, nothing held out. They set
the floor that a diagnosis must clear.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.diagnosis.ledger import build_ledger
from pinotwin.diagnosis.prepare import ready
from pinotwin.diagnosis.search import Settings, screen
from pinotwin.diagnosis.shrinking import plain_stage
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.twin import Twin

PURSUIT = 0.02  # share of the squared residual that orthogonal matching pursuit must take


def floors(
    subject: Machine | Twin, logs: Sequence[Log]
) -> dict[str, tuple[str, str | None] | None]:
    """Return the first effect that each floor names, or None."""
    start = ready(subject, logs, [], lambda stage: None)
    stage = plain_stage(start.stage)
    ledger = build_ledger(stage)
    seen = screen(start.context, ledger, Settings(draws=0)).judged
    rows = sum(len(p.y) for p in stage.pieces)
    left = {
        j: sum(float(np.sum((p.y - p.B @ ledger.theta[p.columns]) ** 2))
               for p in stage.pieces if p.channel.joint == j)
        for j in stage.rows.joints
    }  # fmt: skip
    total = sum(left.values())
    bic = [(_bic(j.gain, total, rows, len(j.theta)), j.key) for j in seen if j.identifiable]
    gain = [(j.gain / total, j.key) for j in seen if j.identifiable]
    best, pursuit = max(bic), max(gain)
    return {
        "stepwise_bic": best[1] if best[0] > 0.0 else None,
        "pursuit": pursuit[1] if pursuit[0] > PURSUIT else None,
    }


def _bic(gain: float, total: float, rows: int, width: int) -> float:
    """Return the drop of the Bayesian information criterion."""
    return rows * float(np.log(total / max(total - gain, 1e-300))) - width * float(np.log(rows))
