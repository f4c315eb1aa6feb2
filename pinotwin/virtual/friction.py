"""Friction that sticks, as the plant feels it, of the level ``g = C (1 + (static - 1) exp(-(v/vs)^2))``.

LuGre (Canudas de Wit et al. 1995, doi:10.1109/9.376053): ``dz/dt = v - |v| s0 z / g(v)``, ``f = s0 z + s1 dz/dt``;
exact over a step of constant ``v`` at any stiffness, the force being its mean.
Elasto-plastic (Dupont et al. 2002, doi:10.1109/TAC.2002.1000274): ``dz/dt = v (1 - w z / z_s)``, z_s = g / s0; w is 0
below the breakaway deflection 0.9 z_s and while the bristle is unloaded, and grows as half a sine to 1 at z_s.
GMS (Al-Bender et al. 2005, doi:10.1109/TAC.2005.858676): parallel springs, each of which slips from its share of
``g(v)`` until its speed turns round. Nothing creeps below breakaway, as it does with LuGre and with no machine. The
force is 5 ms late: 3 to 9 ms were measured (Armstrong-Hélouvry et al. 1994, doi:10.1016/0005-1098(94)90209-7).
"""

from __future__ import annotations

import numpy as np

from pinotwin.virtual import columns as c
from pinotwin.virtual.columns import kernel

# Slip levels and stiffnesses of the four elements, as shares of the whole.
_LEVELS = (0.4, 0.3, 0.2, 0.1)
_STIFF = (0.1, 0.2, 0.3, 0.4)
_LAG = 5e-3  # of a sliding element's force behind its level [s], see the module


@kernel
def friction_level(P, i, q, v, load, noise):  # type: ignore[no-untyped-def]
    """Return the level g [N or N·m] at which the bristles of an axis slip."""
    level = P[i, c.LEVEL_P] if v >= 0.0 else P[i, c.LEVEL_N]
    if P[i, c.WANDER] != 0.0:
        level *= 1.0 + P[i, c.WANDER] * np.sin(P[i, c.WANDER_RATE] * q)
    if P[i, c.BY_LOAD] != 0.0:
        level += P[i, c.BY_LOAD] * abs(load)
    x = v / P[i, c.STRIBECK]
    if x * x < 30.0:
        slow = np.exp(-x * x)
        level *= (1.0 + (P[i, c.STATIC] - 1.0) * slow) * (1.0 + P[i, c.CHATTER] * noise * slow)
    return level


@kernel
def bristle_force(P, i, level, v, z, dt):  # type: ignore[no-untyped-def]
    """Advance the bristles ``z`` by one step of constant speed and return their mean force over it."""
    s0, s1 = P[i, c.BRISTLE], P[i, c.BRISTLE_DAMPER]
    if P[i, c.LAW] != c.GMS:
        old, steady = z[i, 0], np.sign(v) * level / s0
        if P[i, c.LAW] == c.LUGRE:
            new = steady + (old - steady) * np.exp(-abs(v) * s0 * dt / level)
        else:
            new = _elastoplastic(old, v, level / s0, dt)
        z[i, 0] = new
        return 0.5 * s0 * (old + new) + s1 * (new - old) / dt
    old = z[i, 0] + z[i, 1] + z[i, 2] + z[i, 3]
    new = 0.0
    for k in range(c.ELEMENTS):
        _slide(z, i, k, (_STIFF[k] * s0 * v * dt, _LEVELS[k] * level), np.exp(-dt / _LAG))
        new += z[i, k]
    return 0.5 * (old + new) + s1 * (new - old) / (s0 * dt)


@kernel
def _slide(z, i, k, push, kept):  # type: ignore[no-untyped-def]
    """Advance Maxwell element ``k``: ``push`` is its spring's rise and slip level [N or N·m], ``kept`` a share [-]."""
    rise, level = push
    slips = c.SLIPS + k
    if z[i, slips] * rise > 0.0:
        limit = z[i, slips] * level
        z[i, k] = limit + (z[i, k] - limit) * kept
        return
    force = z[i, k] + rise
    z[i, slips] = 0.0
    if abs(force) >= level and force * rise > 0.0:
        z[i, slips] = np.sign(force)
        force = z[i, slips] * max(level, abs(z[i, k]))  # a level that fell below it is met late, too
    z[i, k] = force


@kernel
def _elastoplastic(old, v, most, dt):  # type: ignore[no-untyped-def]
    """Return the deflection [m or rad] after a step, elastic part first; ``most`` is that of steady motion."""
    way, breakaway = v * dt, 0.9  # of the steady deflection
    if way == 0.0:
        return old
    side = np.sign(way)
    x = side * old  # deflection in the direction of motion
    free = breakaway * most - x
    if abs(way) <= free:
        return old + way
    if free > 0.0:
        x += free
        way -= side * free
    end = min(x + abs(way), most)
    share = (end / most - breakaway) / (1.0 - breakaway)
    w = 0.5 + 0.5 * np.sin(np.pi * (min(share, 1.0) - 0.5))
    if w < 1e-9:
        return side * end
    steady = most / w
    return side * min(steady + (x - steady) * np.exp(-abs(way) / steady), max(most, x))


@kernel
def steady_force(P, i, v, z):  # type: ignore[no-untyped-def]
    """Return the friction effort without the damping of its bristles: a level under load would chase its tail."""
    held = z[i, : c.ELEMENTS].sum() if P[i, c.LAW] == c.GMS else P[i, c.BRISTLE] * z[i, 0]
    return held + P[i, c.VISCOUS] * v + P[i, c.QUADRATIC] * v * abs(v)


@kernel
def drag_force(P, i, v, z, dt):  # type: ignore[no-untyped-def]
    """Advance the drag of an axis' cables by one step and return its mean effort over it.

    Bouc 1967, Wen 1976 (doi:10.1061/JMCEA3.0002106): ``w' = A v - beta |v| |w|^(n-1) w - beta v |w|^n``; w, a column
    of ``z``, is the drag itself [N or N·m], A = drag / distance, beta = A / (2 drag^n).
    """
    w, full = z[i, c.CABLE], P[i, c.DRAG]
    A = full * P[i, c.DRAG_RATE]
    share = abs(w / full) ** P[i, c.DRAG_SHARP]
    middle = w + 0.5 * dt * A * (v - 0.5 * share * (abs(v) * np.sign(w) + v))
    share = abs(middle / full) ** P[i, c.DRAG_SHARP]
    new = w + dt * A * (v - 0.5 * share * (abs(v) * np.sign(middle) + v))
    z[i, c.CABLE] = min(max(new, -full), full)
    return 0.5 * (w + z[i, c.CABLE])


@kernel
def friction_force(P, i, q, v, z, load, extra, dt):  # type: ignore[no-untyped-def]  # noqa: PLR0913 (a struct of these costs more than the law)
    """Return the friction of axis ``i`` [N or N·m]; its states ``z``, (na, N_STATES), advance by dt [s].

    ``load`` is what the transmission carries; ``extra``, (2, na), how warm each axis is and a number for chatter.
    """
    force = P[i, c.VISCOUS] * (1.0 + P[i, c.WARMING] * extra[0, i]) * v + P[i, c.QUADRATIC] * v * abs(v)
    if P[i, c.DRAG] != 0.0:
        force += drag_force(P, i, v, z, dt)
    if P[i, c.LAW] != c.NONE:
        level = friction_level(P, i, q, v, load, extra[1, i])
        if level > 0.0:
            force += bristle_force(P, i, level, v, z, dt)
    return force
