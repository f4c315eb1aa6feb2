"""The source's IMU chain (thesis Section 6.3) beside VQF and the batch estimate, on the virtual flexure rig.

22 runs of one command with two IMUs, averaged; RMS error of the deflection's velocity against the sealed truth.
The virtual IMU is written apart from the estimator; its machine is ours.
"""

from __future__ import annotations

from benchmarks import imu_chain
from benchmarks.evidence.store import Figure

SEEDS = "0 to 21, command 3"
WORDS = {"naive": "differences of rates", "ekf": "the source's filter", "vqf": "VQF", "batch": "ours"}


def figures() -> list[Figure]:
    """Measure."""
    rows = imu_chain.compare(runs=22, seconds=6.12)
    out = []
    for name, (differ, error, _) in rows.items():
        words = WORDS.get(name, name)
        out.append(Figure(f"{name}_error", f"{words}, against the truth", float(error[0]), unit="deg/s"))
        source = 0.0474 if name == "ekf" else None
        out.append(
            Figure(f"{name}_between", f"{words}, one IMU against the other", float(differ[0]), unit="deg/s",
                   published=source)
        )  # fmt: skip
    return out
