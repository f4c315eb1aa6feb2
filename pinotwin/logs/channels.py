"""The channels of a bound log as arrays of a machine's joints, and the stretches that can be used.

Nothing is repaired: an infinite value counts as missing, a missing one in a channel that is used ends a stretch.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.columns import LOAD_SIGNALS
from pinotwin.dynamics.frames import external_effort
from pinotwin.errors import DataError, LogError, nearest
from pinotwin.log import Log
from pinotwin.logs.quality.sampling import implausible_clock
from pinotwin.machine import Machine
from pinotwin.signals import clock, segments

SHORTEST = 20  # samples below which a stretch is of no use


def usable(machine: Machine, log: Log) -> Log:
    """Return a bound log with infinite values as missing ones; LogError if the machine cannot use it at all."""
    for name in machine.axes:
        if f"{name}.q" not in log:
            raise LogError(
                f"{log.source}: no channel {name}.q (position of axis {name}); name its column "
                "under `columns` in machine.yaml, or drop the axis; "
                f"{nearest(f'{name}.q', log.channels)}"
            )
    if "t" not in log:
        raise LogError(
            f"{log.source}: no time channel t; name its column under `columns` in machine.yaml, or "
            "give `t: {rate: ...}`"
        )
    log = finite(log)
    with contextlib.suppress(DataError):  # a clock that stands is refused where it is cut
        refused = implausible_clock(clock(log.t[np.isfinite(log.t)]))
        if refused:
            raise LogError(f"{log.source}: t: {refused}")
    return log


def finite(log: Log, absurd: float = 1e12) -> Log:
    """Return a bound log with infinite values as missing ones; LogError for ``absurd`` ones [SI], such as sentinels."""
    if len(log) == 0:
        raise LogError(f"{log.source}: holds no rows; record or cut it again")
    channels = {}
    for name, x in log.channels.items():
        known = np.isfinite(x)
        beyond = np.flatnonzero(np.abs(x, where=known, out=np.zeros(len(x))) > absurd)
        if len(beyond):
            raise LogError(
                f"{log.source}: {name}: {x[beyond[0]]:g} in row {beyond[0]} is no measurement in "
                "SI; remove such rows, or correct the unit under `columns` in machine.yaml"
            )
        channels[name] = x if known.all() else np.where(known, x, np.nan)
    return log.with_channels(channels)


def stretches(machine: Machine, log: Log, shortest: int = SHORTEST) -> list[slice]:
    """Return regular stretches of at least ``shortest`` samples in which every used channel is a number."""
    try:
        clock(log.t)
    except DataError as error:
        raise LogError(f"{log.source}: t: {error}") from None
    good = np.all(np.isfinite([log[name] for name in _used(machine, log)]), axis=0)
    out = [s for s in segments(log.t, valid=good) if s.stop - s.start >= shortest]
    if not out:
        raise DataError(f"{log.source}: {_why_none(machine, log, good, shortest)}")
    return out


def _used(machine: Machine, log: Log) -> Iterator[str]:
    names = [f"{name}.{kind}" for name in machine.axes for kind in ("q", "u", "qr", "ql")]
    names += [f"{name}.{kind}" for name in machine.passive for kind in ("q", "v", "a")]
    for name in [*(n for n in names if n in log), *_load_channels(log)]:
        if not np.isfinite(log[name]).any():
            raise LogError(f"{log.source}: {name}: holds no number; record it or leave it out")
        yield name


def _why_none(machine: Machine, log: Log, good: Mask, shortest: int) -> str:
    if len(log) < shortest:
        return f"only {len(log)} rows, at least {shortest} are needed; record longer"
    step = clock(log.t).step
    if all(s.stop - s.start < shortest for s in segments(log.t)):
        return (
            f"t: no {shortest} rows in a row are {1e3 * step:.4g} ms apart (irregular or repeated "
            "stamps); log finer stamps, or resample it with pt.resample"
        )
    missing = {name: int((~np.isfinite(log[name])).sum()) for name in _used(machine, log)}
    worst = max(missing, key=lambda name: missing[name])
    return (
        f"{worst}: {missing[worst]} of {len(log)} values are missing and leave no {shortest} "
        f"rows in a row ({int((~good).sum())} rows lack something); record it without holes"
    )


def joint_positions(machine: Machine, log: Log, kind: str) -> Floats:
    """Return positions (``q``) or commands (``qr``) of joints, ``N^-1 q_motor + zero``, (n, nv); zero if missing."""
    x: Floats = np.zeros((len(log), machine.nv))
    for name, axis in machine.axes.items():
        x[:, axis.index] = np.nan_to_num(log[f"{name}.{kind}"])
    if machine.transmission is not None:
        x = np.linalg.solve(machine.transmission, x.T).T.astype(float)
    for axis in machine.axes.values():
        x[:, axis.index] += axis.zero
    if kind == "q":
        for name, part in machine.passive.items():
            if f"{name}.q" in log:
                x[:, part.index] = np.nan_to_num(log[f"{name}.q"])
    return x


def load_positions(machine: Machine, log: Log) -> Floats | None:
    """Return joint positions measured at the load, shape (n, nv), NaN without such an encoder; None without any."""
    x = np.full((len(log), machine.nv), np.nan)
    for name, axis in machine.axes.items():
        if f"{name}.ql" in log:
            x[:, axis.index] = np.nan_to_num(log[f"{name}.ql"]) + axis.zero
    return None if np.isnan(x).all() else x


def has_commands(machine: Machine, log: Log) -> bool:
    """Return whether every axis has its command; LogError if some have, others have not."""
    missing = [name for name in machine.axes if f"{name}.qr" not in log]
    if missing and len(missing) < len(machine.axes):
        raise LogError(
            f"{log.source}: command missing for axis {', '.join(missing)} (channel "
            f"{missing[0]}.qr) while other axes have theirs; give all of them or none"
        )
    return not missing


def efforts(machine: Machine, log: Log) -> Floats:
    """Return ``tau = N^T tau_motor`` [N or N·m], (n, nv), NaN where a motor has no channel or a constant one."""
    # Fitted, a constant is a machine without friction. A passive joint's zero has no scale to be weighed by.
    motor = np.full((len(log), machine.nv), np.nan)
    for name, axis in machine.axes.items():
        u = log.channels.get(f"{name}.u")
        if u is not None and np.ptp(u[np.isfinite(u)]) > 0.0:
            motor[:, axis.index] = u
    if machine.transmission is None:
        return motor
    joint = np.empty_like(motor)
    for j, ratios in enumerate(machine.transmission.T):
        acts = np.flatnonzero(ratios)  # a motor that does not act must not spoil with its NaN
        joint[:, j] = motor[:, acts] @ ratios[acts]
    return joint


def _load_channels(log: Log) -> list[str]:
    return [c for c in log.channels if "." in c and c.rpartition(".")[2] in LOAD_SIGNALS]


def loads(machine: Machine, log: Log) -> dict[str, Floats]:
    """Return the logged external loads: link of the machine -> wrench f, m in world axes, shape (n, 6) [N, N·m]."""
    out = {}
    frames = {frame.name for frame in machine.model.frames} - {"universe"}
    for link in sorted({channel.rpartition(".")[0] for channel in _load_channels(log)}):
        if link not in frames:
            raise LogError(
                f"{log.source}: external load on {link!r}, which is no link of {machine.name}; "
                f"{nearest(link, frames)}"
            )
        out[link] = np.zeros((len(log), 6))
        for k, part in enumerate(LOAD_SIGNALS):
            if f"{link}.{part}" in log:
                out[link][:, k] = np.nan_to_num(log[f"{link}.{part}"])
    return out


def external(machine: Machine, log: Log) -> Floats | None:
    """Return the joint effort of the logged external loads J^T f, shape (n, nv); None without any."""
    wrenches = loads(machine, log)
    if not wrenches:
        return None
    q = joint_positions(machine, log, "q")
    return np.sum([external_effort(machine.model, link, q, f) for link, f in wrenches.items()], axis=0)
