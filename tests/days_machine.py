"""A slide that carries an arm, over days: plant, integrator, friction and controller are its own."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

RATE, STEPS = 250, 16  # rows a second, and steps of the integrator a row
CARRIAGE, ARM, REACH, INERTIA = 30.0, 4.0, 0.2, 0.3
GRAVITY = 9.81
URDF = """<robot name="days"><link name="frame"/>
<link name="slide"><inertial><mass value="33"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><origin xyz="0 0 -0.18"/><mass value="4.3"/>
<inertia ixx="0.1" iyy="0.14" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="X" type="prismatic"><parent link="frame"/><child link="slide"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="2000" velocity="3"/></joint>
<joint name="A" type="revolute"><parent link="slide"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="200" velocity="6"/></joint></robot>
"""
MACHINE = """name: days
urdf: days.urdf
axes:
  X: {joint: X, effects: [viscous, coulomb]}
  A: {joint: A, effects: [viscous, coulomb]}
"""


@dataclass
class Day:
    """One run: what differs from the healthy machine is a factor, or what is added."""

    command: int  # seed of the command
    noise: int  # seed of noise and of the day's friction
    friction: dict[str, float] = field(default_factory=dict)  # axis -> factor
    kp: dict[str, float] = field(default_factory=dict)  # axis -> factor of the position gain
    motor: dict[str, float] = field(default_factory=dict)  # axis -> torque that an effort gives, over nominal
    drift: dict[str, float] = field(default_factory=dict)  # axis -> how fast an effort grows [N/s, N·m/s]
    limit: dict[str, tuple[float, float, float]] = field(
        default_factory=dict
    )  # axis -> limit, its loss over speed, since
    idle: dict[str, float] = field(
        default_factory=dict
    )  # axis -> error up to which its controller does nothing
    sticks: dict[str, tuple[float, float]] = field(
        default_factory=dict
    )  # axis -> dry friction at rest over that in motion, less 1, and the speed at which it has gone [m/s, rad/s]
    forward: dict[str, float] = field(default_factory=dict)  # axis -> share of the speed fed forward
    ki: dict[str, float] = field(default_factory=dict)  # axis -> factor of the integral gain
    late: dict[str, int] = field(default_factory=dict)  # axis -> rows by which its controller acts late
    load: float = 0.0  # carried at the arm's end [kg]; the gains of both controllers follow the inertia
    ahead: float = 0.0  # acceleration feed-forward of both controllers, over the inertia they are told
    began: float = 0.0  # how long it has been growing before the run [s]
    seconds: float = 10.0


def commands(seed: int, n: int) -> np.ndarray:
    """Return smooth moves of both axes, shape (n, 2) [m, rad]."""
    rng, t, out = np.random.default_rng(seed), np.arange(n) / RATE, np.zeros((n, 2))
    for j, reach in enumerate((0.25, 0.9)):
        at, x = 0.3, 0.0
        while at < t[-1] - 1.0:
            to, long = float(rng.uniform(-reach, reach)), float(rng.uniform(0.5, 1.1))
            s = np.clip((t - at) / long, 0.0, 1.0)
            out[:, j] += (to - x) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
            at, x = at + long + float(rng.uniform(0.0, 0.3)), to
    return out


def run(day: Day) -> dict[str, np.ndarray]:
    """Return the log of a day, by Euler steps of 0.25 ms."""
    rng, n = np.random.default_rng(day.noise), int(day.seconds * RATE)
    qr, dt = commands(day.command, n), 1.0 / RATE / STEPS
    vr = np.gradient(qr, 1.0 / RATE, axis=0)
    ar = np.gradient(vr, 1.0 / RATE, axis=0) * day.ahead
    today = [float(1.0 + 0.03 * rng.standard_normal()) * day.friction.get(k, 1.0) for k in "XA"]
    dry, viscous = (25.0, 1.2), (60.0, 0.9)
    kp = [40.0 * day.kp.get("X", 1.0), 45.0 * day.kp.get("A", 1.0)]
    arm, turned = ARM + day.load, INERTIA + day.load * REACH**2
    told = (CARRIAGE + arm) / (CARRIAGE + ARM), turned / INERTIA
    kv = (1800.0 * told[0], 22.0 * told[1])
    ki = [x * told[j] * day.ki.get(k, 1.0) for j, (k, x) in enumerate([("X", 70000.0), ("A", 900.0)])]
    give = [day.motor.get(k, 1.0) for k in "XA"]
    more, slow = zip(*(day.sticks.get(k, (0.0, 1.0)) for k in "XA"), strict=True)
    step, wanted = (1e-6, 2e-6), [[0.0] * day.late.get(k, 0) for k in "XA"]
    q, v, total, u = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
    out = {f"{k}.{c}": np.zeros(n) for k in "XA" for c in ("qr", "q", "u")}
    for i in range(n):
        seen = [round(q[j] / step[j]) * step[j] for j in (0, 1)]
        for j, k in enumerate("XA"):
            wish = kp[j] * (qr[i, j] - seen[j]) + day.forward.get(k, 0.9) * vr[i, j] - v[j]
            most, loss, since = day.limit.get(k, (math.inf, 0.0, 0.0))
            most = math.inf if i / RATE < since else most - loss * abs(v[j]) * (u[j] * v[j] > 0.0)
            asked = kv[j] * wish + total[j] + ki[j] * wish / RATE + (CARRIAGE + arm, turned)[j] * ar[i, j]
            asked *= abs(qr[i, j] - seen[j]) >= day.idle.get(k, 0.0)
            wanted[j].append(asked)
            asked = wanted[j].pop(0)
            u[j] = max(-most, min(most, asked))
            total[j] += ki[j] * wish / RATE * (u[j] == asked)
            out[f"{k}.qr"][i], out[f"{k}.q"][i], out[f"{k}.u"][i] = qr[i, j], seen[j], u[j]
        for _ in range(STEPS):
            rest = [dry[j] * (1.0 + more[j] * math.exp(-((v[j] / slow[j]) ** 2))) for j in (0, 1)]
            rub = [today[j] * (rest[j] * math.tanh(v[j] / 1e-3) + viscous[j] * v[j]) for j in (0, 1)]
            c, s = math.cos(q[1]), math.sin(q[1])
            # tau_X = (M + m) x'' - m l (c p'' - s p'^2); tau_A = J p'' - m l c x'' + m g l s
            h = arm * REACH
            pull = [day.drift.get(k, 0.0) * (day.began + i / RATE) for k in "XA"]
            f0 = give[0] * u[0] - rub[0] - pull[0] - h * s * v[1] ** 2
            f1 = give[1] * u[1] - rub[1] - pull[1] - h * GRAVITY * s
            m00, m01, m11 = CARRIAGE + arm, -h * c, turned
            det = m00 * m11 - m01 * m01
            a0, a1 = (m11 * f0 - m01 * f1) / det, (m00 * f1 - m01 * f0) / det
            v = [v[0] + dt * a0, v[1] + dt * a1]
            q = [q[0] + dt * v[0], q[1] + dt * v[1]]
    for k, size in (("X", 0.8), ("A", 0.02)):
        out[f"{k}.u"] += size * rng.standard_normal(n)
    return {"t": np.arange(n) / RATE, **out}


def write(folder: Path, name: str, day: Day) -> Path:
    """Write the log of a day as CSV and return its path."""
    log = run(day)
    path = folder / f"{name}.csv"
    np.savetxt(
        path,
        np.column_stack(list(log.values())),
        delimiter=",",
        header=",".join(log),
        comments="",
        fmt="%.9g",
    )
    return path


def machine(folder: Path) -> Path:
    """Write the machine that a user would have: masses and inertias of a CAD that is a few per cent off."""
    (folder / "days.urdf").write_text(URDF)
    path = folder / "machine.yaml"
    path.write_text(MACHINE)
    return path
