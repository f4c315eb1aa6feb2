"""The twin knows what it leaves of its own logs, and still does after it was saved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.cli.identify import summary
from pinotwin.identification.misfit import correlation_time, own_residual
from pinotwin.solve.crossval import held_out
from pinotwin.solve.problem import AxisRows, Problem
from pinotwin.virtual import VirtualMachine, random_trajectory


@pytest.fixture(scope="module")
def twin() -> pt.Twin:
    virtual = VirtualMachine.load(pt.machines()["trunnion"])
    log = virtual.record(random_trajectory(virtual, 6.0, 3), seed=3).to_log()
    return pt.identify(pt.Machine.load("trunnion"), log, loop=False)


def test_the_residual_of_the_own_logs_survives_the_disk(twin: pt.Twin, tmp_path: Path) -> None:
    before = own_residual(twin)
    after = own_residual(pt.Twin.load(twin.save(tmp_path)))
    assert np.nanmax(np.abs(after - before)) < 1e-3 * np.nanstd(before)


def test_the_summary_is_the_size_of_that_residual(twin: pt.Twin) -> None:
    assert twin.misfit is not None
    motion, residual = twin.misfit.motion, own_residual(twin)
    rows = motion.use[:, 0].copy()
    inside = np.zeros(len(motion), dtype=bool)
    for s in motion.segments:
        inside[s] = True
    measured = np.sqrt(np.mean(residual[rows & inside, 0] ** 2))
    axis = twin.misfit.summary[motion.names[0]]
    assert axis["moving"] == pytest.approx(measured, rel=1e-9)
    assert sum(axis["spectrum"]["share"]) == pytest.approx(1.0)


def test_identify_prints_rows_in_motion_and_at_rest_apart(twin: pt.Twin) -> None:
    lines = summary(twin)
    assert lines[1].split() == ["axis", "fit", "held", "out", "of", "std", "in", "motion", "at", "rest"]
    assert twin.misfit is not None
    for line, (name, own) in zip(lines[2:], twin.misfit.summary.items(), strict=False):
        assert line.startswith(name)
        assert f"{own['moving']:.3g} {own['unit']}" in line
        assert line.endswith(f"{own['resting']:.3g} {own['unit']}" if own["resting"] is not None else "-")
    assert max(len(line) for line in lines if not line.startswith("note: ")) <= 80


def test_a_place_that_one_part_alone_visits_is_no_misfit() -> None:
    """Of two knots one is seen all along, the other in the last fifth only: nothing foretells what stands there."""
    n = 500
    late = np.arange(n) >= 400
    W = np.stack([~late, late], axis=1).astype(float)
    y = W @ [1.0, 30.0] + 0.1 * np.random.default_rng(1).normal(size=n)
    problem = Problem.stack([AxisRows(W, y, np.arange(n))], ["early", "late"])
    held = held_out(problem)
    unsure = held.unsure(problem)
    assert unsure[~late].max() < 0.02
    assert unsure[late].min() > 100.0
    assert np.abs(held.error[late]).min() > 20.0


def test_the_misfit_of_a_table_is_that_of_the_places_that_are_foretold(twin: pt.Twin) -> None:
    assert twin.misfit is not None
    motion, residual = twin.misfit.motion, np.abs(np.nan_to_num(own_residual(twin)))
    left = motion.inside & ~motion.use[:, 0]
    assert left.any()
    assert residual[left, 0].max() > 3.0 * residual[motion.inside & motion.use[:, 0], 0].std()
    assert twin.misfit.summary["Y"]["resting"] is None


def test_correlation_time_of_a_known_process() -> None:
    rng = np.random.default_rng(0)
    phi, n = 0.95, 40_000
    noise = rng.normal(size=n)
    x = np.zeros(n)
    for k in range(1, n):
        x[k] = phi * x[k - 1] + noise[k]
    expected = 0.001 * (0.5 + phi / (1.0 - phi))
    assert correlation_time(x, [slice(0, n)], 0.001) == pytest.approx(expected, rel=0.25)
