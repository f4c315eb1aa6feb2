"""The deflection of the virtual flexure rig from servo and IMU logs, against its sealed truth.

Five single runs with one IMU, each another command, and 22 repeats with two; the plain joint, and one with 5 %
hysteresis and 10 % hardening ("rough") that the estimator does not know. CAD inertias are 10 to 20 % off, 1 % of the
IMU's samples are lost and 0.2 s in one piece. Of single runs the worst. The virtual IMU is written apart from the
estimator; its machine is ours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from benchmarks import vibration
from benchmarks.evidence.store import Figure

SEEDS = "1 to 5 (single), 1 to 22 of command 3 (repeats); looked at"
SLOW = True
UNITS = {
    "angle": "deg",
    "of": "deg",
    "velocity": "deg/s",
    "acceleration": "deg/s²",
    "clock": "us",
    "skew": "ppm",
    "scale": "",
}
WORDS = {
    "angle": "angle above 0.5 Hz",
    "of": "size of that angle",
    "scale": "gyro scale, worst axis",
    "clock": "clock offset",
    "skew": "clock skew",
}
PUBLISHED = {"velocity": 0.0474, "acceleration": 7.33}
KINDS = {
    "plain_single": "one run",
    "rough_single": "one run, rough joint",
    "plain_mean": "22 runs, two IMUs",
    "rough_mean": "22 runs, two IMUs, rough joint",
}


def figures() -> list[Figure]:
    """Measure."""
    return figures_of(vibration.compare(seeds=5, runs=22, seconds=20.0))


def figures_of(found: Mapping[str, Sequence[Mapping[str, float]]]) -> list[Figure]:
    """Return the worst of each error by kind of run and joint."""
    out = []
    for kind, rows in found.items():
        for name, unit in UNITS.items():
            sizes = [abs(row[name]) for row in rows if name in row]
            if not sizes:
                continue
            what = f"{WORDS.get(name, name)}, {KINDS[kind]}"
            source = PUBLISHED.get(name) if kind == "plain_mean" else None
            low = min(sizes) if len(sizes) > 1 else None
            high = max(sizes) if len(sizes) > 1 else None
            out.append(
                Figure(
                    f"{kind}_{name}",
                    what,
                    max(sizes),
                    unit,
                    "development",
                    low=low,
                    high=high,
                    published=source,
                )
            )
    return out
