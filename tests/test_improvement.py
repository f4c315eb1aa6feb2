"""``improve``: what a machine lacks is found and added, and a sealed log says whether it helps."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

import pinotwin as pt
from pinotwin.cli.main import main
from pinotwin.identification.judge import signs_of_missing_effects
from pinotwin.logs.write import write_log
from pinotwin.studies.improvement import improve, ratio
from pinotwin.virtual import VirtualMachine, random_trajectory


@pytest.fixture(scope="module")
def logs():
    """A log to fit and a sealed one of the virtual EMPS drive."""
    drive = VirtualMachine.load(pt.machines()["emps"])
    return [
        drive.record(random_trajectory(drive, seconds, seed), seed=seed).to_log()
        for seconds, seed in ((12.0, 5), (8.0, 6))
    ]


@pytest.fixture(scope="module")
def bare():
    """The drive described without its dry friction and without its constant effort."""
    machine = pt.Machine.load("emps")
    return machine.with_effects("X", [e for e in machine.axes["X"].effects if e.name == "viscous"])


@pytest.fixture(scope="module")
def found(bare, logs):
    return improve(bare, logs[0], validate=logs[1])


def test_what_is_missing_is_added(found):
    listed = {e.name for e in found.twin.machine.axes["X"].effects}
    assert {"viscous", "coulomb", "offset"} <= listed
    assert any("dry friction" in text and " N" in text for text in found.steps[1].added)


def test_the_sealed_log_is_predicted_as_by_the_whole_description(found, logs):
    whole = pt.identify("emps", logs[0], validate=logs[1])
    sealed = whole.quality["axes"]["X"]["validation"]["nrmse"]
    assert found.steps[0].errors["X"]["u"] > 5.0 * sealed
    assert found.steps[-1].errors["X"]["u"] == pytest.approx(sealed, rel=0.05)
    assert found.steps[-1].errors["X"]["e"] <= found.steps[0].errors["X"]["e"]


def test_a_whole_description_is_left_alone(found, logs):
    again = improve(found.twin.machine, logs[0], validate=logs[1])
    assert len(again.steps) == 1
    assert again.end == "the diagnosis finds no further effect"


def test_a_step_that_does_not_help_is_not_kept(bare, logs, monkeypatch):
    errors = iter([{"X": {"u": 0.1}}, {"X": {"u": 0.2}}])
    monkeypatch.setattr("pinotwin.studies.improvement.sealed_errors", lambda *_: next(errors))
    stopped = improve(bare, logs[0], validate=logs[1])
    assert [step.kept for step in stopped.steps] == [True, False]
    assert {e.name for e in stopped.twin.machine.axes["X"].effects} == {"viscous"}


def test_what_no_machine_can_hold_is_not_said_to_be_added(bare, logs, monkeypatch):
    def with_a_disturbance(*given, **options):
        d = pt.diagnose(*given, **options)
        no_part = replace(d.effects[0], effect="external_force", listed=None) if d.effects else None
        return replace(d, effects=[*d.effects, no_part] if no_part else d.effects)

    monkeypatch.setattr("pinotwin.studies.improvement.diagnose", with_a_disturbance)
    found = improve(bare, logs[0], validate=logs[1])
    assert len(found.steps[1].added) == 2
    assert not any("disturbance" in text or "external" in text for text in found.steps[1].added)


def test_errors_of_several_axes_are_weighed_by_their_ratios():
    before = {"X": {"u": 0.1, "e": 0.2}, "Y": {"u": 0.4}}
    after = {"X": {"u": 0.05, "e": 0.4}, "Y": {"u": 0.2}}
    assert ratio(before, after) == pytest.approx(0.5 ** (1 / 3))


def test_the_command_writes_the_best_twin_and_a_table(bare, found, logs, tmp_path, capsys, monkeypatch):
    bare.save(tmp_path / "machine")
    for name, log in zip(("fit", "sealed"), logs, strict=True):
        write_log(tmp_path / f"{name}.csv", log.channels)
    monkeypatch.setattr("pinotwin.studies.improvement.improve", lambda *_, **__: found)
    words = ["improve", tmp_path / "machine", tmp_path / "fit.csv", "--validate", tmp_path / "sealed.csv"]
    assert main([*map(str, words), "--json", str(tmp_path / "a.json"), "--out", str(tmp_path / "twin")]) == 0
    said, content = capsys.readouterr().out, json.loads((tmp_path / "a.json").read_text())
    assert "step 1: dry friction on axis X" in said
    assert [step["kept"] for step in content["steps"]] == [True, True]
    assert {e.name for e in pt.Twin.load(tmp_path / "twin").machine.axes["X"].effects} >= {"coulomb"}


def test_without_a_sealed_log_the_command_says_what_to_give(tmp_path, capsys, logs):
    write_log(tmp_path / "fit.csv", logs[0].channels)
    assert main(["improve", "emps", str(tmp_path / "fit.csv"), "--out", str(tmp_path / "twin")]) == 2
    assert "--validate" in capsys.readouterr().err
    assert not (tmp_path / "twin").exists()


def test_identify_names_the_signs_of_a_missing_effect():
    quality = {
        "at_bound": ["X.presliding.m"],
        "loops": {"X": {"pole_pairs": 3}, "Y": {"pole_pairs": 2}},
        "servos": {"X": {"held_out": {"e": 0.33}}, "Y": {"held_out": {"e": 0.02}}},
    }
    signs = signs_of_missing_effects(quality)
    assert [sign.split(":")[0] for sign in signs] == ["X.presliding.m ended at its bound", "X", "X"]
