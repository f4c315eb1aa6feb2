"""Laws to start from: the gains by least squares, for a few lags and notches.

The columns go through their own filters on a fine clock; encoder noise that is fed back biases this answer.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.identification.servo.law_alone import Clock
from pinotwin.identification.servo.output_error import free_gains, misfit
from pinotwin.identification.servo.problem import AxisProblem
from pinotwin.loop.servo import Servo

NOTCHES = (60.0, 75.0, 95.0, 120.0, 150.0, 190.0)  # Frequencies at which a notch is looked for [Hz]
NOTCH = (0.1, 0.6)  # Damping ratios of its zeros and poles, to start with
LAGS = (1e-4, 2e-4, 4e-4, 8e-4, 1.6e-3)
"""Time constants of the velocity's filter from which the search starts [s]."""
OUTPUT_LAG, DEAD = 2e-4, 1.2e-4  # Lag of the current loop and dead time from which the search starts [s]


def _columns(p: AxisProblem) -> list[tuple[Floats, Floats]]:
    """Return the law's columns on the fine clock, unfiltered, (6, m), and u of every window."""
    clock, out = Clock(p.step, p.substeps), []
    for s in p.windows:
        qr, vr, ar = clock.refined(p.qr[s], 1, 2)
        q, v = clock.refined(p.q[s], 1)
        e = qr - q
        out.append((np.stack([e, clock.h * np.cumsum(e), -v, vr, qr - qr[0], ar]), p.u[s]))
    return out


def _solved(p: AxisProblem, form: Servo, columns: list[tuple[Floats, Floats]]) -> tuple[float, Servo]:
    """Return the gains of a form by least squares; each window's constant is projected out."""
    clock = Clock(p.step, p.substeps, held=True)
    rows, efforts = [], []
    for fine, u in columns:
        picked, y = clock.out(clock.seen(fine, form), form)[:, p.skip :], u[p.skip :]
        rows.append(picked - picked.mean(axis=1, keepdims=True))
        efforts.append(y - y.mean())
    X, y = np.concatenate(rows, axis=1).T, np.concatenate(efforts)
    kept = free_gains(form)
    size = np.maximum(np.sqrt(np.mean(X[:, kept] ** 2, axis=0)), 1e-300)
    gains = np.zeros(6)
    gains[kept] = np.linalg.lstsq(X[:, kept] / size, y, rcond=1e-9)[0] / size
    left = y - X @ gains
    return float(left @ left), replace(form, gains=tuple(gains.tolist()))


def proportional(p: AxisProblem, near: Servo) -> Servo:
    """Return the law without an integral by least squares, with the filters of another."""
    columns = _columns(p)
    servo = _solved(p, replace(near, form="proportional"), columns)[1]
    parts = [u[p.skip :] - np.array(servo.gains) @ x[:, :: p.substeps][:, p.skip :] for x, u in columns]
    return replace(servo, offset=float(np.mean(np.concatenate(parts))))


def starts(p: AxisProblem, places: int = 3) -> list[Servo]:
    """Return laws by least squares that keep the simulated axis on its command, with and without a notch."""
    columns = _columns(p)
    found = []
    for notch in ((0.0, 0.0, 1.0), *((f, *NOTCH) for f in NOTCHES)):
        forms = [Servo((0.0,) * 6, lag, OUTPUT_LAG, notch, DEAD, step=p.step) for lag in LAGS]
        servo = min((_solved(p, form, columns) for form in forms), key=lambda x: x[0])[1]
        r = misfit(p, servo)
        found.append((np.inf if r is None else float(r @ r), servo))
    plain, *notched = found
    likely = sorted(notched, key=lambda x: x[0])[:places]
    return [servo for cost, servo in (plain, *likely) if np.isfinite(cost)]
