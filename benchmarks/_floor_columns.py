"""The columns that the floors choose from: textbook inverse-dynamics regressors, one effect each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.effects import Effect, Presliding
from pinotwin.machine import Machine
from pinotwin.motion import AxisMotion, Motion
from pinotwin.signals import hats
from pinotwin.twin import Twin


@dataclass(frozen=True)
class Scene:
    """One log on a thinned grid of m samples.

    Attributes:
        motion: prepared log.
        pick: samples that are used, shape (m,).
        base: columns of the base model, shape (nv, m, p); only an offset per axis where a twin is given.
        gap: effort to be explained, shape (nv, m).
        model: effort that the base model predicts, shape (n, nv).
    """

    motion: Motion
    pick: np.ndarray
    base: Floats
    gap: Floats
    model: Floats

    @classmethod
    def of(
        cls,
        motion: Motion,
        effects: Sequence[Effect],
        machine: Machine,
        twin: Twin | None,
        rows: int,
    ) -> Self:
        """Return a log as the floors see it."""
        pick = np.unique(np.linspace(0, len(motion) - 1, rows).astype(int))
        u = np.nan_to_num(motion.u)
        if twin is not None:
            model = twin.effort(motion)
            offsets = np.repeat(np.eye(machine.nv)[:, None, :], len(pick), axis=1)
            return cls(motion, pick, offsets, (u - model)[pick].T, model)
        W = np.zeros((machine.nv, len(motion), sum(len(e.coefficients()) for e in effects)))
        at = 0
        for effect in effects:
            columns = effect.columns(motion)
            width = columns.values.shape[2]
            for k, j in enumerate(columns.joints):
                W[j, :, at : at + width] = columns.values[:, k]
            at += width
        base = W[:, pick]
        flat = base.reshape(-1, at)
        size = np.linalg.norm(flat, axis=0) + 1e-300
        A = flat / size
        theta = np.linalg.solve(A.T @ A + 1e-9 * np.eye(at), A.T @ u[pick].T.reshape(-1)) / size
        return cls(motion, pick, base, u[pick].T, (W @ theta).T)


@dataclass(frozen=True)
class Atom:
    """One effect at one shape.

    Attributes:
        effect: name.
        axis: axis.
        values: columns, shape (nv, m, k).
        shapes: shape parameters that were searched.
    """

    effect: str
    axis: str | None
    values: Floats
    shapes: int = 0


def atoms(
    scenes: Sequence[Scene],
    machine: Machine,
    joint: int,
    axis: str,
    situation: str,
    leave_out: Sequence[str],
) -> Iterator[Atom]:
    """Yield the columns of every effect on one axis."""
    own = [_own(s, joint) for s in scenes]
    for effect, shapes, make in _forms(own):
        if effect in leave_out:
            continue
        parts = [make(x) for x in own]
        if all(np.isfinite(p).all() for p in parts):
            yield Atom(effect, axis, _on(np.concatenate(parts), joint, machine.nv), shapes)
    if situation == "change" and "payload" not in leave_out:
        yield Atom("payload", axis, _load(scenes, machine, joint))


@dataclass(frozen=True)
class _Own:
    """One axis of one log at the picked samples, shape (m,); ``z`` is its direction with memory."""

    t: Floats
    q: Floats
    v: Floats
    a: Floats
    model: Floats
    rate: Floats
    jerk: Floats
    width: float
    slip: dict[float, Floats]


def _own(scene: Scene, joint: int) -> _Own:
    m, k = scene.motion, scene.pick
    axis = m.axis(m.names[joint])
    model = scene.model[:, joint]
    rate = np.gradient(model, m.t)
    jerk = np.gradient(rate, m.t)
    small = 5e-5 if m.rotary[joint] else 1e-5
    slip = {x: _slip(axis, x * small)[k] for x in (0.3, 1.0, 3.0, 10.0)}
    speed = max(float(np.abs(m.v[:, joint]).max()), 1e-9)
    return _Own(
        m.t[k] - m.t[0],
        m.q[k, joint],
        m.v[k, joint],
        m.a[k, joint],
        model[k],
        rate[k],
        jerk[k],
        0.005 * speed,
        slip,
    )


def _slip(axis: AxisMotion, distance: float) -> Floats:
    """Return the direction of an axis that turns round over a distance."""
    law = Presliding(axis.name, axis.rotary, x_s=distance, stribeck=0)
    return law.axis_columns(axis)[:, 0]


def _stack(*columns: Floats) -> Floats:
    return np.stack(columns, axis=1)


def _forms(own: Sequence[_Own]):  # type: ignore[no-untyped-def]
    """Yield (effect, searched shapes, columns of one log) of one axis."""
    speed = max(max(float(np.abs(x.v).max()) for x in own), 1e-9)
    low = min(float(x.q.min()) for x in own)
    span = max(max(float(x.q.max()) for x in own) - low, 1e-9)
    plain = (
        ("viscous", lambda x: _stack(x.v)),
        ("coulomb", lambda x: _stack(_sign(x))),
        ("coulomb_asymmetric", lambda x: _stack(np.abs(_sign(x)))),
        ("quadratic_drag", lambda x: _stack(x.v * np.abs(x.v))),
        ("load_friction", lambda x: _stack(np.abs(x.model) * _sign(x))),
        ("viscous_thermal", lambda x: _stack(x.v * x.t)),
        ("effort_scale", lambda x: _stack(x.model)),
        ("delay", lambda x: _stack(x.rate)),
        ("drive_flexibility", lambda x: _stack(x.jerk)),
        ("backlash", lambda x: _stack(np.tanh(x.model / (0.05 * np.abs(x.model).max() + 1e-12)))),
        ("geometric_error", lambda x: _stack(np.sin(x.q), np.cos(x.q))),
        ("position_table", lambda x: hats(x.q, low, low + span, 24)),
    )
    for effect, make in plain:
        yield effect, 0, make
    for share in (0.005, 0.02, 0.06):
        yield (
            "stribeck",
            1,
            lambda x, s=share: _stack(_sign(x) * np.exp(-np.abs(x.v) / (s * speed))),
        )
    for width in own[0].slip:
        yield "presliding", 1, lambda x, w=width: _stack(x.slip[w])
    for count in np.geomspace(2.0, 60.0, 90):
        wave = 2.0 * np.pi * count / span
        yield "ripple", 1, lambda x, w=wave: _stack(np.sin(w * x.q), np.cos(w * x.q))
        if count < 4.0:
            yield "encoder_error", 1, lambda x, w=wave: _stack(x.a * np.sin(w * x.q), x.a * np.cos(w * x.q))


def _sign(x: _Own) -> Floats:
    return np.asarray(np.tanh(x.v / x.width))


def _on(values: Floats, joint: int, nv: int) -> Floats:
    out = np.zeros((nv, *values.shape))
    out[joint] = values
    return out


def _load(scenes: Sequence[Scene], machine: Machine, joint: int) -> Floats:
    """Return the columns of a mass and its first moments on the body of a joint, shape (nv, m, 4)."""
    P = machine.base.P[:, 10 * joint : 10 * joint + 4]
    parts = []
    for s in scenes:
        q, v, a = (x[s.pick] for x in (s.motion.q, s.motion.v, s.motion.a))
        parts.append(np.einsum("nij,jk->ink", machine.base.regressor(machine.model, q, v, a), P))
    return np.concatenate(parts, axis=1)
