"""The flexible twin: chapter 7 of the source on the virtual flexure rig, side by side.

python examples/flexure_twin.py [--seconds 20] [--report flexure.html]

Trained on one log with the limits of Table 6-2 and its reconstructed vibration; judged from the
command alone on unseen trajectories (Table C-1; the zones of Fig. 7-2) and on hammer pulses.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

import pinotwin as pt
from pinotwin.analysis.modal import servo_modes
from pinotwin.reconstruction import with_vibration
from pinotwin.report import identification_report
from pinotwin.simulation import wide_loops
from pinotwin.simulation.score import compare as compared
from pinotwin.trajectories.moves import random_trajectory
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual.imu import record_imu

sys.path.insert(0, str(Path(__file__).parent))
import rig_moves

SOURCE = {"Table 7-4": (6.19, 3.89, 4.19, 2.03), "Table C-2": (5.52, 6.63, 6.00, 4.02)}


def four(twin: pt.Twin, log: pt.Log, predicted: pt.Log) -> list[float]:
    """Normalised RMS errors of Y and A [%]: e, u; e, u."""
    score = compared(twin.machine, log, predicted)
    return [100 * score[axis][signal]["nrmse"] for axis in "YA" for signal in "eu"]


def after_hit(log: pt.Log, predicted: pt.Log) -> list[float]:
    """Errors of the response to a pulse over its RMS [%], from the state before it: e, u of Y, A."""
    every, out = round((len(predicted) - 1) / (len(log) - 1)), []
    before, after = abs(log.t - rig_moves.HIT + 0.05) < 0.05, log.t >= rig_moves.HIT
    for axis in "YA":
        for signal in "eu":
            true = log[f"{axis}.qr"] - log[f"{axis}.q"] if signal == "e" else log[f"{axis}.u"]
            x = predicted[f"{axis}.{signal}"][::every][: len(true)]
            x, y = x - x[before].mean(), true - true[before].mean()
            out.append(100 * float(np.sqrt(np.mean((x - y)[after] ** 2) / np.mean(y[after] ** 2))))
    return out


def hammer(vm: VirtualMachine, twin: pt.Twin, tilt: float, side: float) -> list[float]:
    """Hit one side of the tilted table, 5 ms and 500 N; errors of the predicted response [%]."""
    path, pulse = rig_moves.tilted(vm, tilt), rig_moves.hit(tilt, side)
    measured = vm.record(path, seed=3, external=[pulse]).to_log()
    return after_hit(measured, twin.simulate(pt.Log(rig_moves.hammer_command(vm, path, pulse))))


def main(seconds: float = 20.0, report: str = "", rig: pt.Machine | None = None) -> dict:
    """Identify, simulate, print beside the source's tables; return the figures."""
    rig, vm = rig or pt.Machine.load("flexure_rig"), VirtualMachine.load("urdf/flexure_rig")
    run = vm.record(random_trajectory(vm, seconds, 11), seed=1, truth_rate=2000.0)
    log, imu = run.to_log(), record_imu(run.truth, "C_link", vm.truth.seed, 1)
    seen = pt.reconstruct_vibration(rig, log, imu)
    train = with_vibration(log, seen, row=True)
    unseen = random_trajectory(vm, seconds, 12, rig_moves.limits_c1(vm))
    other, fig = (vm.record(x, seed=2).to_log() for x in (unseen, rig_moves.zones(vm)))
    twin = pt.identify(rig, train)

    print("Normalised RMS error [%], command alone       e_Y    u_Y    e_A    u_A   mean")
    rows = {(table, "source"): list(x) for table, x in SOURCE.items()}
    for table, part in (("Table 7-4", train), ("Table C-2", other), ("Fig. 7-2", fig)):
        rows[table, "spring as states"] = four(twin, part, twin.simulate(part))
        wide = twin.simulate(part, controller="vibration")
        rows[table, "3 x 3 of order 7"] = four(twin, part, wide)
    for (table, what), x in rows.items():
        print(f"  {table:<11}{what:<30}" + "".join(f"{v:7.2f}" for v in (*x, np.mean(x))))
    poles = {row["name"]: row["value"] for row in wide_loops(twin)["A"].pole_table()}
    shown = ", ".join(f"{k} {v:.3g}" for k, v in poles.items())
    print(f"Table 7-3, poles of A with the vibration: {shown}\n  (source: wn2 19.5, zeta2 0.0538)")
    k, c = twin.coefficients("delta.spring")
    print(f"Spring, implicit in the source: {k:.0f} N·m/rad, {c:.1f} N·m·s/rad")
    for mode in servo_modes(twin).modes:
        print(f"Mode with the servo closed: {mode.frequency:.1f} Hz, damping {mode.damping:.3f}")
    print("Fig. 7-5, hammer pulses, error over RMS [%]   e_Y    u_Y    e_A    u_A")
    hits = {}
    for tilt, side in ((32.0, -1.0), (73.0, 1.0)):
        hits[tilt] = hammer(vm, twin, np.radians(tilt), side)
        print(f"  {tilt:.0f} deg{'':<35}" + "".join(f"{v:7.2f}" for v in hits[tilt]))
    if report:
        Path(report).write_text(identification_report(twin, train, [fig]), encoding="utf-8")
    return {"rows": rows, "poles": poles, "spring": (k, c), "hits": hits, "twin": twin}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--report", default="")
    given = parser.parse_args()
    main(given.seconds, given.report)
