"""Clock, scale and alignment of an IMU over random mountings of the virtual rig, against the sealed truth.

50 runs of 20 s, each with its own command, mounting, clock, tilted foundation and sensor errors (Tables 6-3, 6-4 and
B-1 of the source); 20 of them again with moves that dwell ("drilling"), 12 with hysteresis and hardening in the joint
("rough"). Then logs that cannot tell how the IMU sits, which must be refused.
"""

from __future__ import annotations

from benchmarks import imu_mountings as bench
from benchmarks.evidence.store import Figure

SEEDS = "cases 0 to 49; looked at"
SLOW = True
KINDS = {"lively": (50, "lively", False), "drilling": (20, "drilling", False), "rough": (12, "lively", True)}
"""Name -> number of cases, command, whether the joint is rough."""


def figures() -> list[Figure]:
    """Measure."""
    out = []
    for kind, (cases, command, rough) in KINDS.items():
        outcomes = bench.outcomes_of(cases, 20.0, command, rough)
        print(f"{kind}\n{bench.table(outcomes)}", flush=True)
        for name in bench.LIMITS:
            out += _of(kind, name, bench.summary(name, outcomes), cases)
    said = [bench.refusal(case, kind) for kind in bench.SILENT for case in range(50)]
    refused = float(sum(x is not None for x in said))
    out.append(Figure("refused", "logs that cannot tell, refused", refused, "", "development", of=len(said)))
    return out


def _of(kind: str, name: str, x: bench.Summary, cases: int) -> list[Figure]:
    size, unit = (1e3, "us") if name == "clock" else (1.0, bench.UNITS[name].replace("-", ""))
    what, full, few = (
        f"{kind}: {name}",
        f"{kind}_{name}",
        f"beyond {size * bench.LIMITS[name]:g} {unit}".strip(),
    )
    covered = "95 % coverage"
    return [
        Figure(full, f"{what}, worst", size * x.worst, unit, "development"),
        Figure(f"{full}_rms", f"{what}, RMS", size * x.rms, unit, "development"),
        Figure(f"{full}_beyond", f"{what}, {few}", float(x.failed), "", "development", of=cases),
        Figure(f"{full}_covered", f"{what}, {covered}", 100.0 * x.held / x.of, "%", "development"),
    ]
