"""A faulty log beside a healthy run of the same command: the two are told apart and not pooled."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.virtual import VirtualMachine, random_trajectory


def run(urdf_dir, seed, *inject, path=8):
    virtual = VirtualMachine.load(urdf_dir / "emps", inject=inject)
    log = virtual.record(random_trajectory(virtual, 8.0, path), seed=seed).to_log()
    return dataclasses.replace(log, source=f"{'faulty' if inject else 'healthy'}_{seed}.csv")


@pytest.fixture(scope="module")
def machine():
    return dataclasses.replace(Machine.load("emps"), columns={})


@pytest.fixture(scope="module")
def twin(machine, urdf_dir):
    return identify(machine, [run(urdf_dir, 1, path=7), run(urdf_dir, 2, path=7)], loop=False)


@pytest.fixture(scope="module")
def found(twin, urdf_dir):
    return diagnose(twin, [run(urdf_dir, 11), run(urdf_dir, 12, "viscous:X=0.3")], quick=True)


def test_the_answer_says_which_file_differs(found):
    assert found.differs == ["faulty_12.csv"]
    assert "faulty_12.csv" in found.sentence
    assert found.to_dict()["differs"] == ["faulty_12.csv"]


def test_the_fault_is_not_diluted_by_the_healthy_run(found, twin, urdf_dir):
    alone = diagnose(twin, run(urdf_dir, 12, "viscous:X=0.3"), quick=True)
    assert (found.effects[0].effect, found.effects[0].axis) == ("viscous", "X")
    assert found.effects[0].theta["b"] == pytest.approx(alone.effects[0].theta["b"], rel=1e-6)
    assert found.gap["X"]["u"].rms == pytest.approx(alone.gap["X"]["u"].rms, rel=1e-6)


def test_a_figure_names_the_log_that_it_shows(found):
    assert {t.log for t in found.traces} == {1}


def test_the_order_of_the_files_does_not_matter(twin, urdf_dir):
    again = diagnose(twin, [run(urdf_dir, 12, "viscous:X=0.3"), run(urdf_dir, 11)], quick=True)
    assert again.differs == ["faulty_12.csv"]


def test_runs_are_told_apart_where_no_law_of_a_controller_is_known(machine, urdf_dir):
    """The commands are logged, and the effort does not hang on them by any law."""

    def odd(log, more=0.0):
        v = np.gradient(log["X.q"], log.t)
        u = 40.0 * np.sign(v) * np.abs(np.sin(200.0 * log["X.q"])) + 5.0 * np.cos(37.0 * log.t) ** 3
        channels = {**log.channels, "X.u": u + more * v}
        return Log(channels, source=f"{'faulty' if more else 'healthy'}.csv")

    own = identify(machine, odd(run(urdf_dir, 1, path=7)), loop=False)
    found = diagnose(own, [odd(run(urdf_dir, 11)), odd(run(urdf_dir, 12), 2000.0)], quick=True)
    assert found.differs == ["faulty.csv"]


def test_healthy_repeats_and_faulty_repeats_are_pooled(twin, urdf_dir):
    assert compare(twin, [run(urdf_dir, 11), run(urdf_dir, 12)], []).apart is None
    broken = [run(urdf_dir, k, "viscous:X=0.3") for k in (11, 12)]
    assert compare(twin, broken, []).apart is None


def test_a_machine_is_fitted_to_the_runs_that_agree(machine, urdf_dir):
    logs = [run(urdf_dir, 11), run(urdf_dir, 12, "viscous:X=0.3"), run(urdf_dir, 13)]
    c = compare(machine, logs, [])
    assert c.apart is not None
    assert c.apart.names == ["faulty_12.csv"]
    assert c.kept == (0, 2)
    found = diagnose(machine, logs, quick=True)
    assert "identify a twin from healthy_11.csv, healthy_13.csv" in found.sentence


def test_a_run_that_begins_later_is_a_repeat(twin, urdf_dir):
    log = run(urdf_dir, 12)
    rows = {name: x[40:] for name, x in log.channels.items()}
    rows["t"] = rows["t"] - rows["t"][0]
    assert compare(twin, [run(urdf_dir, 11), Log(rows, source="late.csv")], []).apart is None


def test_two_runs_of_one_real_robot_are_repeats_and_a_fault_in_one_is_not(data_dir):
    folder = data_dir / "kuka_lwr4"
    one, two, three = (pt.read(folder / f"measurements_{k}.csv") for k in (1, 2, 3))
    robot = identify(Machine.load(folder), [three], loop=False)
    healthy = compare(robot, [one, two], [])
    assert healthy.apart is None
    assert healthy.own is not None
    moved = robot.motion(two)
    name = robot.machine.names[3]
    level = 2.5 * healthy.own.level(3)
    more = np.interp(two.t - two.t[0], moved.t - moved.t[0], np.sign(moved.v[:, 3])) * level
    odd = Log({**two.channels, f"{name}.u": two[f"{name}.u"] + more}, source="two.csv")
    c = compare(robot, [one, odd], [])
    assert c.apart is not None
    assert c.apart.names == ["two.csv"]
