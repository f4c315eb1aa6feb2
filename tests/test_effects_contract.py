"""Every effect name that users and other programs rely on: listed, looked for, named, applied, worded."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from pinotwin.diagnosis.result import Diagnosis, Found
from pinotwin.effects import EFFECTS, LISTED, Effect, Tree, with_model_effort
from pinotwin.errors import MachineError
from pinotwin.machine import Machine
from pinotwin.machine.effect_list import make_effects
from pinotwin.motion import Motion
from tests.conftest import ROOT
from tests.motions import multisine
from tests.test_effects_listed import CASES, NOT_HERE

NAMES = (
    "rigid_body",
    "viscous",
    "coulomb",
    "coulomb_asymmetric",
    "stribeck",
    "load_friction",
    "presliding",
    "ripple",
    "ripple_modulated",
    "position_table",
    "payload",
    "inertial_coupling",
    "drive_flexibility",
    "joint_flexibility",
    "backlash",
    "delay",
    "effort_scale",
    "encoder_error",
    "viscous_thermal",
    "feedforward",
    "saturation",
    "external_force",
    "geometric_error",
    "quadratic_drag",
    "hysteresis",
    "loop_gain",
)
FILES = {"saturation": "effort_limit"}
"""Effects that machine.yaml holds in another place than a list of effects."""
NOWHERE = {"rigid_body", "payload", "external_force", "feedforward", "loop_gain"}
"""No entry of machine.yaml: a body is in the URDF, a push in a log, a gain in the controller."""


@pytest.fixture(scope="module")
def machine() -> Machine:
    found = Machine.load("trunnion")
    return dataclasses.replace(
        found.with_effects("A", make_effects(["viscous", "coulomb"], "A", True, "A")),
        passive={},
    )


@pytest.fixture(scope="module")
def motion(machine) -> Motion:
    """A rich motion with its command and a model's channels."""
    made = multisine(machine.names, machine.rotary, n=8000)
    made = dataclasses.replace(made, q=2.0 * made.q, v=2.0 * made.v, a=2.0 * made.a)
    plain = tuple(e for e in machine.effects if not e.needs and not e.held)
    rng = np.random.default_rng(0)
    theta = np.concatenate(
        [
            e.nominal() if e.nominal() is not None else rng.uniform(0.5, 1.0, len(e.coefficients()))
            for e in (x.fitted_to(made) for x in plain)
        ]
    )
    limited = np.clip(3.0 * np.sin(made.t), -2.0, 2.0)
    made = dataclasses.replace(
        made,
        u=np.stack([limited] * machine.nv, axis=1),
        qr=made.q + 1e-3 * np.sin(5.0 * made.t)[:, None],
        vr=made.v + 5e-3 * np.cos(5.0 * made.t)[:, None],
        ar=made.a - 25e-3 * np.sin(5.0 * made.t)[:, None],
    )
    return with_model_effort(made, tuple(x.fitted_to(made) for x in plain), theta)


def trial(name: str, machine: Machine, motion: Motion) -> Effect:
    found = EFFECTS[name].candidates(Tree.of(machine), "A", motion)
    assert found, f"{name} is never looked for"
    return found[len(found) // 2]


def diagnosis(machine: Machine, *found: Found) -> Diagnosis:
    return Diagnosis("", {}, [], list(found), [], {}, {}, "assumed", [], "structure", {}, subject=machine)


def finding(effect: Effect) -> Found:
    shapes = dict(zip((s.name for s in effect.shapes()), effect.shape_values(), strict=True))
    if effect.name == "saturation":
        shapes["limit"] = effect.limit
    theta = {c.name: 1.0 for c in effect.coefficients()}
    return Found(effect.name, effect.axis, 0.9, shapes, theta, {}, [], listed=effect)


def test_every_name_is_an_effect():
    assert set(NAMES) <= set(EFFECTS)
    assert {*CASES, *NOT_HERE} == set(LISTED), "a listed effect that no test identifies and simulates"


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("stribeck", {"v_s": 0.02, "exponent": 2.0}),
        ("load_friction", {"total": 1}),
        ("ripple", {"period": 0.01, "harmonics": (1, 2)}),
        ("ripple_modulated", {"period": 0.5, "eps": 0.1}),
    ],
)
def test_its_numbers_follow_the_axis_in_the_order_of_its_equation(name, given):
    kind = EFFECTS[name]
    assert kind("X", True, *given.values()) == kind("X", True, **given)


@pytest.mark.parametrize("name", NAMES)
def test_it_is_listed_or_refused_with_what_to_write_instead(name):
    if name in LISTED:
        item = {name: {"with": "C"}} if name in ("wrist_coupling", "inertial_coupling") else name
        (effect,) = make_effects([item], "A", True, "axes.A.effects")
        assert effect.name == name
    else:
        with pytest.raises(MachineError, match=f"{name} {re.escape(EFFECTS[name].unlisted[:20])}"):
            make_effects([name], "A", True, "axes.A.effects")


@pytest.mark.parametrize("name", [n for n in NAMES if n != "rigid_body"])
def test_it_is_looked_for_and_its_columns_act(name, machine, motion):
    effect = trial(name, machine, motion)
    columns = effect.columns(motion)
    assert np.isfinite(columns.values).all()
    assert np.abs(columns.values).max() > 0.0
    assert machine.axis("A").index in columns.joints


@pytest.mark.parametrize("name", sorted({*LISTED, *FILES} - {"spring"}))
def test_a_finding_is_written_and_read_again(name, machine, motion, tmp_path):
    effect = trial(name, machine, motion)
    again = Machine.load(diagnosis(machine, finding(effect)).apply(tmp_path))
    if name in FILES:
        assert again.axis("A").effort_limit == pytest.approx(2.0)
        return
    names = [e.name for e in again.axis("A").effects]
    assert names.count(name) == 1
    assert not set(names) & set(effect.contains), "an effect beside one that contains it"
    (listed,) = (e for e in again.axis("A").effects if e.name == name)
    for shape, value in zip(effect.shapes(), effect.shape_values(), strict=True):
        assert getattr(listed, shape.name) == pytest.approx(value)


@pytest.mark.parametrize("name", sorted(NOWHERE - {"rigid_body"}))
def test_what_machine_yaml_cannot_say_leaves_it_readable(name, machine, motion, tmp_path):
    again = Machine.load(diagnosis(machine, finding(trial(name, machine, motion))).apply(tmp_path))
    assert [e.name for e in again.axis("A").effects] == ["viscous", "coulomb"]


def test_a_ripple_that_is_listed_already_is_not_listed_twice(machine, motion, tmp_path):
    one = trial("ripple", machine, motion)
    again = Machine.load(diagnosis(machine, finding(one)).apply(tmp_path / "one"))
    more = diagnosis(again, finding(one), finding(EFFECTS["ripple"].candidates(machine, "A", motion)[0]))
    pitches = [e.period for e in Machine.load(more.apply(tmp_path / "two")).axis("A").effects if e.several]
    assert len(pitches) == 2


@pytest.mark.parametrize("name", NAMES)
def test_the_table_of_the_docs_has_it(name):
    row = re.search(rf"^\| {name} \| (.*) \|$", (ROOT / "docs" / "effects.md").read_text(), re.M)
    assert row is not None
    applied = row[1].split(" | ")[-1]
    if name in FILES:
        assert FILES[name] in applied
    elif name in LISTED:
        assert applied == "machine.yaml"
    else:
        assert applied == "URDF" or applied.startswith("by hand: it ")
    assert EFFECTS[name].words
