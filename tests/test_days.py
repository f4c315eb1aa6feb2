"""One misfit, what friction differs by from log to log, and a twin that learns from more healthy logs."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

import pinotwin as pt
from pinotwin.cli.identify import summary
from pinotwin.virtual import VirtualMachine, random_trajectory


def recorded(seeds: Sequence[int], seconds: float = 5.0) -> list[pt.Log]:
    """Return one log of the virtual trunnion for each seed."""
    virtual = VirtualMachine.load(pt.machines()["trunnion"])
    return [virtual.record(random_trajectory(virtual, seconds, k), seed=k).to_log() for k in seeds]


@pytest.fixture(scope="module")
def logs() -> list[pt.Log]:
    return recorded((3, 4, 5, 6))


@pytest.fixture(scope="module")
def twin(logs: list[pt.Log]) -> pt.Twin:
    return pt.identify(pt.Machine.load("trunnion"), logs[:3], loop=False)


def test_identify_and_diagnose_state_one_validation_error(twin: pt.Twin, logs: list[pt.Log]) -> None:
    stated = {name: row["moving"] for name, row in twin.to_dict()["misfit"].items()}
    found = pt.diagnose(twin, logs[3]).to_dict()["gap"]
    assert found
    for axis, row in found.items():
        assert row["u"]["misfit"] == pytest.approx(stated[axis], rel=1e-12)
        assert row["u"]["unsure"] >= 0.0
        assert any(line.startswith(axis) and f"{stated[axis]:.3g}" in line for line in summary(twin))
