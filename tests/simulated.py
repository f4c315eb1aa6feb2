"""Twins whose closed loop is known, and an integrator of the same machine that shares no code with it.

The integrator steps the nonlinear equations with ``pin.aba`` and a cascade P-PI written out, by
Runge-Kutta 4 at a step far below the simulator's; dry friction keeps its direction in memory and is
updated once a step.
"""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pinocchio as pin

from pinotwin.analysis.disturbance import mean_inertia
from pinotwin.dynamics.parameters import parameters, with_parameters
from pinotwin.effects import Coulomb, Offset, Ripple, Stribeck, Viscous
from pinotwin.identification.plant import fit_options
from pinotwin.log import Log
from pinotwin.loop import Servo, close
from pinotwin.machine import Machine
from pinotwin.twin import Twin

SIZES = {False: (40.0, 20.0, 6.0, 8.0), True: (0.6, 0.8, 0.3, 0.4)}
"""viscous, coulomb, stribeck, ripple of a linear and of a rotary axis."""


def plain_machine(name: str, *, offset: bool = False) -> Machine:
    """A bundled machine with viscous, dry friction and ripple on every axis."""
    machine = Machine.load(name)
    for axis, part in machine.axes.items():
        r = part.rotary
        effects = (
            Viscous(axis=axis, rotary=r),
            Coulomb(axis=axis, rotary=r),
            Stribeck(axis=axis, rotary=r, v_s=0.1 if r else 0.02),
            Ripple(axis=axis, rotary=r, period=0.3 if r else 0.03),
        )
        machine = machine.with_effects(axis, (*effects, *([Offset(axis=axis)] if offset else [])))
    return machine


def nominal_twin(machine: Machine) -> Twin:
    """The twin of a machine as described: CAD inertias, every other coefficient zero."""
    prior = fit_options(machine, machine.effects).prior
    assert prior is not None
    return Twin(
        machine=machine,
        effects=machine.effects,
        theta=prior,
        covariance=np.zeros((len(prior), len(prior))),
        parameters=(),
        pi=parameters(machine.model),
    )


def known_twin(machine: Machine, *, bandwidth: float = 20.0, scale: float = 1.0) -> Twin:
    """Its twin with CAD inertias, friction as in SIZES, and a P-PI of that bandwidth [Hz]."""
    twin = nominal_twin(machine)
    theta = twin.theta.copy()
    for key, effect, s in zip(twin.keys, twin.effects, twin.slices, strict=True):
        if effect.axis in machine.axes:
            b, c, slow, wave = SIZES[machine.axes[effect.axis].rotary]
            size = {"viscous": b, "coulomb": c, "stribeck": slow, "ripple": wave}.get(effect.name, 0.0)
            theta[s] = scale * size
        elif key != "rigid_body":  # the spring of a passive joint
            part = machine.passive[effect.axis]
            theta[s] = part.stiffness, part.damping
    twin = dataclasses.replace(twin, theta=theta)
    span = np.where(machine.rotary, 1.0, 0.2)
    inertia = np.diag(mean_inertia(twin, -span, span))
    viscous, stiffness = np.zeros(machine.nv), np.zeros(machine.nv)
    for effect, s in zip(twin.effects, twin.slices, strict=True):
        if effect.name == "viscous":
            viscous[machine.names.index(effect.axis)] = theta[s][0]
        if effect.name == "spring":
            i = machine.names.index(effect.axis)
            stiffness[i], viscous[i] = theta[s]
    laws = {}
    for name, axis in machine.axes.items():
        rate = 2 * np.pi * bandwidth
        M = inertia[axis.index]
        laws[name] = Servo.of_cascade(0.3 * rate, M * rate, 0.1 * rate, 0.9, 0.8 * M)
    loops = {
        name: close(law, inertia[machine.axes[name].index], viscous[machine.axes[name].index], axis=name)
        for name, law in laws.items()
    }
    diagonal = {"inertia": inertia, "viscous": viscous, "stiffness": stiffness}
    return dataclasses.replace(twin, loops=loops, servos=laws, diagonal=diagonal)


def smooth_command(machine: Machine, seconds: float, rate: float, seed: int = 3) -> Log:
    """A command of sums of sines that starts and ends at rest, with all axes moving."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate) + 1) / rate
    ramp = np.clip(t / 0.2, 0, 1) ** 3 * (10 - 15 * np.clip(t / 0.2, 0, 1) + 6 * np.clip(t / 0.2, 0, 1) ** 2)
    channels = {"t": t}
    for name, axis in machine.axes.items():
        size = 0.5 if axis.rotary else 0.05
        f = rng.uniform(0.8, 2.0, 2)
        wave = np.sin(2 * np.pi * f[0] * t) + 0.3 * np.sin(2 * np.pi * f[1] * 2 * t)
        channels[f"{name}.qr"] = size * ramp * wave
    return Log(channels, source="smooth command")


class Integrator:
    """The machine and its controllers, written out."""

    def __init__(self, twin: Twin) -> None:
        self.twin, self.machine = twin, twin.machine
        self.model = with_parameters(twin.machine.model, twin.pi)
        self.data = self.model.createData()
        self.nv = self.model.nv
        laws = {twin.machine.axes[n].index: c.cascade() for n, c in twin.servos.items()}
        self.laws = {j: SimpleNamespace(**law) for j, law in laws.items()}

    def coefficient(self, j: int, name: str) -> np.ndarray:
        return self.twin.coefficients(f"{self.machine.names[j]}.{name}")

    def passive_effort(self, q: np.ndarray, v: np.ndarray, turn: np.ndarray) -> np.ndarray:
        tau = np.zeros(self.nv)
        for j, name in enumerate(self.machine.names):
            if name in self.machine.passive:
                part = self.machine.passive[name]
                tau[j] = part.stiffness * q[j] + part.damping * v[j]
                continue
            rotary = self.machine.rotary[j]
            v_s, period = (0.1, 0.3) if rotary else (0.02, 0.03)
            (b,), (c,), (s,) = (self.coefficient(j, k) for k in ("viscous", "coulomb", "stribeck"))
            a1, b1 = self.coefficient(j, "ripple")
            phase = 2 * np.pi * q[j] / period
            tau[j] = (
                b * v[j]
                + turn[j] * (c + s * np.exp(-abs(v[j] / v_s)))
                + a1 * np.cos(phase)
                + b1 * np.sin(phase)
            )
        return tau

    def motor(self, q: np.ndarray, v: np.ndarray, I: np.ndarray, r: np.ndarray) -> np.ndarray:
        u = np.zeros(self.nv)
        for j, law in self.laws.items():
            w = law.kp * (r[0, j] - q[j]) + law.ffv * r[1, j] - v[j]
            u[j] = law.kv * (w + law.rate * I[j]) + law.ffa * r[2, j]
        return u

    def rate(self, x: np.ndarray, r: np.ndarray, turn: np.ndarray, wrench: np.ndarray | None) -> np.ndarray:
        q, v, integral = x
        u = self.motor(q, v, integral, r)
        tau = u - self.passive_effort(q, v, turn)
        if wrench is not None:
            frame = self.model.getFrameId(self.link)
            J = pin.computeFrameJacobian(self.model, self.data, q, frame, pin.LOCAL_WORLD_ALIGNED)
            tau = tau + J.T @ wrench
        a = pin.aba(self.model, self.data, q, v, tau)
        w = np.zeros(self.nv)
        for j, law in self.laws.items():
            w[j] = law.kp * (r[0, j] - q[j]) + law.ffv * r[1, j] - v[j]
        return np.stack([v, a, w])

    def run(self, log: Log, step: float, link: str = "", wrench=None):  # type: ignore[no-untyped-def]
        """Return e and u at the rows of the log; ``wrench(t)`` acts on ``link``."""
        from scipy.interpolate import CubicSpline

        self.link = link
        qr = np.zeros((len(log), self.nv))
        for name, axis in self.machine.axes.items():
            qr[:, axis.index] = log[f"{name}.qr"]
        spline = CubicSpline(log.t, qr)
        every = round((log.t[1] - log.t[0]) / step)
        fine = np.arange((len(log) - 1) * every * 2 + 1) * step / 2
        R = np.stack([spline(fine), spline(fine, 1), spline(fine, 2)], axis=1)
        width = np.where(self.machine.rotary, 1e-2, 1e-3)
        x = np.zeros((3, self.nv))
        x[0] = qr[0]
        x[2] = self._holding(qr[0])
        turn = np.zeros(self.nv)
        e, u = np.zeros_like(qr), np.zeros_like(qr)
        load = (lambda t: None) if wrench is None else wrench
        for k in range((len(log) - 1) * every + 1):
            r = R[2 * k]
            if k % every == 0:
                e[k // every] = r[0] - x[0]
                u[k // every] = self.motor(*x, r)
            if 2 * k + 2 >= len(R):
                break
            t = fine[2 * k]
            k1 = self.rate(x, r, turn, load(t))
            k2 = self.rate(x + 0.5 * step * k1, R[2 * k + 1], turn, load(t + 0.5 * step))
            k3 = self.rate(x + 0.5 * step * k2, R[2 * k + 1], turn, load(t + 0.5 * step))
            k4 = self.rate(x + step * k3, R[2 * k + 2], turn, load(t + step))
            v = x[1].copy()
            x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            faster = x[1] * (x[1] - v) > 0
            turn = np.where(faster, np.clip(turn + (x[1] - v) / width, -1, 1), turn)
        return e, u

    def _holding(self, q: np.ndarray) -> np.ndarray:
        """Integrals that hold the machine at rest at its start."""
        zero = np.zeros(self.nv)
        tau = pin.rnea(self.model, self.data, q, zero, zero) + self.passive_effort(q, zero, zero)
        out = np.zeros(self.nv)
        for j, law in self.laws.items():
            out[j] = tau[j] / (law.kv * law.rate)
        return out
