"""Every effect that machine.yaml may list is identified and simulated, whatever it is made of."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pinotwin.analysis.disturbance import diagonal
from pinotwin.effects import EFFECTS, LISTED, Coulomb, Effect, Viscous, with_model_effort
from pinotwin.effects.layout import effect_slices
from pinotwin.errors import DataError
from pinotwin.identification.plant import fit_plant
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.simulation.run import as_motion, respond
from pinotwin.twin import Twin
from tests.motions import multisine
from tests.simulated import known_twin, nominal_twin, plain_machine, smooth_command

# Name -> coefficients and shapes of the truth, on the rotary axis A of the trunnion.
TRUTH: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "viscous": ((0.8,), ()),
    "viscous_asymmetric": ((0.6, 1.0), ()),
    "coulomb": ((0.5,), ()),
    "coulomb_asymmetric": ((0.4, 0.6), ()),
    "stribeck": ((0.4,), (0.08,)),
    "presliding": ((0.5, 0.3, 0.2, 0.0), (3e-3, 0.1)),
    "load_friction": ((0.05,), ()),
    "viscous_thermal": ((1.0,), (2.0,)),
    "quadratic_drag": ((0.3,), ()),
    "offset": ((0.6,), ()),
    "ripple": ((0.3, 0.2), (0.35,)),
    "ripple_modulated": ((0.3, 0.2, 0.4, 0.1), (0.35, 0.4)),
    "spring": ((5.0, 1.0), ()),
    "inertial_coupling": ((0.004,), ()),
    "wrist_coupling": ((0.004, 0.1, 0.2), ()),
    "drive_flexibility": ((0.6,), (22.0, 0.06)),
    "joint_flexibility": ((0.6,), (18.0, 0.1)),
    "backlash": ((0.6,), (6e-4, 160.0, 0.35)),
    "delay": ((4e-3,), (4e-3,)),
    "effort_scale": ((0.08,), ()),
    "encoder_error": ((2e-3, 1e-3), (2 * np.pi / 12,)),
    "hysteresis": ((1.5,), (0.02, 1.0)),
}
NOT_HERE = {"position_table", "geometric_error"}
"""A table's knots are many, and the tilt of the trunnion's first axes is one with its gravity."""
HARD = {"backlash": (0.6, (6e-4, 160.0, 0.35))}
"""The load behind a gap is a state that the stepping simulator does not carry: play is refused."""
INSTEAD = {"presliding": ("coulomb",), "coulomb_asymmetric": ("coulomb",), "viscous_asymmetric": ("viscous",)}
CASES = [name for name in LISTED if name not in NOT_HERE]


def machine_with(name: str) -> Machine:
    machine = plain_machine("trunnion")
    for axis, part in machine.axes.items():
        plain: tuple[Effect, ...] = (Viscous(axis, part.rotary), Coulomb(axis, part.rotary))
        if axis == "A":
            out = {name, *INSTEAD.get(name, ()), *(("viscous",) if name == "spring" else ())}
            effect = EFFECTS[name].on(machine, "A")
            if hasattr(effect, "partner"):
                effect = dataclasses.replace(effect, partner="C")
            plain = (*(e for e in plain if e.name not in out), effect)
        machine = machine.with_effects(axis, plain)
    return machine


def truth(machine: Machine, name: str) -> tuple[tuple[Effect, ...], np.ndarray]:
    """Return the effects at their true shapes and all true coefficients."""
    own, shape = TRUTH[name]
    usual = {"viscous": (40.0, 0.8), "coulomb": (12.0, 0.5)}
    effects, theta = [], []
    for effect in machine.effects:
        mine = effect.axis == "A" and effect.name == name
        if mine and name in ("ripple", "ripple_modulated"):
            effect = dataclasses.replace(effect, free_pitch=True)
        effects.append(effect.shaped(shape) if mine and shape else effect)
        nominal = effect.nominal()
        theta.append(
            own if mine else nominal if nominal is not None else (usual[effect.name][effect.rotary],)
        )
    return tuple(effects), np.concatenate(theta)


def recorded(machine: Machine, name: str) -> tuple[Motion, tuple[Effect, ...], np.ndarray]:
    """Return a motion whose effort follows the truth, with white noise of 0.2 %."""
    effects, theta = truth(machine, name)
    motion = multisine(machine.names, machine.rotary, n=8000)
    effects = tuple(e.fitted_to(motion) for e in effects)
    full = with_model_effort(motion, effects, theta)
    u = sum(
        e.columns(full).effort(theta[s], machine.nv)
        for e, s in zip(effects, effect_slices(effects), strict=True)
    )
    noise = 0.002 * u.std(axis=0) * np.random.default_rng(0).standard_normal(u.shape)
    return dataclasses.replace(motion, u=u + noise), effects, theta


def place(effects: tuple[Effect, ...], name: str) -> tuple[int, slice]:
    at = next(k for k, e in enumerate(effects) if e.name == name and e.axis == "A")
    return at, effect_slices(effects)[at]


@pytest.mark.parametrize("name", CASES)
def test_a_listed_effect_is_identified(name):
    machine = machine_with(name)
    motion, effects, theta = recorded(machine, name)
    plant = fit_plant(machine, motion)
    at, where = place(plant.effects, name)
    assert plant.fit.determined[where].all()
    size = np.abs(theta[where]).max()
    assert np.abs(plant.theta[where] - theta[where]).max() < 0.05 * size
    found, true = plant.effects[at].shape_values(), effects[at].shape_values()
    for shape, x, y in zip(effects[at].shapes(), found, true, strict=True):
        scale = abs(y) if shape.log else 0.1 * (shape.upper - shape.lower)
        assert abs(x - y) < 0.1 * scale, f"{shape.name}: {x} for {y}"


def twin_with(name: str) -> Twin:
    """Return a twin that holds the effect at its truth, with the loops of the same machine without it."""
    plain = known_twin(plain_machine("trunnion"))
    machine = machine_with(name)
    effects, theta = truth(machine, name)
    twin = dataclasses.replace(
        nominal_twin(machine), effects=effects, theta=theta, loops=plain.loops, diagonal=plain.diagonal
    )
    sizes = diagonal(twin, multisine(machine.names, machine.rotary, n=100))
    twin = dataclasses.replace(twin, diagonal={**sizes, "inertia": plain.diagonal["inertia"]})
    if all(e.mode() is None for e in effects):
        return twin
    # beside transfer functions a load on a spring is one of their poles
    return dataclasses.replace(twin, loops={}, servos=plain.servos)


def left(twin: Twin) -> tuple[np.ndarray, Motion]:
    """Return effort of a simulation less the twin's own for the simulated motion, and that motion."""
    out = respond(twin, smooth_command(twin.machine, 1.0, 1000.0))
    motion = as_motion(twin, out)
    inner = slice(20, -20)
    return (motion.u - twin.effort(motion))[inner, 1], motion


@pytest.fixture(scope="module")
def plain_left() -> float:
    return float(left(twin_with("viscous"))[0].std())


@pytest.mark.parametrize("name", [name for name in CASES if name != "backlash"])
def test_a_simulated_motion_obeys_the_equation_of_every_effect(name, plain_left):
    twin = twin_with(name)
    residual, motion = left(twin)
    _, where = place(twin.effects, name)
    at = twin.effects[place(twin.effects, name)[0]]
    own = at.columns(twin.scene(motion)).effort(twin.theta[where], twin.machine.nv)[20:-20, 1]
    # Dry friction turns within a sample, which the effort of a whole sample does not follow.
    assert residual.std() < 3.0 * plain_left + 0.05 * own.std()


@pytest.mark.parametrize("name", sorted(HARD))
def test_what_cannot_be_simulated_says_so_in_one_line(name, monkeypatch):
    share, shape = HARD[name]
    monkeypatch.setitem(TRUTH, name, ((share,), shape))
    with pytest.raises(DataError, match=f"{name} does not settle") as caught:
        left(twin_with(name))
    assert "\n" not in str(caught.value)


def test_low_speed_friction_fades_no_sooner_than_its_direction_has_turned() -> None:
    made = [
        EFFECTS["stribeck"]("X", rotary=x, **width) for x in (False, True) for width in ({}, {"width": 0.03})
    ]
    assert [e.shapes()[0].lower for e in made] == pytest.approx([2e-3, 0.06, 2e-2, 0.06])
