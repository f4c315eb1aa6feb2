"""The trunnion of Section 4.3.2: plant, loops, prediction of an unseen log, and where the error comes from.

Run: .venv/bin/python examples/trunnion.py. The log comes from the virtual trunnion, the figures in the last
column from the real one in Wang (2023): other friction, other cables, other controller gains.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import pinotwin as pt
from pinotwin.virtual import VirtualMachine, random_trajectory

SOURCE = {"Y": {"e": 0.0712, "u": 0.0512}, "A": {"e": 0.0615, "u": 0.0263}}  # Table 4-5
POLES = {
    "Y": {"p1": 62.96, "wn1": 10.86, "zeta1": 0.6739},
    "A": {"p1": 52.15, "wn1": 7.61, "zeta1": 0.8471},
}  # Table 4-4
SIZES = {
    "Y": "1.49e-6 m of 2.09e-5, 2.63 N of 51.4",
    "A": "3.89e-5 rad of 6.32e-4, 0.113 N·m of 4.29",
}


def record(seconds: float, seed: int) -> pt.Log:
    """Return a log of the virtual trunnion: back-and-forth moves with little dwell."""
    virtual = VirtualMachine.load(pt.machines()["trunnion"])
    # The source moves Y and A at once, all the time; C goes along in short strokes that end as soon.
    short = {"C": replace(virtual.limits["C"], travel=(-0.35, 0.35))}
    path = random_trajectory(virtual, seconds, seed, short, dwell=(0.0, 0.1), synchronised=0.3)
    return virtual.record(path, seed=seed).to_log()


def errors(log: pt.Log, predicted: pt.Log, axes: str) -> dict[str, dict[str, float]]:
    """Return RMS error over RMS magnitude of e and u, per axis."""
    out: dict[str, dict[str, float]] = {}
    for axis in axes:
        measured = {"e": log[f"{axis}.qr"] - log[f"{axis}.q"], "u": log[f"{axis}.u"]}
        out[axis] = {k: rms(predicted[f"{axis}.{k}"] - x) / rms(x) for k, x in measured.items()}
    return out


def rms(x: np.ndarray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(x**2)))


def print_sizes(log: pt.Log, found: dict[str, dict[str, float]]) -> None:
    """Print errors in units, and the noise of the effort that no model can predict."""
    truth = VirtualMachine.load(pt.machines()["trunnion"]).truth.axes
    for axis, row in found.items():
        e, u = rms(log[f"{axis}.qr"] - log[f"{axis}.q"]), rms(log[f"{axis}.u"])
        sensor = truth[axis].effort
        noise = float(np.hypot(sensor.white or 0.0, sensor.coloured or 0.0))
        print(
            f"{axis}: e {row['e'] * e:.3g} of {e:.3g}, u {row['u'] * u:.3g} of {u:.3g} (SI; source "
            f"{SIZES[axis]}); effort noise {noise:.2g}, step {sensor.resolution:.2g}"
        )


def main(seconds: float = 25.0, unseen_seconds: float = 12.0) -> dict[str, dict[str, float]]:
    """Identify, predict an unseen trajectory from its command alone, print the tables."""
    log, unseen = record(seconds, 1), record(unseen_seconds, 2)
    twin = pt.identify(pt.Machine.load("trunnion"), log, validate=unseen)
    print("dominant poles      ours               source (Table 4-4)")
    for axis, source in POLES.items():
        for row in twin.loops[axis].pole_table():
            if row["name"] in source:
                # Poles of the free black box come with an interval; those of the coupled system without.
                span = "[{:.3g}, {:.3g}]".format(*row["interval"]) if "interval" in row else ""
                print(
                    f"{axis} {row['name']:<6}{row['value']:9.3g} {span:<14}"
                    f"{source[row['name']]:>12} {row['unit']}"
                )
    found = errors(unseen, twin.simulate(unseen), "YA")
    print("\nunseen trajectory, from the command alone: normalised RMS error (Table 4-5)")
    for axis, row in found.items():
        for signal, value in row.items():
            print(f"{axis}.{signal}  ours {value:7.2%}   source {SOURCE[axis][signal]:7.2%}")
    print_sizes(unseen, found)
    window = (3.0, 5.3)
    print("\nshares of the tracking error, 3 to 5.3 s (Fig. 4-16)")
    for row in pt.decompose(twin, unseen, window).table():
        print(f"{row['axis']}  {row['cause']:<22}{row['share']:7.1%}")
    return found


if __name__ == "__main__":
    main()
