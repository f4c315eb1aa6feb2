"""The commands of chapter 7 for the flexure rig: limits of Table C-1, zones of Fig. 7-2, hammer pulses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

import pinotwin as pt
from pinotwin.trajectories.moves import Limits, Trajectory, rest
from pinotwin.trajectories.profiles import chain, move_pieces, move_time
from pinotwin.virtual.machine import VirtualMachine
from pinotwin.virtual.run import load_arrays
from pinotwin.virtual.truth import Pulse

DEG = np.pi / 180.0
HIT = 1.5
"""When the hammer comes down [s]: the table has come to rest."""


def limits_c1(machine: VirtualMachine) -> dict[str, Limits]:
    """Return the kinematic limits of Table C-1."""
    y, a = machine.limits["Y"], machine.limits["A"]
    y = replace(y, speed=0.285, acceleration=1.60, jerk=90.3)
    a = replace(a, speed=187.0 * DEG, acceleration=2340.0 * DEG, jerk=1.17e5 * DEG)
    return {**machine.limits, "Y": y, "A": a}


def zones(machine: VirtualMachine) -> Trajectory:
    """Return 13 s with the zones that the source points at in Fig. 7-2.

    A and B (0.5 to 3.5 s, 4 to 7 s): Y keeps its speed, there and back, while A starts and stops. C (8 to
    13 s): A goes from 72 deg to 0 while Y goes back and forth.
    """
    y, a = [], []
    for start, there in ((0.5, 0.15), (4.0, -0.15)):
        y.append((start, there, 3.0))
        a += [(start + 0.6 + 0.7 * k, 40.0 * DEG * ((k + 1) % 2), 0.0) for k in range(4)]
    y.append((7.2, 0.0, 0.0))
    a += [(7.2, 72.0 * DEG, 0.0), (8.2, 0.0, 4.5)]
    y += [(8.2 + 0.6 * k, 0.04 * (-1.0) ** k, 0.0) for k in range(8)]
    return Trajectory(
        13.0,
        {"Y": _path(machine, "Y", y), "A": _path(machine, "A", a), "C": rest(0.0)},
    )


def _path(machine: VirtualMachine, axis: str, stops: list[tuple[float, float, float]]):  # type: ignore[no-untyped-def]
    """Return a command from 0 through stops: start [s], target, seconds to take at least."""
    limits = machine.limits[axis]
    triple = (limits.speed or 0.0, limits.acceleration or 0.0, limits.jerk or 0.0)
    here, free, moves = 0.0, 0.0, []
    for start, target, seconds in stops:
        least = move_time(target - here, triple)
        if start < free:
            raise pt.DataError(f"{axis}: the move at {start:g} s begins before the last one ends")
        free = start + max(seconds, least)
        stretch = max(1.0, seconds / least)
        moves.append((move_pieces(start, target - here, triple, stretch), target))
        here = target
    return chain(0.0, moves)


def hit(tilt: float, side: float, force: float = 500.0, seconds: float = 0.005) -> Pulse:
    """Return a hammer pulse square on the tilted table, 0.1 m from its middle (Fig. 7-5).

    Args:
        tilt: position of A [rad].
        side: -1 or 1: towards -y or y.
        force: peak [N].
        seconds: duration [s].
    """
    c, s = np.cos(tilt), np.sin(tilt)
    turned = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    push, arm = turned @ [0.0, 0.0, -force], turned @ [0.0, 0.1 * side, 0.0]
    moment = np.cross(arm, push)
    return Pulse("C_link", HIT, seconds, tuple(push.tolist()), tuple(moment.tolist()))


def tilted(machine: VirtualMachine, tilt: float) -> Trajectory:
    """Return a move to a tilt [rad], then rest."""
    moves = {"Y": [(0.2, 0.05, 0.0)], "A": [(0.2, tilt, 0.0)]}
    profiles = {name: _path(machine, name, stops) for name, stops in moves.items()}
    return Trajectory(2.2, {**profiles, "C": rest(0.0)})


def hammer_command(
    machine: VirtualMachine, path: Trajectory, pulse: Pulse, rate: float = 4000.0
) -> Mapping[str, np.ndarray]:
    """Return command and force as channels, sampled as a hammer's own recorder does."""
    t = np.arange(round(path.seconds * rate)) / rate
    qr, _, _ = path.at(t, machine.axes)
    _, _, load = load_arrays(machine.true, [pulse], t)
    names = [f"{pulse.link}.{k}" for k in ("fx", "fy", "fz", "mx", "my", "mz")]
    channels = {"t": t} | {f"{n}.qr": qr[:, i] for i, n in enumerate(machine.axes)}
    return channels | {name: load[:, 0, k] for k, name in enumerate(names)}
