"""Random axes, drives, commands and faults of a log, for properties that must hold on all of them.

The truth is written out here and shares nothing with the model: one mass with viscous and dry friction, a drive
of 1 to 8 kHz (cascade, set-point weight, PID, no integral; notch, current loop, limit), commands from jerk-limited
moves to steps, and logs as they come from a shop floor: short, coarse, with holes, saturated, or counted backwards.
"""

from __future__ import annotations

import dataclasses
import json
import math
import traceback
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

import pinotwin as pt
from pinotwin.columns import Column
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.machine import Machine

SPOILED = ("none", "none", "none", "none", "hole", "nan", "jitter", "backwards", "scale", "late", "still")
WHOLE = ("none", "hole", "nan", "jitter")
"""What is done to a log, and what leaves its numbers what they were."""


@dataclass(frozen=True)
class Drive:
    """An axis and its drive; SI.

    Attributes:
        kind: ``cascade``, ``pid`` or ``proportional``.
        gains: kp, kv, ki (of velocity error), weight of the velocity command, ffv, ffa.
        lags: time constants of the velocity's filter and of the current loop [s].
        notch: frequency [Hz], 0 for none.
        plant: mass, viscous friction, Coulomb level, effort limit.
        rate: of the controller [Hz].
        steps: of encoder and of effort as logged, and noise of the effort.
    """

    kind: str
    gains: tuple[float, ...]
    lags: tuple[float, float]
    notch: float
    plant: tuple[float, float, float, float]
    rate: float
    steps: tuple[float, float, float]


def drawn(rng: np.random.Generator) -> Drive:
    """Return a drive whose loop is stable, with gains up to twice off what its maker would choose."""
    M = float(np.exp(rng.uniform(math.log(5.0), math.log(500.0))))
    rate = float(rng.choice([1000, 2000, 4000, 8000]))
    w = 2.0 * math.pi * float(rng.uniform(3.0, 14.0))
    off = np.exp(rng.uniform(-0.6, 0.6, 3))
    kind = str(rng.choice(["cascade", "cascade", "pid", "proportional"]))
    kp, kv, ki = 0.7 * w * off[0], 2.2 * M * w * off[1], 1.4 * M * w * w * off[2]
    ffv, ffa = float(rng.choice([0.0, rng.uniform(0.8, 1.0), 1.0])), float(rng.uniform(0.0, 1.0)) * M
    weight = float(rng.choice([1.0, rng.uniform(0.3, 0.9)]))
    if kind == "proportional":
        ki = 0.0
    coulomb = float(rng.choice([0.0, M * rng.uniform(0.1, 1.0)]))
    limit = float(M * rng.uniform(2.0, 5.0)) if rng.random() < 0.15 else math.inf
    current = float(rng.choice([0.0, 1.0 / (2.0 * math.pi * rng.uniform(300.0, 1500.0))]))
    return Drive(
        kind,
        (kp, kv, ki, weight, ffv, ffa),
        (1.0 / (2.0 * math.pi * rng.uniform(200.0, 900.0)), current),
        float(rng.uniform(70.0, 200.0)) if rng.random() < 0.25 else 0.0,
        (M, M * float(rng.uniform(0.0, 3.0)), coulomb, limit),
        rate,
        (float(10.0 ** rng.uniform(-8.5, -5.5)), M * 1e-3, M * float(rng.choice([0.0, 0.02, 0.2]))),
    )


def command(rng: np.random.Generator, seconds: float, rate: float) -> np.ndarray:
    """Return a command: moves, sines, a slow ramp to and fro, or moves with steps in them."""
    t = np.arange(round(seconds * rate)) / rate
    kind = str(rng.choice(["moves", "moves", "sines", "ramp", "steps"]))
    if kind == "sines":
        return sum(
            0.03 * math.sin(i + 1.0) * np.sin(2.0 * math.pi * rng.uniform(0.2, 3.0) * t) for i in range(4)
        )
    if kind == "ramp":
        return 0.1 * (1.0 - np.cos(2.0 * math.pi * t / seconds))
    edges = np.sort(rng.uniform(0.0, seconds, max(2, round(1.5 * seconds))))
    to = rng.uniform(-0.15, 0.15, len(edges) + 1)
    x = to[np.searchsorted(edges, t)]
    ramp = max(3, round(0.25 * rate))
    kernel = np.hanning(ramp + 2)[1:-1]
    smooth = np.convolve(np.pad(x, ramp, mode="edge"), kernel / kernel.sum(), mode="same")[ramp:-ramp]
    return smooth if kind == "moves" else smooth + 1e-4 * np.sign(np.sin(2.0 * math.pi * t))


def run(drive: Drive, qr: np.ndarray, rate: float, rng: np.random.Generator) -> dict[str, np.ndarray] | None:
    """Return what the drive logs along a command, None where it does not hold it."""
    h = 1.0 / drive.rate
    t = np.arange(len(qr)) / rate
    fine = np.arange(round(t[-1] * drive.rate) + 1) * h
    spline = CubicSpline(t, qr)
    r, vr, ar = (spline(fine, k).tolist() for k in range(3))
    kp, kv, ki, weight, ffv, ffa = drive.gains
    M, B, coulomb, limit = drive.plant
    see = 1.0 - math.exp(-h / drive.lags[0])
    lag = 1.0 - math.exp(-h / drive.lags[1]) if drive.lags[1] else 1.0
    b0, b1, b2, a1, a2 = _notch(drive.notch, h)
    q = last = r[0]
    v = seen = total = out = x1 = x2 = y1 = y2 = 0.0
    rows = np.empty((len(fine), 2))
    for k in range(len(fine)):
        reading = round(q / drive.steps[0]) * drive.steps[0]
        if k == 0:
            last = reading
        seen += see * ((reading - last) / h - seen)
        last, e = reading, r[k] - reading
        slip = kp * e + ffv * vr[k] - seen
        if drive.kind == "pid":
            u, more = kv * (kp * e + vr[k] - seen) + total + ffa * ar[k], ki * kp * e
        else:
            u, more = kv * (kp * e + weight * ffv * vr[k] - seen) + total + ffa * ar[k], ki * slip
        y = b0 * u + b1 * x1 + b2 * x2 - a1 * y1 - a2 * y2
        x2, x1, y2, y1, u = x1, u, y1, y, y
        if abs(u) <= limit:
            total += h * more
        u = min(max(u, -limit), limit)
        out += lag * (u - out)
        rows[k] = reading, out
        v += h * (out - B * v) / M
        v -= min(max(v, -h * coulomb / M), h * coulomb / M)
        q += h * v
        if not abs(q) < 1.0:
            return None
    at = np.minimum(np.round(t * drive.rate).astype(int), len(fine) - 1)
    u = rows[at, 1] + drive.steps[2] * rng.normal(size=len(t))
    return {"t": t, "X.qr": qr, "X.q": rows[at, 0], "X.u": np.round(u / drive.steps[1]) * drive.steps[1]}


def _notch(frequency: float, h: float) -> tuple[float, ...]:
    """Return b0, b1, b2, a1, a2 of a notch by the bilinear map; what passes everything for 0 Hz."""
    if frequency == 0.0:
        return 1.0, 0.0, 0.0, 0.0, 0.0
    t = math.tan(math.pi * frequency * h)
    a0 = 1.0 + 1.2 * t + t * t
    middle = 2.0 * (t * t - 1.0) / a0
    return (
        (1.0 + 0.16 * t + t * t) / a0,
        middle,
        (1.0 - 0.16 * t + t * t) / a0,
        middle,
        (1.0 - 1.2 * t + t * t) / a0,
    )


def _on_command(drive: Drive, rows: dict[str, np.ndarray]) -> bool:
    """Whether a drive does what it is for: one that swings between its limits is no machine to identify."""
    limited = np.abs(rows["X.u"]) > 0.98 * drive.plant[3]
    return bool(np.max(np.abs(rows["X.qr"] - rows["X.q"])) < 0.02 and np.mean(limited) < 0.2)


def spoiled(rows: dict[str, np.ndarray], how: str, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return a log with a fault of its recording."""
    n, rows = len(rows["t"]), {k: x.copy() for k, x in rows.items()}
    start = int(rng.integers(n // 4, n // 2))
    if how == "hole":
        keep = np.ones(n, dtype=bool)
        keep[start : start + max(3, n // 20)] = False
        rows = {k: x[keep] for k, x in rows.items()}
    elif how == "nan":
        rows["X.u"][start : start + 5] = np.nan
    elif how == "backwards":
        rows["X.u"] *= -1.0
    elif how == "scale":
        rows["X.u"] *= float(rng.choice([0.01, 0.3, 3.0, 100.0]))
    elif how == "jitter":
        rows["t"] = rows["t"] + 0.02 * float(rows["t"][1]) * rng.normal(size=n)
    elif how == "still":
        rows["X.q"][:], rows["X.qr"][:] = rows["X.q"][0], rows["X.qr"][0]
    elif how == "late":
        rows["X.u"] = np.roll(rows["X.u"], int(rng.integers(1, 8)))
    return rows


def machine() -> Machine:
    """Return a machine of one linear axis whose mass is not known within a factor of ten."""
    return dataclasses.replace(Machine.load("emps"), columns={})


def case(seed: int) -> tuple[str, Log, Log]:
    """Return what was done to a random log, the log, and another one of the same drive."""
    rng = np.random.default_rng([15, seed])
    while True:
        drive, rate = drawn(rng), float(rng.choice([100, 200, 250, 500, 1000]))
        seconds = float(rng.uniform(2.0, 7.0))
        both = [run(drive, command(rng, s, rate), rate, rng) for s in (seconds, 2.0)]
        if all(x is not None and _on_command(drive, x) for x in both):
            break
    how = str(rng.choice(SPOILED))
    made, other = both
    assert made is not None
    assert other is not None
    return how, Log(spoiled(made, how, rng), source=f"random {seed}"), Log(other, source=f"unseen {seed}")


@dataclass(frozen=True)
class Answer:
    """What became of a random log.

    Attributes:
        how: what was done to it.
        end: ``simulated``, ``identify refused``, ``no controller``, ``simulate refused`` or ``wrong``.
        wrong: what must not be; empty where nothing is.
    """

    how: str
    end: str
    wrong: str = ""


def asked(seed: int) -> Answer:
    """Identify a random log and simulate its own command and another one."""
    how, log, other = case(seed)
    try:
        return _answered(how, log, other)
    except Exception:  # noqa: BLE001 - whatever it is, a user would see it
        return Answer(how, "wrong", traceback.format_exc())


def _as_exported(log: Log) -> tuple[Machine, Log]:
    """Return the log with a clock as controllers export it, in ms and of another name, and the machine that says so."""
    columns = {"t": Column("Time", unit="ms")}
    channels = {("Time" if k == "t" else k): (1e3 * x if k == "t" else x) for k, x in log.channels.items()}
    return dataclasses.replace(machine(), columns=columns), Log(channels, source=log.source)


def _answered(how: str, log: Log, other: Log) -> Answer:
    try:
        twin = pt.identify(*_as_exported(log))
    except PinotwinError as error:
        wrong = "" if how == "still" and "no usable row" in str(error) else f"identify refused: {error}"
        return Answer(how, "identify refused", wrong if how in (*WHOLE, "still") else "")
    unstable = [p for loop in twin.loops.values() for p in loop.poles if not p.real < 0.0]
    if unstable:
        return Answer(how, "wrong", f"unstable poles {unstable}")
    if not twin.servos:
        said = any("no controller of X" in note for note in twin.quality["warnings"])
        return Answer(
            how, "no controller", "" if said and how not in WHOLE else "no controller, or nothing said"
        )
    for servo in twin.servos.values():
        json.dumps(servo.to_dict(), allow_nan=False)
    for asks in (log, other):
        try:
            said = twin.simulate(Log({k: asks[k] for k in ("t", "X.qr")}, source="command"))
        except PinotwinError as error:
            wrong = f"simulate refused: {error}" if how in WHOLE else ""
            return Answer(how, "simulate refused", wrong)
        if not all(np.isfinite(said[f"X.{k}"]).all() for k in "qeu"):
            return Answer(how, "wrong", "not a number")
        if np.max(np.abs(said["X.e"])) > np.ptp(asks["X.qr"]):
            return Answer(how, "wrong", "further off than the command travels")
    return Answer(how, "simulated")
