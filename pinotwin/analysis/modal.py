r"""Modes of a machine at a posture: small free vibrations about it, motors locked, free or closed.

    M(q) x'' + C x' + K x = 0,     x = phi exp(s t),  s = wn (-zeta ± i sqrt(1 - zeta²))

K and C hold springs and dampers of the passive joints, the slope of gravity dg/dq, and a stiffness and a damping per
servo axis. A locked axis is taken out, a free one has neither. Damping need not be proportional: (s, phi) are those of
the first-order form (Tisseur & Meerbergen 2001, doi:10.1137/S0036144500381988).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinotwin.analysis.deflection import PassiveSpring, springs
from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics import mass_matrix
from pinotwin.errors import MachineError, TwinError, require
from pinotwin.machine import Machine, Passive
from pinotwin.twin import Twin


@dataclass(frozen=True)
class Mode:
    """One vibration."""

    frequency: float  # undamped natural frequency [Hz]
    damping: float  # damping ratio
    # complex amplitude of every joint [m or rad], scaled to unit kinetic energy at 1 rad/s (phi^H M phi = 1), the
    # largest part real and positive; zero for locked joints, (nv,)
    shape: np.ndarray
    energy: Floats  # share of the kinetic energy by joint, (nv,)


@dataclass(frozen=True)
class Modes:
    """The vibrations at a posture, slowest first."""

    names: tuple[str, ...]  # joint of every entry of a shape
    q: Floats  # the posture, (nv,)
    locked: tuple[str, ...]  # axes that are locked
    modes: tuple[Mode, ...]  # the vibrations

    def __len__(self) -> int:
        return len(self.modes)

    def __getitem__(self, k: int) -> Mode:
        return self.modes[k]


def modes(
    machine: Machine | Twin,
    posture: Mapping[str, float] | None = None,
    *,
    locked: str | Collection[str] = "all",
    stiffness: Mapping[str, float] | None = None,
    damping: Mapping[str, float] | None = None,
    gravity: bool = True,
) -> Modes:
    """Return the vibrations at a posture [m or rad]; MachineError: unknown axis, or joint of unknown stiffness."""
    believed = machine if isinstance(machine, Machine) else machine.machine
    found = () if isinstance(machine, Machine) else springs(machine)  # a twin has found its springs
    q = believed.posture(posture)
    k, c = _springs(believed, found, stiffness or {}, damping or {})
    held = _locked(believed, locked, stiffness or {})
    free = np.array([j for j, name in enumerate(believed.names) if name not in held], dtype=np.intp)
    M = mass_matrix(machine.model, q[None])[0]
    K = np.diag(k)
    if gravity:  # dg/dq, symmetric
        slope = pin.computeGeneralizedGravityDerivatives(machine.model, machine.model.createData(), q)
        K += 0.5 * (slope + slope.T)
    if not len(free):
        return Modes(believed.names, q, held, ())
    cut = np.ix_(free, free)
    return Modes(believed.names, q, held, _solve(M, K[cut], np.diag(c)[cut], free))


def servo_modes(twin: Twin, posture: Mapping[str, float] | None = None) -> Modes:
    """Return the modes of a twin at a posture (axis -> [m or rad]) with its servo loops closed; TwinError without any.

    A loop answers its axis with u = C(s) e, C = (u/d) / (e/d), at a mode's s a stiffness and a damping, C(s) = k + c s
    with both real; s and servo are found in 20 rounds, mode by mode. Modes damped more than half are the servo's
    own: a stiffness and a damping say little about them.
    """
    if not twin.loops:
        raise TwinError(f"{twin.machine.name}: the twin has no closed loop to close the servo with")
    begin = _with_servo(twin, posture, 2.0j * np.pi * 10.0)
    found = []
    for k in range(len(begin)):
        now = begin
        for _ in range(20):
            if k >= len(now):
                break
            zeta = now[k].damping
            root = 2.0 * np.pi * now[k].frequency * complex(-zeta, np.sqrt(max(1.0 - zeta**2, 1e-6)))
            now = _with_servo(twin, posture, root)
        if k < len(now) and now[k].damping < 0.5:
            found.append(now[k])
    ordered = tuple(sorted(found, key=lambda mode: mode.frequency))
    return Modes(begin.names, begin.q, begin.locked, ordered)


def _with_servo(twin: Twin, posture: Mapping[str, float] | None, s: complex) -> Modes:
    """Return the modes with every loop as its stiffness and damping at s [rad/s]."""
    stiffness, damping = {}, {}
    for name, loop in twin.loops.items():
        u, e = (np.polyval(loop.numerator(output, loop.disturbances[0])[0], s) for output in "ue")
        answer = complex(u / e)
        c = answer.imag / s.imag
        stiffness[name] = float(answer.real - c * s.real)
        own = twin.diagonal["viscous"][twin.machine.axes[name].index]
        damping[name] = float(c + own)
    return modes(twin, posture, stiffness=stiffness, damping=damping)


def _springs(
    machine: Machine,
    found: Sequence[PassiveSpring],
    stiffness: Mapping[str, float],
    damping: Mapping[str, float],
) -> tuple[Floats, Floats]:
    """Return stiffness and damping of every joint, (nv,) each."""
    for name in (*stiffness, *damping):
        require(name, machine.names, f"{machine.name}: no axis", MachineError)
    parts: dict[str, Passive | PassiveSpring] = {**machine.passive}
    parts |= {spring.name: spring for spring in found}
    k = {**{name: part.stiffness for name, part in parts.items()}, **stiffness}
    c = {**{name: part.damping for name, part in parts.items()}, **damping}
    for name in machine.names:
        if k.get(name, 0.0) is None:
            raise MachineError(
                f"{machine.name}: passive joint {name!r} has no stiffness; give "
                f"`passive: {{{name}: {{stiffness: ...}}}}` in machine.yaml, or identify it"
            )
    stiff, damped = (np.array([x.get(name) or 0.0 for name in machine.names]) for x in (k, c))
    return stiff, damped


def _locked(
    machine: Machine, locked: str | Collection[str], stiffness: Mapping[str, float]
) -> tuple[str, ...]:
    """Return the axes that are locked, in order."""
    if isinstance(locked, str):
        locked = {"all": tuple(machine.axes), "none": ()}.get(locked, (locked,))
    for name in locked:
        machine.axis(name)
    return tuple(name for name in machine.axes if name in locked and name not in stiffness)


def _solve(M: Floats, K: Floats, C: Floats, free: Ints, still: float = 2e-3) -> tuple[Mode, ...]:
    """Return the vibrations of the free joints; M of all joints. Below ``still`` [Hz] is rigid-body motion."""
    n = len(free)
    inverse = np.linalg.inv(M[np.ix_(free, free)])
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]])
    values, vectors = np.linalg.eig(A)
    out = []
    for s, column in zip(values, vectors.T, strict=True):
        wn = abs(s)
        if s.imag <= 0.0 or wn < 2.0 * np.pi * still:
            continue
        shape = np.zeros(len(M), dtype=complex)
        shape[free] = column[:n]
        out.append(_mode(M, shape, float(wn) / (2.0 * np.pi), float(-s.real / wn)))
    return tuple(sorted(out, key=lambda mode: mode.frequency))


def _mode(M: Floats, shape: np.ndarray, frequency: float, damping: float) -> Mode:
    inertia = np.conj(shape) * (M @ shape)
    size = float(np.sqrt(inertia.real.sum()))
    energy = np.real(inertia) / size**2
    largest = shape[int(np.argmax(np.abs(shape) * np.sqrt(np.diag(M))))]
    return Mode(frequency, damping, shape * (abs(largest) / largest) / size, energy)


def animate(found: Modes, number: int, reach: float, seconds: float = 2.0) -> tuple[Floats, Floats]:
    """Return times (n,) [s] and configurations (n, nv) of one mode over a period, ``reach`` at its largest."""
    if not 1 <= number <= len(found):
        known = ", ".join(f"{m.frequency:.3g} Hz" for m in found.modes) or "none"
        raise MachineError(
            f"no mode {number}: {len(found)} vibration(s) at this posture ({known}); free an axis "
            "that is locked, or give passive joints"
        )
    shape = found[number - 1].shape
    t = np.linspace(0.0, seconds, 61)
    turning = np.exp(2j * np.pi * t / seconds)[:, None] * shape / np.max(np.abs(shape))
    return t, found.q + reach * np.real(turning)
