"""Diagnosis on real logs: a healthy machine is accused of nothing, a known fault put into a log is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt


def twin_and_unseen(folder: Path, own: list[str], unseen: str) -> tuple[pt.Twin, pt.Log]:
    machine = pt.Machine.load(folder)
    return pt.identify(machine, [pt.read(folder / x) for x in own], loop=False), pt.read(folder / unseen)


@pytest.fixture(scope="module")
def lwr4(data_dir: Path) -> tuple[pt.Twin, pt.Log]:
    return twin_and_unseen(
        data_dir / "kuka_lwr4", ["measurements_2.csv", "measurements_3.csv"], "measurements_1.csv"
    )


@pytest.fixture(scope="module")
def healthy(lwr4: tuple[pt.Twin, pt.Log]):
    return pt.diagnose(*lwr4)


def test_an_unchanged_robot_is_accused_of_nothing(healthy) -> None:
    assert healthy.verdict == "none"
    assert healthy.effects == []


def test_the_stated_gap_is_that_of_the_twin(lwr4, healthy) -> None:
    twin, log = lwr4
    motion = twin.motion(log)
    residual = motion.u - twin.effort(motion)
    for name, axis in twin.machine.axes.items():
        expected = np.sqrt(np.mean(residual[motion.moving(axis.index), axis.index] ** 2))
        assert healthy.gap[name]["u"].rms == pytest.approx(expected, rel=1e-9)


def test_a_viscous_fault_put_into_the_log_is_named_with_its_size(lwr4) -> None:
    twin, log = lwr4
    motion = twin.motion(log)
    more = 3.0 * healthy_misfit(twin, "lwr_2") / np.std(motion.v[:, motion.index("lwr_2")])
    u = log["lwr_2.u"] + more * np.interp(log.t, motion.t, motion.v[:, motion.index("lwr_2")])
    found = pt.diagnose(twin, log.with_channels({**log.channels, "lwr_2.u": u}))
    assert (found.effects[0].effect, found.effects[0].axis) == ("viscous", "lwr_2")
    size = found.effects[0].size[0]
    # The robot's own friction differs from run to run by some of the misfit.
    assert size.after - size.before == pytest.approx(more, rel=0.2)
    assert found.effects[0].shrink["u"].share > 0.7
    assert found.verdict == "explained"


def healthy_misfit(twin: pt.Twin, axis: str) -> float:
    assert twin.misfit is not None
    return float(twin.misfit.summary[axis]["moving"])
