"""KR300, a real robot (Weigand et al. 2021): loops fitted on 60 % of 10 s, along the measured motion of the rest.

It does not work, and this says by how much: RMS error over RMS of tracking error and effort, worst and best axis.
"""

from __future__ import annotations

from benchmarks import kr300
from benchmarks.evidence.real import folder
from benchmarks.evidence.store import Figure

SEEDS = "none: a recording"
SLOW = True


def figures() -> list[Figure]:
    """Measure."""
    table, _ = kr300.figures(folder("kuka_kr300").parent)
    out = []
    for signal, words in (("e", "tracking error"), ("u", "effort")):
        values = sorted(100.0 * row[signal] for row in table.values())
        middle = values[len(values) // 2]
        what = f"{words} of the last 40 %, median of the {len(values)} axes with a loop"
        out.append(Figure(signal, what, middle, low=values[0], high=values[-1]))
    return out
