"""One misfit, what friction differs by from log to log, and a twin that learns from more healthy logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.cli.identify import summary
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.diagnosis.data.scatter import by_days
from pinotwin.diagnosis.rules import RULES
from pinotwin.identification.days import widths
from pinotwin.report import identification_report
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


def test_of_three_logs_each_is_predicted_from_the_others(twin: pt.Twin) -> None:
    assert twin.quality["folds"] == 3
    assert twin.misfit is not None
    assert len(twin.misfit.theta) == 3
    edges = np.flatnonzero(np.diff(twin.misfit.motion.t) < 0.0) + 1
    assert np.flatnonzero(np.diff(twin.misfit.fold)).tolist() == pytest.approx(edges - 1, abs=60)


@pytest.mark.parametrize("drawn", [0.02, 0.08])
def test_the_scatter_of_friction_is_that_of_the_logs_and_of_few_logs_the_prior(drawn: float) -> None:
    """On a slide with exactly these courses: forty logs tell their own width, one log tells the prior."""
    rng = np.random.default_rng(5)
    v = np.sin(np.linspace(0.0, 40.0, 400))
    U = np.stack([8.0 * np.sign(v), 20.0 * v], axis=1)
    logs = [(U, U @ (drawn * rng.normal(size=2)) + 0.05 * rng.normal(size=400)) for _ in range(40)]
    assert widths(logs, prior=0.05, count=2.0) == pytest.approx(drawn, rel=0.3)
    assert widths(logs[:1], prior=0.05, count=2.0) == pytest.approx(0.05)
    hardly = [(1e-4 * U, 0.05 * rng.normal(size=400)) for _ in range(40)]
    assert widths(hardly, prior=0.05, count=2.0) == pytest.approx(0.05, rel=0.05)


def test_a_diagnosis_allows_for_the_scatter_that_its_twin_has_seen(
    twin: pt.Twin, logs: list[pt.Log], tmp_path: Path
) -> None:
    kept = pt.Twin.load(twin.save(tmp_path)).quality["days"]
    assert kept == twin.quality["days"]
    assert {"viscous", "presliding"} <= set(kept["Y"])
    assert all(0.0 < x < 0.2 for row in kept.values() for x in row.values())
    page = identification_report(twin, logs[:3])
    assert "Friction from log to log" in page
    j = twin.machine.axes["Y"].index
    for widths_of_y, allowed in (({"presliding": 0.2}, 0.2), ({"presliding": 0.01}, RULES.scatter)):
        days = {**kept, "Y": widths_of_y}
        c = compare(replace(twin, quality={**twin.quality, "days": days}), logs[3:], [])
        assert by_days(c, j, RULES) == allowed
        assert by_days(replace(c, change=False), j, RULES) == RULES.scatter
