"""What the first pass leaves out of the load, as further columns of a second one, each with a free gain.

The inertia's dependence on the posture (:func:`pinotwin.reconstruction.servo.posture_column`), and of the angle q

    -(q / p)³             hardening,     p the largest deflection
    -z_w(q) / p           hysteresis,    z_w the stop operator of width w = 0.1, 0.2, 0.4 p

A sum of stops (Prandtl-Ishlinskii: Visintin 1994, ISBN 978-3-540-54793-1) follows any rate-independent hysteresis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.imu.result import BatchResult, RunResult
from pinotwin.imu.runs import ServoRun
from pinotwin.machine import Machine
from pinotwin.reconstruction.servo import Piece, posture_column
from pinotwin.system.kernels import compiled

WIDTHS = (0.1, 0.2, 0.4)  # widths of the stop operators, as shares of the largest deflection


def needed(runs: Sequence[RunResult], unexplained: float = 0.01) -> bool:
    """Return whether a linear mode leaves more of the dynamic angle than a share of it."""
    left = np.sqrt(np.mean([r.remainder**2 for r in runs]))
    return bool(left > unexplained * np.sqrt(np.mean([np.var(r.dynamic) for r in runs])))


def with_posture(
    machine: Machine,
    joint: str,
    pieces: Sequence[Piece],
    found: Sequence[RunResult],
    negligible: float = 1e-3,
) -> list[ServoRun]:
    """Return the runs with the posture's column beside their load, unless it is a negligible share of that."""
    columns = []
    for piece, result in zip(pieces, found, strict=True):
        delta = np.stack([result.angle, result.velocity, result.acceleration], axis=1)
        columns.append(posture_column(machine, piece.joints, joint, delta))
    runs = [piece.run for piece in pieces]
    size = float(np.sqrt(np.mean([np.var(c) for c in columns])))
    if size < negligible * _load_size(runs):
        return runs
    return [replace(run, load=np.column_stack([run.load, c])) for run, c in zip(runs, columns, strict=True)]


def with_columns(servo: Sequence[ServoRun], found: Sequence[RunResult]) -> list[ServoRun]:
    """Return the runs with the columns of a nonlinear joint beside their load."""
    peak = _peak(found)
    size = _load_size(servo)
    out = []
    for run, result in zip(servo, found, strict=True):
        load = np.reshape(run.load, (len(run.t), -1))
        q = (result.angle - np.median(result.angle)) / peak
        extra = np.stack([-(q**3), *(-_stop(q, w) for w in WIDTHS)], axis=1)
        out.append(replace(run, load=np.hstack([load, size * extra])))
    return out


def shares(result: BatchResult, servo: Sequence[ServoRun], found: Sequence[RunResult]) -> tuple[float, float]:
    """Return hardening, hysteresis in a second pass, as shares of the spring's torque at the largest deflection."""
    gain, _ = result.shared("gain")
    wn = 2.0 * np.pi * result.frequency[0]
    own = gain[-1 - len(WIDTHS) :] * _load_size(servo) / (wn**2 * _peak(found))
    return float(own[0]), float(own[1:] @ np.array(WIDTHS))


def _peak(found: Sequence[RunResult]) -> float:
    """Return the largest deflection of all runs [rad], single samples aside."""
    return max(float(np.percentile(np.abs(r.angle - np.median(r.angle)), 99.5)) for r in found)


def _load_size(servo: Sequence[ServoRun]) -> float:
    return float(np.mean([np.std(np.reshape(r.load, (len(r.t), -1)).sum(axis=1)) for r in servo]))


@compiled
def _stop(x, width):  # type: ignore[no-untyped-def]
    """Elastic up to ``width``, then it slips."""
    z = np.zeros(len(x))
    for i in range(1, len(x)):
        z[i] = min(width, max(-width, z[i - 1] + x[i] - x[i - 1]))
    return z
