"""One effect from end to end: cable drag with a long memory, against a truth that shares no code with it."""

from __future__ import annotations

import dataclasses
import itertools
import json

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.diagnosis.phrases import explanation, plain_sentence
from pinotwin.effects import EFFECTS, Coulomb, Viscous, with_model_effort
from pinotwin.effects.family import FRICTION
from pinotwin.effects.hysteresis import Hysteresis
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.simulation import respond
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.motions import multisine

DRAG = 18.0
"""Effort of the cable of axis Y [N]."""


def stroke(*ends: float) -> Motion:
    """Slow strokes of axis Y between positions."""
    q = np.concatenate([np.linspace(a, b, 400) for a, b in itertools.pairwise(ends)])
    base = multisine(n=len(q))
    return dataclasses.replace(base, q=np.stack([q, q], axis=1))


def test_it_builds_up_as_an_exponential_where_the_exponent_is_one():
    """With n = 1 the equation of the first slide has the solution 1 - exp(-x / x_h)."""
    motion = stroke(0.0, 0.08)
    z = Hysteresis("Y", x_h=0.01).columns(motion).values[:, 0, 0]
    np.testing.assert_allclose(z, 1.0 - np.exp(-motion.q[:, 0] / 0.01), atol=1e-6)


def test_a_loop_after_a_reversal_lets_go_in_full_and_builds_up_again():
    """From z = 1, going back: z falls linearly to zero over x_h, then builds up the other way."""
    motion = stroke(0.0, 0.3, 0.2)
    z = Hysteresis("Y", x_h=0.01).columns(motion).values[400:, 0, 0]
    back = 0.3 - motion.q[400:, 0]
    expected = np.where(back < 0.01, 1.0 - back / 0.01, -(1.0 - np.exp(-(back - 0.01) / 0.01)))
    np.testing.assert_allclose(z, expected, atol=2e-3)


def test_it_is_bounded_takes_energy_over_a_closed_loop_and_knows_no_time():
    motion = stroke(0.0, 0.05, -0.05, 0.05)
    for n in (0.5, 1.0, 2.0):
        z = Hysteresis("Y", x_h=0.02, n=n).columns(motion).values[:, 0, 0]
        assert np.abs(z).max() <= 1.0
        closed = slice(400, None)
        assert np.trapezoid(z[closed], motion.q[closed, 0]) > 0.0
    slow = dataclasses.replace(motion, t=10.0 * motion.t, step=10.0 * motion.step, v=0.1 * motion.v)
    law = Hysteresis("Y", x_h=0.02)
    np.testing.assert_array_equal(law.columns(motion).values, law.columns(slow).values)


def test_it_forgets_by_displacement():
    law = Hysteresis("Y", x_h=0.002)
    starts = [law.columns(stroke(x, 0.05, 0.15)).values for x in (0.0, 0.048)]
    np.testing.assert_allclose(starts[0][-1], starts[1][-1], atol=1e-9)
    short = [law.columns(stroke(0.0, x, 0.05, 0.051)).values for x in (0.01, 0.1)]
    assert abs(short[0][-1] - short[1][-1]) > 1e-3


@pytest.fixture(scope="module")
def machine(urdf_dir) -> Machine:
    found = light(urdf_dir)
    return found.with_effects("Y", (*found.axis("Y").effects, Hysteresis("Y")))


def light(urdf_dir) -> Machine:
    """The trunnion with plain friction: few shapes to search, so that these tests are quick."""
    machine = Machine.load(urdf_dir / "trunnion")
    for name, axis in machine.axes.items():
        machine = machine.with_effects(name, (Viscous(name, axis.rotary), Coulomb(name, axis.rotary)))
    return machine


@pytest.fixture(scope="module")
def logs(urdf_dir):
    """A virtual trunnion with a cable on Y: one log to identify, one to predict.

    What :func:`light` does not list is left out of the truth; friction's presliding stays in it.
    """
    bare = ["ripple", "position_table", "stribeck", "coulomb_asymmetric", "load_friction"]
    inject = [{"effect": "hysteresis", "axis": "Y", "value": DRAG}]
    truth = VirtualMachine.load(urdf_dir / "trunnion", withhold=bare, inject=inject)
    made = [truth.record(random_trajectory(truth, 12.0, seed), seed=seed) for seed in (3, 4)]
    return truth.truth.axes["Y"].friction, [r.to_log() for r in made]


def test_the_law_agrees_with_a_truth_that_is_integrated_in_time(logs, urdf_dir):
    """The virtual machine steps w' = A v - beta |v| |w|^(n-1) w - gamma v |w|^n, substep by substep."""
    bare = ["ripple", "position_table", "coulomb", "viscous", "coulomb_asymmetric", "stribeck"]
    inject = [{"effect": "hysteresis", "axis": "Y", "value": DRAG}]
    machine = VirtualMachine.load(urdf_dir / "trunnion", withhold=[f"{x}:Y" for x in bare], inject=inject)
    made = machine.record(random_trajectory(machine, 8.0, 5), seed=0, noise=False)
    q = made.truth.joint("Y")[0]
    motion = dataclasses.replace(multisine(n=len(q)), q=np.stack([q, q], axis=1))
    f = machine.truth.axes["Y"].friction
    law = Hysteresis("Y", x_h=f.drag_distance, n=f.drag_sharpness)
    found = DRAG * law.columns(motion).values[:, 0, 0]
    assert np.sqrt(np.mean((found - made.truth.friction[:, 0]) ** 2)) < 0.02 * DRAG


@pytest.fixture(scope="module")
def twin(machine, logs):
    return pt.identify(machine, logs[1][0])


def test_it_is_identified_within_five_percent(twin, logs):
    truth, _ = logs
    assert twin.parameter("Y.hysteresis.k").value == pytest.approx(DRAG, rel=0.05)
    assert twin.parameter("Y.hysteresis.x_h").value == pytest.approx(truth.drag_distance, rel=0.15)
    assert twin.parameter("Y.hysteresis.k").determined


@pytest.fixture(scope="module")
def bare(urdf_dir, logs):
    """The twin of a machine that does not list it."""
    return pt.identify(light(urdf_dir), logs[1][0], loop=False)


def test_a_log_that_was_not_fitted_is_predicted_better_with_it(twin, bare, logs):
    def left(candidate) -> float:
        motion = candidate.motion(logs[1][1])
        rows = motion.use[:, 0]
        return float(np.sqrt(np.mean((motion.u - candidate.effort(motion))[rows, 0] ** 2)))

    assert left(twin) < 0.6 * left(bare)


def test_it_is_simulated_from_the_command_alone(twin, logs):
    """What the drag changes in the simulated effort is the drag along the measured path."""
    at = twin.keys.index("Y.hysteresis")
    theta = twin.theta.copy()
    theta[twin.slices[at]] = 0.0
    with_it, without = (
        respond(x, logs[1][1], controller="black") for x in (twin, dataclasses.replace(twin, theta=theta))
    )
    assert not [note for note in with_it.notes if "hysteresis" in note]
    drag = twin.effects[at].columns(twin.motion(logs[1][1])).values[:, 0, 0] * DRAG
    inner = slice(50, -50)
    change = (with_it.u - without.u)[inner, 0]
    assert np.sqrt(np.mean((change - drag[inner]) ** 2)) < 0.3 * DRAG
    assert np.corrcoef(logs[1][1]["Y.u"][inner], with_it.u[inner, 0])[0, 1] > 0.97


def test_a_twin_keeps_it_on_disk_and_a_machine_in_its_yaml(twin, tmp_path):
    twin.save(tmp_path / "twin")
    again = pt.Twin.load(tmp_path / "twin")
    assert again.effects[again.keys.index("Y.hysteresis")] == twin.effects[twin.keys.index("Y.hysteresis")]
    assert "hysteresis" in (tmp_path / "twin" / "machine.yaml").read_text()
    content = json.loads((tmp_path / "twin" / "twin.json").read_text())
    assert any(item["effect"] == "hysteresis" for item in content["effects"])


def test_it_is_worded_for_the_report():
    assert explanation("hysteresis") == EFFECTS["hysteresis"].words
    assert "cables" in explanation("hysteresis")
    assert plain_sentence("hysteresis on axis Y") == "hysteresis on axis Y"


def test_it_is_looked_for_where_a_log_shows_it(bare, machine, logs):
    """Among all friction, what takes most of the gap away is the drag, at about its distance."""
    motion = bare.motion(logs[1][0])
    left = (motion.u - bare.effort(motion))[:, 0]
    motion = with_model_effort(motion, bare.effects, bare.theta)
    friction = [name for name, e in EFFECTS.items() if e.family is FRICTION and not e.needs]
    base = [Viscous("Y"), Coulomb("Y")]
    tried = [e for name in friction for e in EFFECTS[name].candidates(machine, "Y", motion)]
    best = max(tried, key=lambda e: gain(left, motion, [*base, e]))
    assert best.name == "hysteresis"
    assert best.x_h == pytest.approx(logs[0].drag_distance, rel=0.2)


def gain(left: np.ndarray, motion: Motion, effects: list) -> float:
    """Return the share of a residual's mean square that some effects take away."""
    rows = motion.use[:, 0]
    w = np.concatenate([e.columns(motion).values[:, 0, :] for e in effects], axis=1)[rows]
    rest = left[rows] - w @ np.linalg.lstsq(w, left[rows], rcond=None)[0]
    return 1.0 - float(np.mean(rest**2) / np.mean(left[rows] ** 2))


def test_withheld_it_is_named_written_and_identified_from_what_was_written(logs, urdf_dir, tmp_path):
    """From the machine that does not list it to a twin that holds it, with no hand on the files."""
    truth, (log, unseen) = logs
    found = pt.diagnose(light(urdf_dir), log, validate=unseen, quick=True, closed_loop=False)
    assert [(e.effect, e.axis) for e in found.effects] == [("hysteresis", "Y")]
    assert found.effects[0].shrink["u"].share > 0.8
    assert found.effects[0].theta["k"] == pytest.approx(DRAG, rel=0.15)
    again = Machine.load(found.apply(tmp_path))
    assert [e.name for e in again.axis("Y").effects] == ["viscous", "coulomb", "hysteresis"]
    twin = pt.identify(again, log, loop=False)
    assert twin.parameter("Y.hysteresis.k").value == pytest.approx(DRAG, rel=0.05)
    assert twin.parameter("Y.hysteresis.x_h").value == pytest.approx(truth.drag_distance, rel=0.15)
