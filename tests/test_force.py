"""External effort over time, on an independent virtual machine with a known push."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.analysis.force import external_effort
from pinotwin.cli.main import main
from pinotwin.logs.write import write_log
from pinotwin.virtual import VirtualMachine, random_trajectory

PUSH, START, END = 60.0, 2.0, 3.5


@pytest.fixture(scope="module")
def pushed() -> tuple[pt.Twin, pt.Log, pt.Log]:
    virtual = VirtualMachine.load(pt.machines()["trunnion"])
    own, other = (virtual.record(random_trajectory(virtual, 8.0, k), seed=k).to_log() for k in (3, 4))
    twin = pt.identify(pt.Machine.load("trunnion"), own, loop=False)
    inside = (other.t > START) & (other.t < END)
    u = other["Y.u"] - PUSH * inside  # the motor need not bring up what is pushed
    return twin, other, other.with_channels({**other.channels, "Y.u": u})


def test_a_push_is_seen_with_size_and_time(pushed: tuple[pt.Twin, pt.Log, pt.Log]) -> None:
    found = external_effort(pushed[0], pushed[2])
    f = found.force[:, found.names.index("Y")]
    inside = (found.t > START + 0.1) & (found.t < END - 0.1)
    assert np.mean(f[inside]) == pytest.approx(PUSH, abs=0.2 * PUSH)
    assert abs(np.mean(f[found.t < START - 0.1])) < 0.2 * PUSH


def test_the_interval_holds_zero_where_nothing_pushes(pushed: tuple[pt.Twin, pt.Log, pt.Log]) -> None:
    found = external_effort(pushed[0], pushed[1])
    assert found.beyond()[found.names.index("Y")] < 0.3


def test_the_command_writes_every_axis(pushed: tuple[pt.Twin, pt.Log, pt.Log], tmp_path: Path) -> None:
    twin = pushed[0].save(tmp_path / "twin")
    write_log(tmp_path / "log.csv", dict(pushed[2].channels))
    assert main(["force", str(twin), str(tmp_path / "log.csv"), "--out", str(tmp_path / "f.csv")]) == 0
    assert {"Y.f", "Y.f_low", "Y.f_high", "C.f"} <= set(pt.read(tmp_path / "f.csv").channels)
