"""The twin knows what it leaves of its own logs, and still does after it was saved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import pinotwin as pt
from pinotwin.cli.identify import summary
from pinotwin.diagnosis.conclusion.verdict import judge
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.diagnosis.result import Gap
from pinotwin.identification.misfit import correlation_time, own_residual
from pinotwin.simulation.command import request
from pinotwin.simulation.run import beyond
from pinotwin.solve.crossval import held_out
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.stacked import AxisRows, stack


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
    problem = stack([AxisRows(W, y, np.arange(n))], ["early", "late"])
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


def test_the_error_of_an_effort_is_that_of_its_coefficients(twin: pt.Twin) -> None:
    """Against the efforts of coefficients moved along each axis of their covariance, on some rows of the own logs."""
    assert twin.misfit is not None
    motion = twin.misfit.motion.cut(400, 900)
    size = np.sqrt(np.diag(twin.covariance))
    spread, axes = np.linalg.eigh(twin.covariance / np.outer(size, size))
    thetas = twin.theta + size * (axes * np.sqrt(np.maximum(spread, 0.0))).T
    moved = [replace(twin, theta=x).effort(motion) - twin.effort(motion) for x in thetas]
    said = twin.effort_error(motion)
    assert_allclose(np.sqrt(np.sum(np.square(moved), axis=0)), said, atol=1e-6 * said.max())


def test_places_that_a_twin_hardly_knows_are_not_judged(twin: pt.Twin) -> None:
    """A knot at the end of its travel that a few rows touched says anything of what lies about it."""
    virtual = VirtualMachine.load(pt.machines()["trunnion"])
    log = virtual.record(random_trajectory(virtual, 6.0, 3), seed=4).to_log()
    plain = compare(twin, [log], [])
    at = twin.keys.index("Y.position_table")
    covariance, table = twin.covariance.copy(), twin.slices[at]
    q = plain.new.motion.q[plain.new.samples(0), 0]
    knots = twin.effects[at].knots
    fastest = np.argmax(np.abs(plain.new.motion.v[plain.new.samples(0), 0]))
    unsure = int(np.argmin(np.abs(knots - q[fastest])))
    covariance[table.start + unsure, table.start + unsure] += 1e4
    c = compare(replace(twin, covariance=covariance), [log], [])
    near = np.abs(q - knots[unsure]) < 0.5 * 0.001
    assert near.any()
    left = c.new.motion.q[c.new.samples(0), 0]
    assert not (np.abs(left - knots[unsure]) < 0.5 * 0.001).any()
    assert len(left) > len(q) - 4 * near.sum() - 10
    assert len(c.new.samples(1)) == len(plain.new.samples(1))


@pytest.mark.parametrize("path", [4, 6])
def test_a_twin_of_one_short_log_accuses_no_healthy_motion_that_it_hardly_knows(
    twin: pt.Twin, path: int
) -> None:
    """On path 4 an axis goes where no knot was told and another stands still; on 6 a table is told by a few rows."""
    virtual = VirtualMachine.load(pt.machines()["trunnion"])
    log = virtual.record(random_trajectory(virtual, 6.0, path), seed=path).to_log()
    found = pt.diagnose(twin, log)
    assert (found.verdict, found.effects) == ("none", [])
    assert any("outside the twin" in w for w in found.warnings)


def test_the_sentence_speaks_of_the_axis_that_is_open_and_not_of_the_noisiest(twin: pt.Twin) -> None:
    virtual = VirtualMachine.load(pt.machines()["trunnion"])
    log = virtual.record(random_trajectory(virtual, 4.0, 3), seed=3).to_log()
    c = replace(compare(twin, [log], []), change=False)
    sizes = {c.machine.names[j]: c.new.size(j) for j in c.new.joints}
    noisy = Gap(rms=0.5 * sizes["Y"], nrmse=0.5, noise=0.5 * sizes["Y"], after=0.5 * sizes["Y"])
    open_one = Gap(rms=0.2 * sizes["A"], nrmse=0.2, noise=0.0, after=0.2 * sizes["A"])
    sentence, unexplained, _ = judge(c, {}, {"Y": {"u": noisy}, "A": {"u": open_one}}, [])
    assert list(unexplained) == ["A"]
    assert sentence.startswith("No known effect explains the residual of A (20.0% of its effort)")


def test_an_axis_that_goes_only_where_its_twin_has_never_been_is_not_judged(twin: pt.Twin) -> None:
    virtual = VirtualMachine.load(pt.machines()["trunnion"])
    log = virtual.record(random_trajectory(virtual, 4.0, 9), seed=9).to_log()
    beyond = {k: x + 0.4 for k, x in log.channels.items() if k in ("Y.q", "Y.qr")}  # every knot of its table
    c = compare(twin, [log.with_channels({**log.channels, **beyond})], [])
    assert [c.machine.names[j] for j in c.new.joints] == ["A", "C"]
    assert "outside the twin" in c.gate.unknown["Y"]
    assert [w for w in c.gate.warnings if w.startswith("Y: not judged, it moves outside the twin")]


def test_correlation_time_of_a_known_process() -> None:
    rng = np.random.default_rng(0)
    phi, n = 0.95, 40_000
    noise = rng.normal(size=n)
    x = np.zeros(n)
    for k in range(1, n):
        x[k] = phi * x[k - 1] + noise[k]
    expected = 0.001 * (0.5 + phi / (1.0 - phi))
    assert correlation_time(x, [slice(0, n)], 0.001) == pytest.approx(expected, rel=0.25)


def test_a_command_beyond_the_travel_is_said_with_the_error_to_expect(twin: pt.Twin) -> None:
    """Inside the travel nothing is said; outside it may be as far off as the last value is from those of the travel."""
    assert twin.misfit is not None
    own = twin.misfit.motion
    t = np.arange(0.0, 4.0, 0.002)
    table, theta = next((e, x) for e, x in twin.pairs if e.name == "position_table" and e.axis == "Y")
    along = table.columns(own).effort(theta, twin.machine.nv)[:, 0]
    held = along[np.argmax(own.q[:, 0])]
    size = np.sqrt(np.mean((along - held) ** 2))
    low, high = own.q[:, 0].min(), own.q[:, 0].max()

    def notes(first: float, last: float) -> tuple[str, ...]:
        middle = np.median(own.q, axis=0)[None] * np.ones((len(t), 1))
        middle[:, 0] = first + 0.5 * (last - first) * (1.0 - np.cos(t))
        log = pt.Log({"t": t, **{f"{a}.qr": x for a, x in zip(own.names, middle.T, strict=True)}})
        return beyond(twin, request(twin.machine, log))

    dense = np.quantile(own.q[:, 0], [0.4, 0.6])
    assert not any("Y at" in x for x in notes(*dense))
    (said,) = notes(0.5 * (low + high), high + 0.06)
    assert said.startswith("the command leaves what the twin knows: Y at ")
    error = float(said.split("effort error of ")[1].split(" N")[0])
    own_size = twin.misfit.summary["Y"]["moving"]
    assert 0.8 * size < error < 1.3 * np.hypot(size, own_size)
