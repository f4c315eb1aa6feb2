"""Friction of a motor that turns several axes: two belts that move one head, X and Y together (CoreXY)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.log import Log

LINK = (
    '<link name="{}"><inertial><mass value="{}"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="prismatic"><parent link="{1}"/><child link="{0}_link"/><axis xyz="{2}"/>'
    '<limit lower="-1" upper="1" velocity="2" effort="99"/></joint>'
)
BELTS = np.array([[1.0, 1.0], [1.0, -1.0]])  # motors over axes
MASS, GAIN = np.array([5.0, 3.0]), 2e4


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> pt.Machine:
    folder = tmp_path_factory.mktemp("belts")
    links = [LINK.format(*x) for x in (("base", 1.0), ("X_link", MASS[0] - MASS[1]), ("Y_link", MASS[1]))]
    joints = [JOINT.format("X", "base", "1 0 0"), JOINT.format("Y", "X_link", "0 1 0")]
    (folder / "m.urdf").write_text(f'<robot name="m">{"".join(links + joints)}</robot>')
    axes = "name: m\nurdf: m.urdf\naxes: {X: {joint: X}, Y: {joint: Y}}\n"
    (folder / "machine.yaml").write_text(axes + "transmission: {X: {X: 1, Y: 1}, Y: {X: 1, Y: -1}}\n")
    (folder / "untold.yaml").write_text(axes)
    return pt.Machine.load(Path(folder))


def day(seed: int, motor: Mapping[int, float] | None = None, axis: Mapping[int, float] | None = None) -> Log:
    """A day of the head with more dry friction [N] on a motor or on an axis; the law of a motor is a stiff spring."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 16.0, 0.004)
    waves = [(rng.uniform(0.1, 1.2), rng.uniform(0.0, 6.0)) for _ in range(8)]
    q, v, a = (np.zeros((len(t), 2)) for _ in range(3))
    for k, (f, phase) in enumerate(waves):
        w, size = 2.0 * np.pi * f, 0.05 / f
        q[:, k % 2] += size * np.sin(w * t + phase)
        v[:, k % 2] += size * w * np.cos(w * t + phase)
        a[:, k % 2] -= size * w**2 * np.sin(w * t + phase)
    dry = np.array([3.0, 2.0]) + [dict(axis or {}).get(k, 0.0) for k in (0, 1)]
    turns = v @ BELTS.T
    u = (MASS * a + 8.0 * v + dry * np.tanh(v / 1e-3)) @ np.linalg.inv(BELTS)
    u += np.tanh(turns / 1e-3) * [dict(motor or {}).get(k, 0.0) for k in (0, 1)]
    measured = u + rng.normal(0.0, 0.05, u.shape)
    at = q @ BELTS.T
    channels = {"t": t}
    for k, name in enumerate("XY"):
        channels |= {
            f"{name}.q": at[:, k],
            f"{name}.qr": at[:, k] + u[:, k] / GAIN,
            f"{name}.u": measured[:, k],
        }
    return Log(channels, source=f"day {seed}")


@pytest.fixture(scope="module")
def twin(machine: pt.Machine) -> pt.Twin:
    return pt.identify(machine, [day(k) for k in range(3)])


@pytest.mark.parametrize(
    ("change", "axis", "number", "size"),
    [
        ({"motor": {0: 1.5}}, "X", "coulomb.at_the_motor", 1.5),
        ({"motor": {1: 1.0}}, "Y", "coulomb.at_the_motor", 1.0),
        ({"axis": {1: 2.0}}, "Y", "coulomb.c", 4.0),
    ],
)
def test_friction_of_a_motor_is_told_from_that_of_an_axis(
    twin: pt.Twin, change: Mapping[str, Mapping[int, float]], axis: str, number: str, size: float
) -> None:
    found = pt.diagnose(twin, [day(10 + k, **change) for k in range(2)])
    first = found.effects[0]
    assert (first.effect, first.axis, len(found.effects)) == ("coulomb", axis, 1)
    assert first.size[0].name == number
    assert first.size[0].after == pytest.approx(size, rel=0.1)


def test_of_another_healthy_day_nothing_is_said(twin: pt.Twin) -> None:
    assert pt.diagnose(twin, [day(20), day(21)]).verdict == "none"


@pytest.mark.parametrize("change", [1.0, 2.0])
def test_what_the_twin_lacks_on_its_own_days_is_no_change(machine: pt.Machine, change: float) -> None:
    """Its motors drag on every day, which the twin has no number for; one of them then drags more."""
    drag = {0: 0.8, 1: 0.6}
    twin = pt.identify(machine, [day(k, drag) for k in range(3)])
    more = {**drag, 0: drag[0] + change}
    (found,) = pt.diagnose(twin, [day(10 + k, more) for k in range(2)]).effects
    size = found.size[0]
    assert (found.axis, size.name) == ("X", "coulomb.at_the_motor")
    assert size.before > 0.2
    assert size.after - size.before == pytest.approx(change, rel=0.15)


@pytest.mark.parametrize("turns", [0.5, -1.5])
def test_of_a_motor_that_turns_another_joint_untold_no_cause_is_named(
    machine: pt.Machine, turns: float
) -> None:
    """The motor of X turns Y as well, which a second encoder shows: the effort of neither is that of its joint."""
    log = day(30)
    x, y = np.linalg.solve(BELTS, [log["X.q"], log["Y.q"]])
    told = {"X.ql": x, "X.q": x + turns * y, "X.qr": x + turns * y, "Y.q": y, "Y.qr": y}
    untold = pt.Machine.load(machine.path.with_name("untold.yaml"))
    found = pt.diagnose(untold, log.with_channels({**log.channels, **told}))
    assert (found.verdict, found.effects) == ("unexplained", [])
    said = "cannot be traced to a cause: X.ql does not go with X.q: its motor turns several joints; "
    said += f"write transmission: {{X: {{X: 1, Y: {turns}}}}}"
    assert all(found.remains[axis].startswith(said) for axis in "XY")
