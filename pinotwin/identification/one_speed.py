"""Friction of an axis that its logs move at one speed: they tell what it is there, not how it grows with speed.

How the axis turns would part dry from viscous friction, and there neither is a true law.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from pinotwin.effects.layout import effect_slices
from pinotwin.identification.plant import Plant, open_loop
from pinotwin.identification.settings import Settings
from pinotwin.machine import Machine


def at_one_speed(
    machine: Machine, plant: Plant, settings: Settings
) -> tuple[Plant, dict[str, dict[str, float]]]:
    """Return a plant that claims no part of a friction of one speed; axis -> speed, effort there, 95 % ``half`` [SI].

    It is one speed where four fifths of the travel are covered within the share ``one_speed`` of the middle one.
    """
    fit, motion, near, sums = plant.fit, plant.motion, settings.one_speed, {}
    determined, groups = fit.determined.copy(), list(fit.groups)
    friction = [
        (effect, where)
        for effect, where in zip(plant.effects, effect_slices(plant.effects), strict=True)
        if effect.axis and effect.depends in ("direction", "velocity")
    ]
    for joint in fit.problem.slices:
        name, v, moving = motion.names[joint], motion.v[:, joint], motion.moving(joint)
        mine = [(effect, where) for effect, where in friction if effect.axis == name]
        if len({effect.depends for effect, _ in mine}) < 2 or not v[moving].any():
            continue
        speeds = np.sort(np.abs(v[moving]))
        slow, speed, fast = np.interp([0.1, 0.5, 0.9], np.cumsum(speeds) / speeds.sum(), speeds)
        if max(speed - slow, fast - speed) > near * speed:
            continue
        there = moving & (np.abs(v) >= slow)
        side, weights = np.sign(v[there]) / there.sum(), np.zeros(len(plant.theta))
        for effect, where in mine:
            weights[where] = side @ effect.columns(motion).values[there, 0]
        # what is left there is friction too: the fit bends it to how the axis turns
        felt = 0.0 if motion.external is None else motion.external
        left = (motion.u + felt - open_loop(machine, plant).effort(motion))[there, joint]
        own = [k for _, where in mine for k in range(where.start, where.stop)]
        determined[own] = False
        groups.append(tuple(own))
        half = stdtrit(fit.dof[own].min(), 0.975) * np.sqrt(weights @ fit.covariance @ weights)
        numbers = (side @ v[there], weights @ plant.theta + side @ left, half)
        sums[name] = dict(zip(("speed", "effort", "half"), map(float, numbers), strict=True))
    return replace(plant, fit=replace(fit, determined=determined, groups=tuple(groups))), sums
