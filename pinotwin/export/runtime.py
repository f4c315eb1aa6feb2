"""The inverse model of a twin in plain NumPy: effort from position, velocity and acceleration.

This module imports nothing of pinotwin, for its text is what an exported file consists of, followed by
the numbers of one machine. Rigid body: recursive Newton-Euler (Featherstone 2008, 10.1007/978-1-4899-7560-7,
sec. 5.3). Everything else: piecewise-linear curves of position or speed, and the memory of dry friction.

    tau = M(q) a + h(q, v) + C v + K q + f(q) + g(v) + dry friction                 [N or N·m]
"""

from __future__ import annotations

from typing import Any

import numpy as np


class Friction:
    """Every effort that is not the rigid body's, with the memory of dry friction as state.

    Args:
        data: numbers of the machine, as written by `pinotwin export`.
    """

    def __init__(self, data: dict[str, Any]) -> None:
        self.nv = len(data["names"])
        self.viscous = np.array(data["viscous"], dtype=float)
        self.stiffness = np.array(data["stiffness"], dtype=float)
        self.position = data["position"]
        self.velocity = data["velocity"]
        self.dry = data["dry"]
        self.slip = data["slip"]
        self.coupled = data["coupled"]
        self.reset(np.zeros(self.nv), np.zeros(self.nv))

    def reset(self, q: Any, v: Any, step: float = 0.0) -> None:
        """Forget the past: the machine is at ``q`` [m or rad] and moves with ``v``.

        Args:
            q: positions, shape (nv,).
            v: velocities, shape (nv,).
            step: sampling interval [s]; dry friction that gives way before it slips (presliding) is
                taken to have moved as now for 20 samples.
        """
        speeds = [self._sliding(row, v) for row in self.dry]
        self.turn = [_direction(s, row["slope"]) for s, row in zip(speeds, self.dry, strict=True)]
        self.before = speeds
        self.bend, self.bristle, self.where = [], [], []
        for row in self.slip:
            past = 20.0 * step * float(v[row["joint"]])
            self.bend.append([min(1.0, max(-1.0, past / y)) for y in row["yields"]])
            self.bristle.append(np.sign(past) * (1.0 - np.exp(-abs(past) / row["x_s"])))
            self.where.append(float(q[row["joint"]]))

    def state(self) -> list[list[Any]]:
        """Return the memory, for :meth:`restore`."""
        return [list(x) for x in (self.turn, self.before, self.bristle, self.where, *self.bend)]

    def restore(self, state: list[list[Any]]) -> None:
        """Take back a memory."""
        self.turn, self.before, self.bristle, self.where, *self.bend = map(list, state)

    def effort(self, q: Any, v: Any, a: Any = None) -> Any:
        """Return the effort [N or N·m], shape (nv,), and move the memory of friction one sample on.

        Without the acceleration ``a`` an axis is taken to speed up when it is faster than before.
        """
        tau = self.viscous * v + self.stiffness * q
        for j, x, y in self.position:
            tau[j] += np.interp(q[j], x, y)
        for j, x, y in self.velocity:
            tau[j] += np.interp(v[j], x, y)
        for i, j, inertia, viscous in self.coupled:
            both = (0.0, 0.0) if a is None else (inertia * a[j], inertia * a[i])
            tau[i] += both[0] + viscous * v[j]
            tau[j] += both[1] + viscous * v[i]
        for k, row in enumerate(self.dry):
            turn = self._turn(k, row, v, a)
            x, y = row["plus"] if turn >= 0.0 else row["minus"]
            force = abs(turn) * np.interp(abs(v[row["joint"]]), x, y)
            tau[row["joint"]] += force
            if row["partner"] >= 0:
                tau[row["partner"]] += force
        for k, row in enumerate(self.slip):
            tau[row["joint"]] += self._slip(k, row, q[row["joint"]], v[row["joint"]])
        return tau

    def _sliding(self, row: Any, v: Any) -> float:
        """Return the speed that slides in a dry contact."""
        return float(v[row["joint"]]) + (float(v[row["partner"]]) if row["partner"] >= 0 else 0.0)

    def _turn(self, k: int, row: Any, v: Any, a: Any) -> float:
        """Return the direction with memory, -1 to 1: it turns while the axis speeds up, else it holds."""
        speed = self._sliding(row, v)
        rate = speed - self.before[k] if a is None else self._sliding(row, a)
        if row["slope"] == 0.0:
            self.turn[k] = _direction(speed, 0.0)
        elif speed * rate > 0.0 or (a is not None and rate == 0.0 and speed != 0.0):
            turned = self.turn[k] + (speed - self.before[k]) * row["slope"]
            self.turn[k] = min(1.0, max(-1.0, turned))
        self.before[k] = speed
        return float(self.turn[k])

    def _slip(self, k: int, row: Any, q: float, v: float) -> float:
        """Return the effort of slip elements and a bristle that bend before they slide."""
        play, x_s = row["play"], row["x_s"]
        move = q - self.where[k]
        move = move - play if move > play else (move + play if move < -play else 0.0)
        self.where[k] += move
        self.bend[k] = [
            min(1.0, max(-1.0, b + move / y)) for b, y in zip(self.bend[k], row["yields"], strict=True)
        ]
        z = sum(self.bend[k]) / len(self.bend[k])
        rate = 0.0
        if move != 0.0:
            side = 1.0 if move > 0.0 else -1.0
            self.bristle[k] = side + (self.bristle[k] - side) * np.exp(-abs(move) / x_s)
            rate = (v - abs(v) * self.bristle[k]) / x_s
        y = self.bristle[k]
        return float(z * np.interp(abs(v), *row["level"]) + row["m"] * (y - z) + row["d"] * rate)


def _direction(speed: float, slope: float) -> float:
    """Return the direction without memory; slope 0 is the plain sign."""
    return float(np.sign(speed) if slope == 0.0 else min(1.0, max(-1.0, speed * slope)))


class InverseModel:
    """Motor effort of a machine: ``tau = InverseModel(DATA).effort(q, v, a)``; SI throughout.

    Args:
        data: numbers of the machine, as written by `pinotwin export`.
    """

    def __init__(self, data: dict[str, Any]) -> None:
        self.names = list(data["names"])
        self.nv = len(self.names)
        self.friction = Friction(data)
        self.gravity = np.array(data["gravity"], dtype=float)
        self.armature = np.array(data["armature"], dtype=float)
        self.joints = [
            (
                int(row["parent"]),
                int(row["column"]),
                bool(row["rotary"]),
                np.array(row["axis"], dtype=float),
                np.array(row["rotation"], dtype=float).reshape(3, 3),
                np.array(row["place"], dtype=float),
                float(row["mass"]),
                np.array(row["centre"], dtype=float),
                np.array(row["inertia"], dtype=float).reshape(3, 3),
            )
            for row in data["joints"]
        ]

    def reset(self, q: Any, v: Any, step: float = 0.0) -> None:
        """Forget the past; see :meth:`Friction.reset`."""
        self.friction.reset(q, v, step)

    def effort(self, q: Any, v: Any, a: Any) -> Any:
        """Return the effort [N or N·m] of the next sample, shape (nv,)."""
        q, v, a = (np.asarray(x, dtype=float) for x in (q, v, a))
        return self.rigid_body(q, v, a) + self.friction.effort(q, v, a)

    def run(self, q: Any, v: Any, a: Any, step: float = 0.0) -> Any:
        """Return the effort of one unbroken stretch, shape (n, nv); all three of shape (n, nv)."""
        self.reset(q[0], v[0], step)
        return np.array([self.effort(*row) for row in zip(q, v, a, strict=True)])

    def rigid_body(self, q: Any, v: Any, a: Any) -> Any:
        """Return inertia, Coriolis, centrifugal, gravity and rotor efforts, shape (nv,)."""
        zero = np.zeros(3)
        moved: list[Any] = []
        wrench: list[Any] = []
        for parent, k, rotary, axis, rotation, place, mass, centre, inertia in self.joints:
            w0, dw0, a0 = moved[parent][2:] if parent >= 0 else (zero, zero, -self.gravity)
            R = rotation @ _turn(axis, q[k]) if rotary else rotation
            p = place if rotary else place + rotation @ axis * q[k]
            w, dw = R.T @ w0, R.T @ dw0
            acc = R.T @ (a0 + _cross(dw0, p) + _cross(w0, _cross(w0, p)))
            if rotary:
                dw = dw + axis * a[k] + _cross(w, axis * v[k])
                w = w + axis * v[k]
            else:
                acc = acc + axis * a[k] + 2.0 * _cross(w, axis * v[k])
            force = mass * (acc + _cross(dw, centre) + _cross(w, _cross(w, centre)))
            moment = inertia @ dw + _cross(w, inertia @ w) + _cross(centre, force)
            moved.append((R, p, w, dw, acc))
            wrench.append([force, moment])
        tau = self.armature * a
        for i in range(len(self.joints) - 1, -1, -1):
            parent, k, rotary, axis = self.joints[i][:4]
            force, moment = wrench[i]
            tau[k] += axis @ (moment if rotary else force)
            if parent >= 0:
                R, p = moved[i][:2]
                wrench[parent][0] = wrench[parent][0] + R @ force
                wrench[parent][1] = wrench[parent][1] + R @ moment + _cross(p, R @ force)
        return tau


def _cross(a: Any, b: Any) -> Any:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _turn(axis: Any, angle: float) -> Any:
    """Return the rotation about a unit axis (Rodrigues)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
