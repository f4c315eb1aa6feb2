"""Errors of a second encoder that repeat along the stroke, or are any smooth function of it but a zero and a scale.

Each is one column, of the shape that leaves least beside a healthy day; search and numbers of the shape are paid for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import null_space

from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.evidence import Left
from pinotwin.diagnosis.days.forms import peak
from pinotwin.diagnosis.days.healthy import healthy_day
from pinotwin.diagnosis.days.mechanisms import ENCODER
from pinotwin.diagnosis.days.places import Felt, Sought
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.stretch import Stretch, corner
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.effects.sensing import EncoderError
from pinotwin.signals import hats

KNOTS, MOST_WAVES, ORDERS = 12, 160, np.array([1.0, 2.0])
"""Of an error along a stroke: its knots, or its waves along it at most, and their orders."""


def encoder_errors(
    r: Reference, logs: Sequence[Stretch], left: Sequence[Left], name: str
) -> dict[str, Sought]:
    """Return an error along the stroke of an axis, and one that repeats, of what its encoders leave of stretches."""
    q, v = (np.concatenate([s.axes[name][k] for s in logs]) for k in "qv")
    low, high = float(q.min()), float(q.max())
    size = high - low
    if not size > 0.0:
        return {}
    machine, y = r.twin.machine, np.concatenate([x[name, "encoders"] for x in left])
    day = np.linalg.qr(np.concatenate([healthy_day(r, s, name, {})["encoders"] for s in logs]))[0]
    # Of a wave what the low-pass lets through at a speed: waves a second over its corner.
    pace = np.abs(v[:, None]) / corner(1.0 / logs[0].cycle)

    def power(period: float) -> float:
        x = _waves(q, period) / (1.0 + (pace * np.tile(ORDERS, 2) / period) ** 6)
        x -= day @ (day.T @ x)
        both = x.T @ y
        return float(both @ np.linalg.solve(x.T @ x + 1e-6 * len(q) * np.eye(len(both)), both))

    tried = size / np.arange(2.0, MOST_WAVES, 0.5)
    period = peak(power, tried.tolist())
    bent, number = null_space(np.stack([np.ones(KNOTS), np.arange(KNOTS)])), SETTINGS.number
    column = partial(_column, logs, y, day, name)
    along = column(lambda x: hats(x, low, high, KNOTS) @ bent, bent.shape[1] * number)
    again = column(lambda x: _waves(x, period), 2.0 * len(ORDERS) * number + float(np.log(len(tried))))
    form = EncoderError(name, bool(machine.rotary[machine.names.index(name)]), period)
    return {"encoder_along": along, "encoder_period": replace(again, form=form, place=None)}


def _waves(x: Floats, period: float) -> Floats:
    angle = 2.0 * np.pi / period * x[:, None] * ORDERS
    return np.hstack([np.sin(angle), np.cos(angle)])


def _column(
    logs: Sequence[Stretch],
    y: Floats,
    day: Floats,
    name: str,
    shape: Callable[[Floats], Floats],
    price: float,
) -> Sought:
    """Return the one column of functions of the place that leaves least of ``y`` beside a day, largest where it is."""

    def each(s: Stretch) -> Floats:
        return s.taken(shape(s.motion.q[:, s.motion.names.index(name)]))

    X = np.concatenate([each(s) for s in logs])
    numbers = np.linalg.lstsq(np.column_stack([X, day]), y, rcond=1e-6)[0][: X.shape[1]]
    numbers *= ENCODER / max(float(np.abs(X @ numbers).max()), 1e-300)

    def again(s: Stretch) -> Felt:
        return {name: np.asarray(each(s) @ numbers)[:, None]}

    acts = [again(s) for s in logs]
    most = np.abs(np.concatenate([x[name] for x in acts])[:, 0])
    at = np.concatenate([s.axes[name]["q"] for s in logs])[most >= 0.5 * most.max()]
    place = (0.5 * float(at.max() + at.min()), 0.25 * float(np.ptp(at)))
    return Sought(acts, price, "encoders", place=place, again=again)
