"""External effort over time, on an independent virtual machine with a known push."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.analysis.force import ExternalEffort, force, link_force
from pinotwin.cli.main import main
from pinotwin.dynamics.frames import jacobian
from pinotwin.logs.write import write_log
from pinotwin.virtual import VirtualMachine, random_trajectory

PUSH, START, END = 60.0, 2.0, 3.5


@pytest.fixture(scope="module")
def pushed() -> tuple[pt.Twin, pt.Log, pt.Log]:
    virtual = VirtualMachine.load(pt.machines()["trunnion"])
    own, other = (virtual.record(random_trajectory(virtual, 6.0, k), seed=k).to_log() for k in (3, 4))
    twin = pt.identify(pt.Machine.load("trunnion"), own, loop=False)
    inside = (other.t > START) & (other.t < END)
    u = other["Y.u"] - PUSH * inside  # the motor need not bring up what is pushed
    return twin, other, other.with_channels({**other.channels, "Y.u": u})


def test_a_push_is_seen_with_size_and_time(pushed: tuple[pt.Twin, pt.Log, pt.Log]) -> None:
    found = force(pushed[0], pushed[2])
    f = found.force[:, found.names.index("Y")]
    inside = (found.t > START + 0.1) & (found.t < END - 0.1)
    assert np.mean(f[inside]) == pytest.approx(PUSH, abs=0.2 * PUSH)
    assert abs(np.mean(f[found.t < START - 0.1])) < 0.2 * PUSH


def test_the_interval_holds_zero_where_nothing_pushes(pushed: tuple[pt.Twin, pt.Log, pt.Log]) -> None:
    found = force(pushed[0], pushed[1])
    assert found.beyond()[found.names.index("Y")] < 0.3
    assert 0.03 < found.beyond()[found.names.index("C")] < 0.3  # 90 % intervals that are not merely wide


def test_the_command_writes_every_axis(pushed: tuple[pt.Twin, pt.Log, pt.Log], tmp_path: Path) -> None:
    twin = pushed[0].save(tmp_path / "twin")
    write_log(tmp_path / "log.csv", dict(pushed[2].channels))
    assert main(["force", str(twin), str(tmp_path / "log.csv"), "--out", str(tmp_path / "f.csv")]) == 0
    assert {"Y.f", "Y.f_low", "Y.f_high", "C.f"} <= set(pt.read(tmp_path / "f.csv").channels)


def known_efforts(machine: pt.Machine, link: str, F: np.ndarray, n: int = 60) -> ExternalEffort:
    """Return the joint efforts of a force in a link's axes, at random postures."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-0.8, 0.8, (n, machine.nv))
    J = jacobian(machine.model, link, q)[:, :3]
    names = tuple(machine.axes)
    columns = [machine.axis(name).index for name in names]
    effort = np.einsum("nkj,k->nj", J, F)[:, columns]
    half = np.full(effort.shape, 0.5)
    return ExternalEffort(np.arange(n) / 100.0, names, effort, half, q)


def test_a_force_on_a_link_follows_from_the_efforts_of_six_axes() -> None:
    robot = pt.Machine.load("tx40")
    link = robot.model.frames[-1].name
    truth = np.array([12.0, -7.0, 30.0])
    found = link_force(robot, known_efforts(robot, link, truth), link)
    felt = np.isfinite(found.force).all(axis=1)
    assert felt.mean() > 0.5
    assert found.force[felt] == pytest.approx(np.tile(truth, (felt.sum(), 1)), rel=1e-6)
    assert np.all(found.half[felt] > 0.0)


def test_one_slide_feels_one_direction_and_says_nothing_of_the_others() -> None:
    slide = pt.Machine.load("emps")
    link = slide.model.frames[-1].name
    found = link_force(slide, known_efforts(slide, link, np.array([5.0, 6.0, 7.0])), link)
    assert found.felt().tolist() == [1.0, 0.0, 0.0]
    assert found.force[:, 0] == pytest.approx(5.0)
    assert found.half[:, 0] == pytest.approx(0.5)


def test_the_command_writes_the_force_on_a_link(
    pushed: tuple[pt.Twin, pt.Log, pt.Log], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    twin = pushed[0].save(tmp_path / "twin")
    write_log(tmp_path / "log.csv", dict(pushed[2].channels))
    out = ["--out", str(tmp_path / "f.csv"), "--link", "Y_link"]
    assert main(["force", str(twin), str(tmp_path / "log.csv"), *out]) == 0
    assert "Y_link.f" in capsys.readouterr().out
    assert {"Y_link.fx", "Y_link.fy_low", "Y_link.fz_high"} <= set(pt.read(tmp_path / "f.csv").channels)
