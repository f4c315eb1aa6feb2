"""One misfit, what friction differs by from log to log, and a twin that learns from more healthy logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.cli.identify import summary
from pinotwin.cli.main import main
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.diagnosis.data.scatter import by_days
from pinotwin.diagnosis.rules import RULES
from pinotwin.effects import EFFECTS
from pinotwin.identification.days import widths
from pinotwin.report import identification_report
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.rig import good_log, write_log, write_machine


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


def plain(machine: str = "trunnion") -> pt.Machine:
    """Return a machine without shapes to search."""
    out = pt.Machine.load(machine)
    for name in out.axes:
        out = out.with_effects(name, [EFFECTS[k].on(out, name) for k in ("viscous", "coulomb", "offset")])
    return out


@pytest.mark.parametrize(("consistent", "most"), [(False, 1e-6), (True, 0.5)])
def test_an_updated_twin_is_the_one_of_all_logs(
    consistent: bool, most: float, logs: list[pt.Log], tmp_path: Path
) -> None:
    """In steps, over the disk, from one log to four; how much the URDF weighs hangs on rows that are gone."""
    how = {"loop": False, "cutoff": 20.0, "decimate": 4, "consistent": consistent}
    whole = pt.identify(plain(), logs, **how)
    first = pt.identify(plain(), logs[:1], **how)
    twin = first
    for step in (logs[1:2], logs[2:]):
        twin = pt.update(pt.Twin.load(twin.save(tmp_path)), step)
    error = np.sqrt(np.diag(whole.covariance))
    seen = error > 0.0
    off = np.abs(twin.theta - whole.theta)[seen] / error[seen]
    assert off.max() < most
    assert np.median(off) < 0.05 * np.median(np.abs(first.theta - whole.theta)[seen] / error[seen])
    wider = np.log(np.sqrt(np.diag(twin.covariance))[seen] / error[seen])
    assert np.abs(wider).max() < np.log(2.5)
    assert abs(np.median(wider)) < 0.1
    assert twin.quality["folds"] == whole.quality["folds"] == 4
    for name, row in whole.quality["axes"].items():
        now = twin.quality["axes"][name]
        assert now["rows"] == row["rows"]
        for key in ("fit", "fit_std", "rms"):
            assert now[key] == pytest.approx(row[key], rel=0.01)
        assert now["held_out"] == pytest.approx(row["held_out"], rel=0.05)
        assert twin.misfit is not None
        assert whole.misfit is not None
        sizes = (x.misfit.summary[name]["moving"] for x in (twin, whole))
        assert next(sizes) == pytest.approx(next(sizes), rel=0.05)
        assert twin.quality["days"][name] == pytest.approx(whole.quality["days"][name], rel=0.1)
    assert [row["fingerprint"] for row in twin.data] == [row["fingerprint"] for row in whole.data]
    assert pt.update(twin, logs[2]) is twin


def test_of_many_logs_the_oldest_are_kept_as_one(logs: list[pt.Log]) -> None:
    first = pt.identify(plain(), logs[:1], loop=False, cutoff=20.0, decimate=4)
    apart = pt.update(first, logs[1:])
    assert apart.moments is not None
    short = apart.moments.shorter(2)
    assert len(short.logs) == 2
    assert short.sums.sum(axis=0) == pytest.approx(apart.moments.sums.sum(axis=0))
    for F, G in zip(short.whole.factors, apart.moments.whole.factors, strict=True):
        assert pytest.approx(G.T @ G, rel=1e-9, abs=1e-9) == F.T @ F


def test_the_command_adds_once_and_refuses_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_machine(tmp_path / "rig")
    log, twin = good_log(), str(tmp_path / "twin")
    a = str(write_log(tmp_path / "a.csv", log))
    b = str(write_log(tmp_path / "b.csv", {**log, "X.u": 1.02 * log["X.u"]}))
    slow = str(write_log(tmp_path / "slow.csv", {k: x[::4] for k, x in log.items()}))
    other = str(write_log(tmp_path / "other.csv", {k.replace("X.", "Z."): x for k, x in log.items()}))
    assert main(["identify", str(tmp_path / "rig"), a, "--no-loop", "--out", twin]) == 0
    before = (tmp_path / "twin" / "twin.json").read_bytes()
    assert main(["update", twin, a]) == 0
    assert "holds these logs already" in capsys.readouterr().out
    turned = str(
        write_log(tmp_path / "turned.csv", {k: -x if k.endswith(".u") else x for k, x in log.items()})
    )
    for bad, word in ((slow, "125 Hz"), (other, "X.q"), (turned, "explains nothing of any effort")):
        assert main(["update", twin, bad]) == 2
        said = capsys.readouterr().err.strip()
        assert word in said
        assert len(said.splitlines()) == 1
    assert (tmp_path / "twin" / "twin.json").read_bytes() == before
    assert main(["update", twin, b, a]) == 0
    assert "1 log(s) added, 2 in all" in capsys.readouterr().out
    held = pt.Twin.load(twin)
    assert held.moments is not None
    assert len(held.data) == len(held.moments.logs) == 2
    with pytest.raises(pt.TwinError, match="keeps no moments of its logs; identify it again on all logs"):
        pt.update(replace(held, moments=None), slow)
