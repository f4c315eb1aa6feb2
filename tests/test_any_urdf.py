"""Any URDF: the robots of example-robot-data as they are, and random ones identified from a log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.random import Generator
from scipy.spatial.transform import Rotation

import pinotwin as pt
from pinotwin.dynamics.parameters import parameters
from pinotwin.errors import MachineError
from pinotwin.log import Log
from pinotwin.logs.check import check
from pinotwin.machine import Machine
from tests.rig import run

ROBOTS = Path(pin.__file__).parents[4] / "share/example-robot-data/robots"
URDFS = sorted(str(p.relative_to(ROBOTS)) for p in ROBOTS.rglob("*.urdf"))

# No machine as they are, and what is said of them.
REFUSED = {
    "hector_description/robots/quadrotor_base.urdf": "no joint of it can be an axis",
    "iris_description/robots/iris_simple.urdf": "no joint of it can be an axis",
    "romeo_description/urdf/romeo.urdf": "joint 'LHand' moves no inertia",
    "romeo_description/urdf/romeo_laas_small.urdf": "joint 'l_gripper_joint' moves no inertia",
    "ur_description/urdf/ur3.urdf": "no <link>",
}

# An arm, one with a gripper of prismatic fingers, one of continuous joints, a flying machine, an
# SCARA-like toy, a mobile robot with wheels and a lift.
SOME = [
    "ur_description/urdf/ur10_robot.urdf",
    "panda_description/urdf/panda.urdf",
    "kinova_description/robots/kinova.urdf",
    "iris_description/robots/iris.urdf",
    "double_pendulum_description/urdf/double_pendulum_continuous.urdf",
    "tiago_description/robots/tiago_no_hand.urdf",
]

needs_robots = pytest.mark.skipif(not URDFS, reason="example-robot-data is not installed")


@needs_robots
@pytest.mark.parametrize("name", URDFS)
def test_every_robot_loads_or_is_told_why_not(name: str) -> None:
    if name in REFUSED:
        with pytest.raises(MachineError) as caught:
            Machine.load(ROBOTS / name)
        message = str(caught.value)
        assert message.startswith(f"{ROBOTS / name}: ")
        assert REFUSED[name] in message
        assert "\n" not in message
        return
    machine = Machine.load(ROBOTS / name)
    assert machine.model.nq == machine.model.nv == len(machine.axes)
    assert all(machine.names)


def full_model(path: Path) -> pin.Model:
    """Return Pinocchio's own reading: continuous joints as (cos, sin), nothing locked."""
    return pin.buildModelFromUrdf(str(path))


def configuration(machine: Machine, full: pin.Model, x: np.ndarray) -> np.ndarray:
    """Return the full configuration with the machine's joints at ``x`` and all others at rest."""
    step = np.zeros(full.nv)
    step[_columns(machine, full)] = x
    return pin.integrate(full, pin.neutral(full), step)


def _columns(machine: Machine, full: pin.Model) -> list[int]:
    return [full.idx_vs[full.getJointId(machine.model.names[j])] for j in range(1, machine.nv + 1)]


@needs_robots
@pytest.mark.parametrize("name", SOME)
def test_efforts_are_those_of_the_whole_robot(name: str) -> None:
    machine = Machine.load(ROBOTS / name)
    full = full_model(ROBOTS / name)
    columns = _columns(machine, full)
    data, own = full.createData(), machine.model.createData()
    rng = np.random.default_rng(1)
    for _ in range(5):
        q, v, a = rng.uniform(-1, 1, (3, machine.nv))
        big_v, big_a = np.zeros(full.nv), np.zeros(full.nv)
        big_v[columns], big_a[columns] = v, a
        expected = pin.rnea(full, data, configuration(machine, full, q), big_v, big_a)[columns]
        found = pin.rnea(machine.model, own, q, v, a)
        np.testing.assert_allclose(found, expected, atol=1e-9 * max(1.0, np.abs(expected).max()))


@needs_robots
@pytest.mark.parametrize("name", [name for name in SOME if "tiago" not in name])
def test_base_parameters_give_the_efforts(name: str) -> None:
    machine = Machine.load(ROBOTS / name)
    rng = np.random.default_rng(2)
    q, v, a = rng.uniform(-1, 1, (3, 20, machine.nv))
    data = machine.model.createData()
    expected = np.array([pin.rnea(machine.model, data, *row) for row in zip(q, v, a, strict=True)])
    w = machine.base.regressor(machine.model, q, v, a)
    found = w @ machine.base.from_standard(parameters(machine.model))
    np.testing.assert_allclose(found, expected, atol=1e-9 * max(1.0, np.abs(expected).max()))
    assert check(machine).ok


@needs_robots
@pytest.mark.parametrize(
    "name", ["ur_description/urdf/ur10_robot.urdf", "so_arm_description/urdf/so100.urdf"]
)
def test_view_finds_the_meshes_of_packages_even_from_a_saved_copy(name: str, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert run("view", ROBOTS / name, "--html", page) == 0
    size = page.stat().st_size
    assert size > 700_000  # the meshes are in it, compressed; without them 0.4 MB
    Machine.load(ROBOTS / name).save(tmp_path / "copy")
    assert run("view", tmp_path / "copy", "--html", page) == 0
    assert page.stat().st_size == pytest.approx(size, rel=0.02)


@needs_robots
def test_a_finger_that_follows_is_held_and_said(capfd: pytest.CaptureFixture[str]) -> None:
    panda = ROBOTS / "panda_description/urdf/panda.urdf"
    assert run("check", panda) == 0
    said = capfd.readouterr().out
    assert "8 axes" in said
    assert "panda_finger_joint2: follows 'panda_finger_joint1' in the URDF (mimic)" in said


@needs_robots
def test_the_impossible_links_of_a_robot_are_named() -> None:
    robot = Machine.load(ROBOTS / "romeo_description/urdf/romeo_small.urdf")
    said = {f.channel: f for f in check(robot).findings if f.code == "body_impossible"}["RShoulderYaw"]
    assert said.severity == "warning"
    assert "correct the <inertial>" in said.message


@needs_robots
def test_a_link_that_is_impossible_alone_may_be_part_of_a_possible_body() -> None:
    # The fingertips' own inertias break the triangle inequality; with what is fixed to them, not.
    robot = Machine.load(ROBOTS / "allegro_hand_description/urdf/allegro_left_hand.urdf")
    assert not [f for f in check(robot).findings if f.code in ("body_impossible", "body_oversized")]


# Random robots


def random_urdf(rng: Generator, types: list[str]) -> str:
    """Return a serial robot with links of random point masses, hence of possible inertia."""
    parts = ['<robot name="random"><link name="link0"/>']
    for k, kind in enumerate(types, start=1):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        points, weights = rng.uniform(-0.3, 0.3, (6, 3)), rng.uniform(0.2, 1.0, 6)
        centre = weights @ points / weights.sum()
        arms = points - centre
        inertia = sum(w * (r @ r * np.eye(3) - np.outer(r, r)) for w, r in zip(weights, arms, strict=True))
        angles = Rotation.random(random_state=int(rng.integers(1 << 30))).as_euler("xyz")
        limit = "" if kind == "continuous" else '<limit lower="-3" upper="3" effort="99" velocity="9"/>'
        parts.append(
            f'<link name="link{k}"><inertial><origin xyz="{_words(centre)}"/>'
            f'<mass value="{float(weights.sum())!r}"/><inertia ixx="{inertia[0, 0]!r}" '
            f'ixy="{inertia[0, 1]!r}" ixz="{inertia[0, 2]!r}" iyy="{inertia[1, 1]!r}" '
            f'iyz="{inertia[1, 2]!r}" izz="{inertia[2, 2]!r}"/></inertial></link>'
            f'<joint name="j{k}" type="{kind}"><parent link="link{k - 1}"/><child link="link{k}"/>'
            f'<origin xyz="{_words(rng.uniform(-0.4, 0.4, 3))}" rpy="{_words(angles)}"/>'
            f'<axis xyz="{_words(direction)}"/>{limit}</joint>'
        )
    return "".join(parts).replace("np.float64(", "").replace(')"', '"') + "</robot>"


def _words(values: np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in values)


def wrong_masses(urdf: str, factor: float) -> str:
    """Return what CAD believes: every mass and inertia too large by one factor."""
    words = urdf.split('"')
    for i, word in enumerate(words[:-1]):
        if word.endswith(("value=", "ixx=", "ixy=", "ixz=", "iyy=", "iyz=", "izz=")):
            words[i + 1] = repr(factor * float(words[i + 1]))
    return '"'.join(words)


def simulated_log(urdf: Path, rng: Generator) -> Log:
    """Return a log of the true robot: Pinocchio's own inverse dynamics, friction, a little noise."""
    model = full_model(urdf)
    data, t = model.createData(), np.arange(8000) / 1000.0
    q, v, a = (np.zeros((len(t), model.nv)) for _ in range(3))
    for j in range(model.nv):
        for f in rng.uniform(0.2, 2.5, 6):
            w, phase, size = 2 * np.pi * f, rng.uniform(0, 2 * np.pi), 0.3 / (1 + f)
            q[:, j] += size * np.sin(w * t + phase)
            v[:, j] += size * w * np.cos(w * t + phase)
            a[:, j] -= size * w**2 * np.sin(w * t + phase)
    neutral = pin.neutral(model)
    tau = np.array(
        [
            pin.rnea(model, data, pin.integrate(model, neutral, qk), vk, ak)
            for qk, vk, ak in zip(q, v, a, strict=True)
        ]
    )
    u = tau + 0.7 * v + 1.5 * np.sign(v) + rng.normal(scale=0.02, size=tau.shape)
    channels = {"t": t}
    for j in range(model.nv):
        name = model.names[j + 1]
        channels |= {f"{name}.q": q[:, j], f"{name}.u": u[:, j]}
    return Log(channels, "simulated")


@pytest.mark.parametrize(
    ("seed", "types"),
    [
        (1, ["revolute", "revolute", "revolute"]),
        (2, ["prismatic", "revolute", "continuous"]),
        (3, ["continuous", "prismatic", "revolute", "continuous"]),
        (4, ["prismatic", "prismatic", "prismatic"]),
        (5, ["continuous", "continuous"]),
        (6, ["revolute", "prismatic"]),
    ],
)
def test_a_random_robot_is_identified_from_its_log(seed: int, types: list[str], tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    truth = tmp_path / "truth.urdf"
    truth.write_text(random_urdf(rng, types))
    belief = tmp_path / "belief.urdf"
    belief.write_text(wrong_masses(truth.read_text(), 1.4))
    machine, true = Machine.load(belief), Machine.load(truth)
    assert [axis.rotary for axis in machine.axes.values()] == [kind != "prismatic" for kind in types]
    log = simulated_log(truth, rng)
    twin = pt.identify(machine, log, loop=False)

    # The same base parameters on both sides: P depends on the tree alone.
    beta = machine.base.from_standard(parameters(true.model))
    believed = machine.base.from_standard(parameters(machine.model))
    found = twin.coefficients("rigid_body")
    table = [twin.parameter(f"rigid_body.{label}") for label in machine.base.labels]
    known = np.array([row.determined for row in table])
    assert known.mean() > 0.9
    error = np.array([row.error for row in table])
    miss = np.abs(found - beta)[known]
    assert (miss < 5 * error[known] + 0.01 * np.abs(beta).max()).all()
    assert np.linalg.norm(miss) < 0.1 * np.linalg.norm((believed - beta)[known])
    for name in machine.axes:
        assert twin.parameter(f"{name}.viscous.b").value == pytest.approx(0.7, abs=0.05)
        assert twin.parameter(f"{name}.coulomb.c").value == pytest.approx(1.5, abs=0.05)

    # And the efforts themselves, at postures and speeds that the log does not hold.
    q, v, a = rng.uniform(-1, 1, (3, 50, machine.nv))
    for row in zip(q, v, a, strict=True):
        expected = pin.rnea(true.model, true.model.createData(), *row)
        predicted = pin.rnea(twin.model, twin.model.createData(), *row)
        np.testing.assert_allclose(predicted, expected, atol=0.03 * np.abs(expected).max() + 0.1)
