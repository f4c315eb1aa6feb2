"""A payload is a body: it can exist, or was taken off; it is written into the inertia of its link."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import pinotwin as pt
from pinotwin.columns import bind
from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.conclusion.sizes import body_sizes, undetermined
from pinotwin.diagnosis.payload import (
    found_body,
    loaded_twin,
    physical,
    possible,
)
from pinotwin.dynamics.parameters import pseudo_inertia
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.report.diagnosis_verdict import headline
from pinotwin.signals import rms

LAST = "lwr_6"
KILOGRAM = pin.Inertia(1.0, np.array([0.0, 0.0, 0.05]), np.zeros((3, 3)))


def with_mass(machine, log):
    """Return the log that the robot would have written with a kilogram on its last link."""
    heavy = machine.model.copy()
    joint = heavy.getJointId(machine.axis(LAST).joint)
    heavy.inertias[joint] = heavy.inertias[joint] + KILOGRAM
    motion = prepare(machine, bind(log, machine.columns))
    one, two = machine.model.createData(), heavy.createData()
    extra = np.array(
        [
            pin.rnea(heavy, two, *x) - pin.rnea(machine.model, one, *x)
            for x in zip(motion.q, motion.v, motion.a, strict=True)
        ]
    )
    more = {}
    for name, axis in machine.axes.items():
        x = np.interp(log.t - log.t[0], motion.t - motion.t[0], extra[:, axis.index])
        more[f"{name}.u"] = log[f"{name}.u"] + x
    return Log({**log.channels, **more}, source=f"loaded {log.source}")


@pytest.fixture(scope="module")
def robot(data_dir):
    return Machine.load(data_dir / "kuka_lwr4")


@pytest.fixture(scope="module")
def logs(data_dir):
    return [pt.read(data_dir / "kuka_lwr4" / f"measurements_{k}.csv") for k in (1, 2, 3)]


@pytest.fixture(scope="module")
def twin(robot, logs):
    return identify(robot, logs[1:], loop=False)


@pytest.fixture(scope="module")
def found(twin, robot, logs):
    return diagnose(twin, with_mass(robot, logs[0]), quick=True)


def test_a_kilogram_on_a_real_robot(found):
    first = found.effects[0]
    assert (first.effect, first.axis) == ("payload", LAST)
    mass = first.size[0]
    assert 0.9 < mass.after < 1.1
    assert mass.interval[0] < 1.0 < mass.interval[1]
    centre = {s.name: s for s in first.size}["payload.cz"]
    assert centre.after == pytest.approx(0.05, abs=0.02)


def test_it_counts_on_every_axis_that_it_acts_on(found):
    acts = found.effects[0].acts
    assert len(acts) > 1
    lines = headline(found)
    for axis, shrink in acts.items():
        gap = found.gap[axis]["u"]
        assert (shrink.axis, shrink.before) == (axis, gap.rms)
        assert gap.after < gap.rms
        assert found.grade(axis) != "not explained"
        assert not any(f"Axis {axis}:" in x and "closed by no named cause" in x for x in lines)


def test_a_kilogram_that_was_taken_off(robot, logs):
    own = identify(robot, [with_mass(robot, log) for log in logs[1:]], loop=False)
    first = diagnose(own, logs[0], quick=True).effects[0]
    assert (first.effect, first.axis) == ("payload", LAST)
    assert -1.1 < first.size[0].after < -0.9
    assert first.size[0].interval[0] < -1.0 < first.size[0].interval[1]


def test_apply_writes_it_into_the_link(found, twin, tmp_path):
    again = Machine.load(found.apply(tmp_path / "m"))
    joint = again.model.getJointId(again.axis(LAST).joint)
    before, after = twin.model.inertias[joint], again.model.inertias[joint]
    assert after.mass - before.mass == pytest.approx(found.effects[0].size[0].after, rel=1e-6)
    assert np.linalg.eigvalsh(pseudo_inertia(after.toDynamicParameters()))[0] > -1e-9
    others = [k for k in range(1, again.model.njoints) if k != joint]
    assert all(again.model.inertias[k].isApprox(twin.model.inertias[k], 1e-6) for k in others)


def test_an_inertia_that_one_axis_shows_is_no_body_to_write(found):
    """It was a KeyError when the diagnosis was saved."""
    one = replace(found.effects[0], theta={"inertia": 0.1})
    nothing = replace(found, effects=[])
    same = (x.repaired().model.inertias for x in (replace(found, effects=[one]), nothing))
    assert all(a == b for a, b in zip(*same, strict=True))


def test_a_twin_with_it_says_the_effort_of_the_loaded_robot(found, twin, robot, logs):
    log = with_mass(robot, logs[0])
    later = loaded_twin(twin, LAST, found_body(found.effects[0].theta))
    motion = twin.motion(log)
    before, after = (rms((motion.u - t.effort(motion))[:, 3]) for t in (twin, later))
    assert after < 0.3 * before
    assert later.model.inertias[7].mass - twin.model.inertias[7].mass == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_found_can_exist_with_its_mass_and_centre(sign):
    pi = sign * np.array([2.0, 0.2, -0.1, 0.4, -0.5, 0.3, 0.01, 0.2, 0.1, 0.02])
    body = physical(pi)
    assert body[:4] == pytest.approx(pi[:4])
    assert np.linalg.eigvalsh(pseudo_inertia(sign * body))[0] > -1e-12


def test_a_body_that_can_exist_is_left_as_it_is():
    pi = pin.Inertia(3.0, np.array([0.1, 0.2, 0.0]), np.diag([0.2, 0.3, 0.25])).toDynamicParameters()
    assert physical(pi) == pytest.approx(pi)


SURE = np.diag([1e-4] + [1e-6] * 3 + [1e-8] * 6)
CASES = [
    ("a kilogram", [1.0, 0.0, 0.0, 0.05], SURE, False, True),
    ("less than nothing", [-1.0, 0.0, 0.0, -0.05], SURE, False, False),
    ("a tool taken off", [-1.0, 0.0, 0.0, -0.05], SURE, True, True),
    ("more than hangs there, taken off", [-500.0, 0.0, 0.0, -0.05], SURE, True, False),
    ("a mass in the next room", [1.0, 30.0, 0.0, 0.0], SURE, False, False),
    ("an inertia without a mass that is known", [0.001, 0.0, 0.0, 0.3], SURE, False, True),
]


@pytest.mark.parametrize(
    ("what", "numbers", "covariance", "removal", "can"), CASES, ids=[c[0] for c in CASES]
)
def test_what_a_payload_can_be(robot, what, numbers, covariance, removal, can):
    del what
    pi = np.array([*numbers, *np.zeros(6)])
    assert possible(pi, covariance, robot.model, removal=removal) is can


def test_what_is_not_told_is_said_to_be_open():
    pi = np.array([1.0, 0.0, 0.0, 0.1, *np.zeros(6)])
    vague = np.diag([1e-4, 1.0, 1e-6, 1e-6, *[1e-8] * 6])
    sizes = body_sizes(pi, vague)
    assert undetermined(sizes) == ["centre of mass along x"]
    pi[0] = 0.001
    pi[9] = 0.02
    sizes = body_sizes(pi, SURE)
    assert sizes[0].name != "payload.mass"
    assert undetermined(sizes)[0] == "mass"


def test_a_body_has_mass_and_centre_with_intervals():
    pi = np.array([2.0, 0.2, 0.0, -0.1, *np.zeros(6)])
    covariance = np.diag(np.array([0.01, 0.002, 0.002, 0.002, *np.ones(6)]) ** 2)
    mass, *centre = body_sizes(pi, covariance)
    assert mass.interval == pytest.approx((2.0 - 0.01645, 2.0 + 0.01645))
    assert [x.after for x in centre] == pytest.approx([0.1, 0.0, -0.05])
    half = 0.5 * (centre[0].interval[1] - centre[0].interval[0])
    assert half == pytest.approx(1.645 * np.hypot(0.002, 0.01 * 0.1) / 2.0)
    mass, *centre = body_sizes(-pi, covariance)
    assert mass.after == -2.0
    assert [x.after for x in centre] == pytest.approx([0.1, 0.0, -0.05])
