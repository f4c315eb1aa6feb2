"""A cause is a mechanism times a course: since an instant, for a while after every start, on one side of a play."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.diagnosis.days.evidence import Left
from pinotwin.diagnosis.days.forms import peak
from pinotwin.diagnosis.days.mechanisms import ENCODER, PLAY, after_starts, starts, zeros
from pinotwin.diagnosis.days.places import Felt, Sought, Span
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.row import Row
from pinotwin.diagnosis.days.score import density
from pinotwin.diagnosis.days.stretch import Stretch
from pinotwin.diagnosis.days.whitening import COUNTED, Whitening, settled
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.signals import rms, runs


def courses(
    r: Reference, logs: Sequence[Stretch], left: Sequence[Left], name: str, beside: Sequence[Row] = ()
) -> dict[str, Sought]:
    """Return what begins at an instant of each log or acts after starts, and the side of a play as a hidden state."""
    dry, w = [s.axes[name]["dry"] for s in logs], r.whitenings[name, "plant"]
    found = {"friction_at_start": _after_starts(r, logs, left, name)}
    if (late := since(logs, dry, left, (name, "plant"), beside, w)) is not None:
        found["friction_since"] = replace(late, again=lambda s: {name: s.axes[name]["dry"]})
    if (name, "law") in left[0]:
        found["dead_band"] = _dead_band(r, logs, left, name)
    if (name, "encoders") in left[0]:
        step = [s.axes[name]["one"] * ENCODER for s in logs]
        found["encoder_step"] = since(logs, step, left, (name, "encoders"), beside)
        found["lost_motion_either_side"] = _either_side(logs, left, name)
    return {k: x for k, x in found.items() if x is not None}


def since(
    logs: Sequence[Stretch],
    course: Sequence[Floats],
    left: Sequence[Left],
    key: tuple[str, str],
    beside: Sequence[Row] = (),
    w: Whitening | None = None,
) -> Sought | None:
    """Return a cause, (n,) in each log, since an instant, sought in what ``w`` whitens; None if from the start.

    Causes ``beside`` it may be as large as they like, and so may a constant between encoders.
    """
    axis, equation = key
    own = [f.acts[axis] for f in beside if equation in f.acts.get(axis, [{}])[0]]
    begin = list[float]()
    for k, (s, x, y) in enumerate(zip(logs, course, left, strict=True)):
        level = [np.ones(len(x))] if equation == "encoders" else []
        columns = np.column_stack([x, y[key], *level, *(each[k][equation] for each in own)])
        if w is not None:
            columns = w(columns) * w.counts(s.axes[axis], equation)[:, None]
        begin.append(onset(s, columns[:, 0], columns[:, 1], columns[:, 2:]))
    if max(begin) <= 1.0:
        return None
    late = [{axis: x * s.low((s.t > t).astype(float))} for s, x, t in zip(logs, course, begin, strict=True)]
    return Sought(late, 0.5 * SETTINGS.place * len(logs), equation, since=begin)


def onset(s: Stretch, course: Floats, left: Floats, known: Floats) -> float:
    """Return the instant [s] from which a course explains most of what is left beside ``known`` columns (n, k)."""
    Q = np.linalg.qr(known)[0]
    rest = left - Q @ (Q.T @ left)
    sums = np.column_stack([rest * course, course**2, Q * course[:, None]])
    both, own, *shared = np.cumsum(sums[::-1], axis=0)[::-1].T
    free = own - sum((x**2 for x in shared), np.zeros(len(own)))
    gain = both**2 / np.maximum(free, 1e-6 * float(course @ course) + 1e-300)
    return float(s.t[int(np.argmax(gain[: int(0.95 * len(gain))]))])


def _after_starts(r: Reference, logs: Sequence[Stretch], left: Sequence[Left], name: str) -> Sought | None:
    """Return friction for a while after every start from a stand, as of a brake that releases late."""
    size, y = r.widths[name]["effort"], [x[name, "plant"] for x in left]

    def column(s: Stretch, long: float, stand: float) -> Felt:
        return {name: after_starts(s, name, long, stand) * size}

    def gain(long: float, stand: float) -> float:
        return _gain([column(s, long, stand)[name] * s.axes[name]["moving"] for s in logs], y)

    stands = [x for x in (0.02, 0.08, 0.3) if all(len(starts(s, name, x)) > 1 for s in logs)]
    if not stands:
        return None
    longs = [peak(partial(gain, stand=x), np.geomspace(0.1, 0.6, 5).tolist()) for x in stands]
    long, stand = max(zip(longs, stands, strict=True), key=lambda x: gain(*x))
    again = partial(column, long=long, stand=stand)
    return Sought([again(s) for s in logs], SETTINGS.place, since=[long, stand], again=again)


def _dead_band(r: Reference, logs: Sequence[Stretch], left: Sequence[Left], name: str) -> Sought:
    """Return a controller that does nothing near its command: its number is the band over the usual error."""
    asked = [r.laws[name].effort(s.axes[name]) for s in logs]
    usual = float(np.mean([np.std(s.axes[name]["e"]) for s in logs]))

    def columns(band: float) -> list[Floats]:
        near = [np.abs(s.motion.error[:, s.motion.names.index(name)]) < band * usual for s in logs]
        each = zip(logs, asked, near, strict=True)
        return [-s.taken(np.interp(s.motion.t - s.motion.t[0], s.t, u) * x) / band for s, u, x in each]

    y = [x[name, "law"] for x in left]
    band = peak(lambda x: _gain(columns(x), y), np.geomspace(0.05, 1.0, 12).tolist())
    return Sought([{name: x} for x in columns(band)], SETTINGS.place, "law")


def _gain(columns: Sequence[Floats], left: Sequence[Floats]) -> float:
    """Return how much of what is left columns take up, (n,) of every stretch each; less than 0 with the wrong sign."""
    both = sum(float(a @ b) for a, b in zip(columns, left, strict=True))
    return both * abs(both) / max(sum(float(a @ a) for a in columns), 1e-300)


def _either_side(logs: Sequence[Stretch], left: Sequence[Left], name: str) -> Sought | None:
    """Return lost motion whose place in its gap is a hidden state; each change is paid for."""
    ends = [np.quantile(x[name, "encoders"], [0.1, 0.9]) for x in left]
    places = [_in_gap(x[name, "encoders"], *e) for x, e in zip(left, ends, strict=True)]
    sides = [x[np.abs(x) == 1.0] for x in places]
    turns = [int(np.sum(x[1:] != x[:-1])) for x in sides]
    reversals = [int(np.sum(np.diff(np.sign(s.axes[name]["memory"])) != 0.0)) for s in logs]
    wide = any(np.ptp(x[name, "encoders"]) > 2.0 * np.ptp(e) for x, e in zip(left, ends, strict=True))
    if wide or any(t < max(n, 3) for t, n in zip(turns, reversals, strict=True)):
        return None  # a spring, which no gap bounds, or a step: a play changes sides at every reversal
    price = 3.0 * sum(int(np.sum(x[1:] != x[:-1])) for x in places)
    pairs = zip(logs, places, ends, strict=True)
    columns = [{name: PLAY * (s.low(x) - e.sum() / max(np.ptp(e), 1e-300))} for s, x, e in pairs]
    return Sought(columns, price, "encoders")


def _in_gap(r: Floats, low: float, high: float) -> Floats:
    """Return where a load is in its gap, (n,): 1 at the low end to -1 at the high one, until another half is sure."""
    y = np.clip((low + high - 2.0 * r) / max(high - low, 1e-300), -1.0, 1.0)
    step = np.round(2.0 * y)
    sure = np.abs(2.0 * y - step) < 0.25
    return np.asarray(0.5 * step[np.maximum.accumulate(np.where(sure, np.arange(len(r)), 0))])


def spells(
    r: Reference, logs: Sequence[Stretch], key: tuple[str, str], row: Row, found: Sequence[Row] = ()
) -> list[Span]:
    """Return when something acts, begin and end in the time of its stretch [s]; nothing of what acts all the time.

    It acts with one size or not at all. Of all courses that come and go the most probable is taken, in which a change
    costs what an instant costs; where no row tells, the change is in the middle of those rows.

    ``key``: axis and equation; ``row``: of the cause, without a name of what leaves more than a healthy day; ``found``:
    other causes, which are taken off first.
    """
    w, counts = r.whitenings[key], [s.axes[key[0]][COUNTED[key[1]]] for s in logs]
    left = r.left(logs, *key)
    for gone in filter(None, (f.courses(*key) for f in found)):
        left = [y - x for y, x in zip(left, gone, strict=True)]
    pairs = [
        np.column_stack([y, _course(r, s, key, row, k)])
        for k, (s, y) in enumerate(zip(logs, left, strict=True))
    ]
    white = [w(x) * settled(m)[:, None] / w.weight for x, m in zip(pairs, counts, strict=True)]
    Y, X = np.concatenate(white).T
    acts, size, wide, one = np.ones(len(Y), dtype=bool), 1.0, 1.0, np.array(1.0 / w.spread)
    for turn in range(8):
        if not row.name:
            wide = max(rms(Y[acts]), 1.0)
        elif turn:
            size = float(X[acts] @ Y[acts] / max(X[acts] @ X[acts], 1e-300))
        told = density(((Y - size * X) / wide) ** 2, one) - density(Y**2, one) - np.log(wide) / w.spread
        before, each = acts, np.split(told, np.cumsum([len(x) for x in white])[:-1])
        acts = np.concatenate(parts := [acting(x, SETTINGS.place) for x in each])
        if not acts.any() or np.array_equal(acts, before):
            break
    rows = [(k, logs[k].t[at][counts[k][at] > 0.0]) for k, x in enumerate(parts) for at in runs(x)]
    return [] if acts.all() else [(k, float(t[0]), float(t[-1])) for k, t in rows if len(t)]


def _course(r: Reference, s: Stretch, key: tuple[str, str], row: Row, k: int) -> Floats:
    """Return what a cause would do to its equation in a stretch, (n,), if it acted all the time."""
    c = s.axes[key[0]]
    if not row.name:
        return np.zeros(len(s.t))
    turned = zeros(r, s, r.residuals(s)).get(f"zero:{key[0]}") if row.name == "zero_since" else None
    if turned is not None:
        return turned[key[0]] * row.theta
    if row.group == "onset":
        once = c["dry"] if row.name == "friction_since" else c["sg"] * r.widths[key[0]]["effort"]
        return np.asarray(once * row.theta)
    return row.courses(*key)[k]


def acting(told: Floats, price: float) -> Mask:
    """Return where a cause acts more probably than not, (n,), by each row's log odds, (n,), and a change's [nats]."""

    def odds(told: Floats, p: float = float(np.exp(-price))) -> Floats:
        out = [0.0]
        for x in told.tolist():
            o = np.exp(min(max(out[-1], -700.0), 700.0))
            out.append(float(np.log((o + p) / (p * o + 1.0))) + x)
        return np.array(out[1:])

    return np.asarray(odds(told) + odds(told[::-1])[::-1] - told > 0.0)
