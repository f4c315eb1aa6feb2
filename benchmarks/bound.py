"""Do 95 % intervals hold? A two-axis arm whose friction sticks, under coloured noise and behind encoder steps.

    python -m benchmarks bound --logs 24 --first 0 --seconds 14

For each law of friction (none but Coulomb's, Dahl, LuGre, generalised Maxwell slip) and encoder step, the share of
intervals that hold the truth, over all parameters and of the worst. The inertias, gravity and viscous friction are
known; the level of dry friction is that of sliding at speed. What no interval covers is a wrong law: LuGre and
Maxwell slip have friction that the model (Coulomb and viscous) account.
"""

from __future__ import annotations

import argparse
import time

import numba
import numpy as np
import pinocchio as pin
from scipy.signal import lfilter

import pinotwin as pt
from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import parameters

STEP, SUBSTEPS, GRAVITY = 0.002, 20, 9.81  # s, -, m/s^2
MASS, CENTRE, INERTIA, LENGTH = (
    (4.0, 2.5),
    (0.3, 0.25),
    (0.12, 0.05),
    0.5,
)  # kg, m, kg m^2 about the centre, m
VISCOUS, DRY = np.array([2.0, 0.6]), np.array([3.0, 1.2])  # N·m·s/rad, N·m
DISTANCE = np.array([2e-4, 3e-4])  # over which friction turns [rad]
NOISE, MEMORY = np.array([0.15, 0.06]), 0.006  # of the effort [N·m] and how long it is correlated [s]
LAWS = ("coulomb", "dahl", "lugre", "maxwell")
LEVELS, STIFF = (
    np.array([0.4, 0.3, 0.2, 0.1]),
    np.array([0.1, 0.2, 0.3, 0.4]),
)  # of Maxwell's elements, shares


def arm() -> pin.Model:
    """Return the arm, hanging down, whose joints turn about y."""
    model, parent = pin.Model(), 0
    for k, name in enumerate("AB"):
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, -LENGTH * k]))
        parent = model.addJoint(parent, pin.JointModelRY(), place, name)
        about = np.diag([INERTIA[k], INERTIA[k], 0.2 * INERTIA[k]])
        body = pin.Inertia(MASS[k], np.array([0.0, 0.0, -CENTRE[k]]), about)
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    return model


def command(rng: np.random.Generator, seconds: float) -> Floats:
    """Return jerk-limited moves with rests, shape (n, 2) [rad]: some far and fast, some short and slow."""
    t = np.arange(round(seconds / STEP)) * STEP
    out, q, start = np.zeros((len(t), 2)), np.zeros(2), 0.4
    while start < seconds - 0.3:
        way = rng.uniform(-1, 1, 2) * (1.2 if rng.random() < 0.6 else 0.08) * (rng.random(2) < 0.75)
        to = np.clip(q + way, -1.5, 1.5)
        lasts = max(0.25, np.abs(to - q).max() / (1.5 if rng.random() < 0.7 else 0.25))
        s = np.clip((t - start) / lasts, 0.0, 1.0)
        out += np.outer(s**3 * (10 - 15 * s + 6 * s**2), to - q)
        q, start = to, start + lasts + rng.uniform(0.05, 0.6)
    return out


@numba.njit(cache=True)
def friction(law: int, i: int, v: float, z: Floats, h: float) -> float:
    """Advance the states z (4,) by h [s] and return friction over its level at speed [-]."""
    x = DISTANCE[i]
    if law == 0:
        return np.tanh(v / 1e-3)
    if law == 1:
        s = np.sign(v)
        z[0] = s + (z[0] - s) * np.exp(-abs(v) * h / x)
        return z[0]
    level = 1.0 + 0.3 * np.exp(-((v / 0.02) ** 2))
    if law == 2:
        rate = (v - abs(v) * z[0] / level) / x
        z[0] += rate * h
        return z[0] + 2e-4 * rate
    for k in range(4):
        most = LEVELS[k] * level
        z[k] = min(max(z[k] + STIFF[k] * v * h / x, -most), most)
    return z.sum()


@numba.njit(cache=True)
def run(law: int, qr: Floats, vr: Floats, ar: Floats) -> tuple[Floats, Floats]:
    """Return positions and efforts of the arm under PID with feed-forward, shapes (n, 2)."""
    kp, kd, ki = np.array([1500.0, 400.0]), np.array([70.0, 18.0]), np.array([4000.0, 1500.0])
    a1 = INERTIA[0] + MASS[0] * CENTRE[0] ** 2 + MASS[1] * LENGTH**2
    a2, a3 = INERTIA[1] + MASS[1] * CENTRE[1] ** 2, MASS[1] * LENGTH * CENTRE[1]
    g1, g2 = GRAVITY * (MASS[0] * CENTRE[0] + MASS[1] * LENGTH), GRAVITY * MASS[1] * CENTRE[1]
    q, v, total, z, h = qr[0].copy(), np.zeros(2), np.zeros(2), np.zeros((2, 4)), STEP / SUBSTEPS
    positions, efforts = np.empty_like(qr), np.empty_like(qr)
    for n in range(len(qr)):
        for j in range(SUBSTEPS):
            t = h * j
            e = qr[n] + vr[n] * t + 0.5 * ar[n] * t * t - q
            total += e * h
            u = kp * e + kd * (vr[n] + ar[n] * t - v) + ki * total
            if j == 0:
                positions[n], efforts[n] = q, u
            c, s, hang = np.cos(q[1]), np.sin(q[1]), g2 * np.sin(q[0] + q[1])
            F = np.array([DRY[i] * friction(law, i, v[i], z[i], h) + VISCOUS[i] * v[i] for i in range(2)])
            b1 = u[0] - F[0] - g1 * np.sin(q[0]) - hang + a3 * s * (2 * v[0] * v[1] + v[1] ** 2)
            b2 = u[1] - F[1] - hang - a3 * s * v[0] ** 2
            m11, m12 = a1 + a2 + 2 * a3 * c, a2 + a3 * c
            det = m11 * a2 - m12**2
            v += np.array([a2 * b1 - m12 * b2, m11 * b2 - m12 * b1]) / det * h
            q = q + v * h
    return positions, efforts


def log(seed: int, law: str, seconds: float, encoder: float) -> pt.Log:
    """Return a log of the arm with friction of a law and encoders of a step [rad]."""
    rng = np.random.default_rng([seed, 7])
    qr = command(rng, seconds)
    vr = np.gradient(qr, STEP, axis=0)
    q, u = run(LAWS.index(law), qr, vr, np.gradient(vr, STEP, axis=0))
    rho = np.exp(-STEP / MEMORY)
    white = rng.standard_normal((len(q) + 200, 2)) * NOISE * np.sqrt(1 - rho**2)
    u = u + lfilter([1], [1, -rho], white, axis=0)[200:]
    q = np.round(q / encoder) * encoder
    return pt.Log.from_arrays(np.arange(len(q)) * STEP, q=q, u=u, axes=["A", "B"])


def holds(machine: pt.Machine, twin: pt.Twin) -> dict[str, bool]:
    """Return whether the interval of each determined parameter holds the truth."""
    base = machine.base.from_standard(parameters(machine.model))
    truth = dict(zip((p.name for p in twin.parameters if p.effect == "rigid_body"), base, strict=True))
    for axis, b, c in zip("AB", VISCOUS, DRY, strict=True):
        truth |= {f"{axis}.viscous.b": b, f"{axis}.coulomb.c": c}
    out = {}
    for p in twin.parameters:
        if p.determined:
            low, high = p.interval()
            out[p.name] = bool(low <= truth[p.name] <= high)
    return out


def main() -> None:
    """Print the share of intervals that hold, by law and encoder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=24)
    parser.add_argument("--first", type=int, default=0, help="seed of the first log")
    parser.add_argument("--seconds", type=float, default=14.0)
    parser.add_argument("--laws", nargs="+", choices=LAWS, default=LAWS)
    parser.add_argument("--encoders", nargs="+", type=float, default=[1e-7, 2e-5], help="steps [rad]")
    args = parser.parse_args()
    machine = pt.Machine.from_model(arm())
    for law in args.laws:
        for encoder in args.encoders:
            start, hits = time.process_time(), []
            for seed in range(args.first, args.first + args.logs):
                taken = log(seed, law, args.seconds, encoder)
                hits.append(holds(machine, pt.identify(machine, taken, loop=False, consistent=False)))
            share = {name: np.mean([h[name] for h in hits if name in h]) for name in hits[0]}
            worst = min(share, key=share.__getitem__)
            mean = np.mean([x for h in hits for x in h.values()])
            print(
                f"{law:8s} step {encoder:g} rad: {100 * mean:.1f} % hold, worst {worst} {100 * share[worst]:.0f} %,"
                f" {len(share)} parameters, {args.logs} logs, {time.process_time() - start:.0f} CPU s",
                flush=True,
            )


if __name__ == "__main__":
    main()
