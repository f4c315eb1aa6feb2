"""The source's IMU chain (thesis Section 6.3) beside VQF and the batch estimate, on the virtual flexure rig.

22 runs of one command with two IMUs, averaged; RMS error of the deflection's velocity against the sealed truth.
The virtual IMU is written apart from the estimator; its machine is ours.
"""

from __future__ import annotations

from benchmarks import imu_chain
from benchmarks.evidence.store import Figure

SEEDS = "0 to 21, command 3"
SLOW = True
WORDS = {"naive": "differences of rates", "ekf": "the source's filter", "vqf": "VQF", "batch": "ours"}
MEASURES = {
    "between": "one IMU against the other",
    "error": "mean of 22 against the truth",
    "one": "one run against the truth",
}
PUBLISHED = {"ekf_between": 0.0474, "ekf_between_a": 7.33}


def figures() -> list[Figure]:
    """Measure."""
    out = []
    for method, row in imu_chain.compare(runs=22, seconds=6.12).items():
        words = WORDS.get(method, method)
        for (measure, what), values in zip(MEASURES.items(), row, strict=True):
            for suffix, unit, value in zip(("", "_a"), ("deg/s", "deg/s²"), values, strict=True):
                name = f"{method}_{measure}{suffix}"
                out.append(
                    Figure(name, f"{words}, {what}", float(value), unit=unit, published=PUBLISHED.get(name))
                )
    return out
