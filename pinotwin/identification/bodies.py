"""Bodies near the URDF's: how much it counts, what that costs on unseen rows, and whose each mass is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.dynamics.parameters import body_count, parameters
from pinotwin.dynamics.plausible import plausible
from pinotwin.effects.layout import rigid_body_of
from pinotwin.identification.judge import CrossValidated
from pinotwin.identification.plant import Plant
from pinotwin.identification.settings import Settings
from pinotwin.identification.smooth import independent, memory
from pinotwin.machine import Machine
from pinotwin.solve.bodies import Bodies, Evidence, Near, near


def near_urdf(
    machine: Machine, plant: Plant, known: CrossValidated, settings: Settings, rows: float | None = None
) -> tuple[Plant, CrossValidated, dict[str, Any]]:
    """Return the plant with bodies near the URDF's, its rows predicted part by part, and what bodies cost on these.

    The price is the held-out error over that of the plant as given, and over the least at any weight of the URDF: what
    bodies cannot explain is a missing effect or a wrong URDF. So many ``rows`` [1] tell as much as an independent one.
    """
    (bodies, dummy), fit = bodies_of(machine), plant.fit
    rigid = rigid_body_of(plant.effects)[1]
    evidence = Evidence(
        fit.factor, fit.right, fit.theta, np.arange(rigid.start, rigid.stop), fit.lower, fit.upper
    )
    weight, price = settings.urdf_rows[0], dict.fromkeys(("unseen_over_free", "unseen_over_best"))
    found = near(evidence, bodies, weight * (rows or correlated_rows(plant, fit.theta)))
    rows = rows or correlated_rows(plant, found.theta)
    if (held := known.held) is not None:
        parts = [replace(evidence, factor=x.held[0], right=x.held[1], theta=x.theta) for x in held.fits]
        folds = {
            w: np.array([near(part, bodies, w * rows, found).theta for part in parts])
            for w in (*settings.urdf_rows, *settings.other_rows)
        }
        unseen = {w: held.weighted(theta) for w, theta in folds.items()}
        weight = min(settings.urdf_rows, key=unseen.__getitem__)
        free, least = held.weighted(held.theta), min(unseen.values())
        price = {"unseen_over_free": unseen[weight] / free, "unseen_over_best": unseen[weight] / least}
    found = near(evidence, bodies, weight * rows, found)
    if held is not None:
        known = replace(known, held=held.by(known.problem, folds[weight], found.theta))
    noise = fit.sigma[fit.problem.axis_place]
    left = [(fit.problem.y - fit.problem.W @ theta) / noise for theta in (found.theta, fit.theta)]
    ratio = float(left[0] @ left[0] / (left[1] @ left[1])) if left[1].any() else None
    price |= {"moved": True, "cost_ratio": ratio, "urdf_rows": weight, "correlated_rows": rows}
    said = body_rows(machine, found, dummy, rows, settings)
    return replace(plant, theta=found.theta, pi=found.pi, bodies=said), known, price


def bodies_of(machine: Machine) -> tuple[Bodies, Mask]:
    """Return the bodies of a machine as believed before any log, and which of its inertials are dummies."""
    P, count = machine.base.P, body_count(machine.model)
    acting = np.linalg.norm(P[:, : 10 * count].reshape(len(P), count, 10), axis=(0, 2)) > 0.0
    pi, dummy = plausible(machine.model, acting)
    return Bodies(P, pi, count), dummy


def correlated_rows(plant: Plant, theta: Floats) -> float:
    """Return how many rows of one sigma tell as much as an independent row of the residual, mean of the axes [1].

    By the variance of the residual's sum: what bodies that can exist leave is correlated for a second.
    """
    return float(np.mean(independent(plant.fit.problem, theta, plant.fit.sigma, memory(plant.motion))))


def body_rows(
    machine: Machine, found: Near, dummy: Mask, rows: float, settings: Settings
) -> tuple[dict[str, Any], ...]:
    """Return a row a body: mass, the URDF's, whose, and its interval [kg]; ``rows`` tell as much as one independent."""
    out = []
    urdf = parameters(machine.model)
    for k, joint in enumerate(list(machine.model.names)[1:]):
        mass, share = float(found.pi[10 * k]), float(found.share[k])
        source = "rod" if dummy.any() else "URDF" if share > settings.urdf_share else "log"
        half = 1.96 * float(found.error[k]) * np.sqrt(rows)
        interval = [mass - half, mass + half] if source == "log" else None
        row = {"joint": joint, "mass": mass, "urdf": float(urdf[10 * k]), "share": share}
        out.append({**row, "source": source, "interval95": interval})
    return tuple(out)
