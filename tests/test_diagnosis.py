"""Diagnosis against a virtual machine whose truth is known and shares no code with it."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.cli.main import main
from pinotwin.diagnosis import diagnose
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.logs.write import write_log
from pinotwin.machine import Machine
from pinotwin.virtual import VirtualMachine, random_trajectory

WITHHELD = ("coulomb_asymmetric", "drive_flexibility", "stribeck")


def record(urdf_dir, *inject, seconds=8.0, paths=(7, 8), repeats=2):
    machine = VirtualMachine.load(urdf_dir / "emps", withhold=WITHHELD, inject=inject)
    return [
        machine.record(random_trajectory(machine, seconds, path), seed=10 * path + r).to_log()
        for path in paths
        for r in range(repeats)
    ]


@pytest.fixture(scope="module")
def machine():
    found = Machine.load("emps")
    return dataclasses.replace(found, columns={})


@pytest.fixture(scope="module")
def stribeck(machine, urdf_dir):
    logs = record(urdf_dir, "stribeck:X=0.1")
    validation = record(urdf_dir, "stribeck:X=0.1", paths=(9,), repeats=1)
    return diagnose(machine, logs, validate=validation)


def test_a_healthy_machine_is_accused_of_nothing(machine, urdf_dir):
    found = diagnose(machine, record(urdf_dir))
    assert found.verdict == "none"
    assert found.effects == []
    assert found.noise == "repeats"


def test_the_missing_effect_is_named_first(stribeck):
    assert (stribeck.effects[0].effect, stribeck.effects[0].axis) == ("stribeck", "X")
    assert stribeck.verdict in ("explained", "partly_explained")
    assert stribeck.effects[0].confidence > 0.6


def test_the_gap_shrinks_on_a_log_that_nothing_was_fitted_to(stribeck):
    shrink = stribeck.effects[0].shrink["u"]
    assert shrink.on == "validation"
    assert shrink.after < 0.6 * shrink.before
    assert shrink.interval[0] <= shrink.share <= shrink.interval[1]
    assert stribeck.gap["X"]["u"].after < stribeck.gap["X"]["u"].rms


def test_where_names_slow_motion_for_stribeck(stribeck):
    regions = [r for r in stribeck.where if r.kind == "velocity"]
    assert regions
    assert all(r.share > r.time_share and r.p_value <= 0.05 for r in regions)


def test_the_json_is_the_contract(stribeck):
    content = json.loads(json.dumps(stribeck.to_dict(), allow_nan=False))
    assert content["verdict"] in ("none", "explained", "partly_explained", "unexplained")
    assert set(content) >= {
        "gap",
        "where",
        "effects",
        "confusable",
        "unexplained",
        "noise",
        "advice",
    }
    assert set(content["gap"]["X"]["u"]) >= {"rms", "nrmse", "noise"}
    row = content["effects"][0]
    assert set(row) >= {"effect", "axis", "confidence", "shape", "theta", "shrink", "alternatives"}
    assert row["shrink"]["on"] == "validation"
    assert {"axis", "signal", "kind", "range", "unit", "share"} <= set(content["where"][0])


def test_apply_adds_the_effect_and_the_machine_loads(stribeck, tmp_path):
    again = Machine.load(stribeck.apply(tmp_path / "more"))
    assert "stribeck" in [e.name for e in again.axis("X").effects]


def test_what_was_promised_was_not_measured_on_the_validation_log(stribeck):
    shrink = stribeck.effects[0].shrink["u"]
    assert shrink.promised != shrink.share
    assert abs(shrink.promised - shrink.share) < 0.3


def test_a_delay_is_found_in_size(machine, urdf_dir):
    sizes = []
    for dose in (0.2, 0.4):
        found = diagnose(machine, record(urdf_dir, f"delay:X={dose}"))
        assert found.effects[0].effect == "delay"
        sizes.append(found.effects[0].theta["seconds"])
    assert sizes[1] - sizes[0] == pytest.approx(2e-3, rel=0.1)
    assert sizes[0] == pytest.approx(2e-3, rel=0.1)


def test_the_answer_depends_only_on_the_seed(machine, urdf_dir, stribeck):
    logs = record(urdf_dir, "stribeck:X=0.1", seconds=6.0)
    one, two = (diagnose(machine, logs, quick=True, seed=3).to_dict() for _ in range(2))
    assert one == two


def test_one_log_without_repeats_says_that_its_noise_is_assumed(machine, urdf_dir):
    found = diagnose(machine, record(urdf_dir, paths=(7,), repeats=1), quick=True)
    assert found.noise == "assumed"
    assert any("twice" in text for text in found.advice)


def test_the_command_line(urdf_dir, tmp_path, capsys):
    logs = record(urdf_dir, "stribeck:X=0.1", paths=(7,))
    machine = Machine.load("emps")
    dataclasses.replace(machine, columns={}, spec={**machine.spec, "columns": {}}).save(tmp_path / "m")
    for k, log in enumerate(logs):
        write_log(tmp_path / f"{k}.csv", dict(log.channels))
    words = [
        "diagnose",
        str(tmp_path / "m"),
        str(tmp_path / "0.csv"),
        str(tmp_path / "1.csv"),
        "--out",
        str(tmp_path / "d"),
        "--json",
        str(tmp_path / "d.json"),
        "--quick",
    ]
    assert main(words) == 0
    assert "\nX: low-speed friction (Stribeck) is missing from the model: " in capsys.readouterr().out
    assert json.loads((tmp_path / "d.json").read_text())["effects"]
    assert (tmp_path / "d" / "diagnosis.json").is_file()
    assert main([*words, "--fail-on-gap"]) == 1


def test_a_bad_log_is_one_line_and_exit_two(tmp_path, capsys):
    assert main(["diagnose", "emps", str(tmp_path / "no.csv"), "--out", str(tmp_path / "d")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def emps(data_dir, *effects):
    found = Machine.load("emps")
    kept = tuple(e for e in found.axis("X").effects if e.name in effects)
    return found.with_effects("X", kept), pt.read(data_dir / "emps" / "DATA_EMPS.mat")


def test_emps_without_coulomb(data_dir):
    found = diagnose(*emps(data_dir, "viscous", "offset"), quick=True)
    assert (found.effects[0].effect, found.effects[0].axis) == ("coulomb", "X")


def test_emps_without_viscous(data_dir):
    found = diagnose(*emps(data_dir, "coulomb", "offset"), quick=True)
    assert found.effects[0].effect == "viscous"


def test_emps_with_symmetric_friction(data_dir):
    found = diagnose(*emps(data_dir, "coulomb", "viscous"), quick=True)
    assert found.effects[0].effect in ("coulomb_asymmetric", "offset", "viscous_asymmetric")
    assert np.isfinite(found.gap["X"]["u"].rms)


def test_a_log_that_hardly_moves_is_refused_in_one_line(machine, urdf_dir):
    (log,) = record(urdf_dir, paths=(7,), repeats=1)
    still = Log(
        {
            k: v if k == "t" else v[:1] + 1e-7 * np.sin(40.0 * log["t"]) if k.endswith("q") else v
            for k, v in log.channels.items()
        },
        source="still.csv",
    )
    with pytest.raises(PinotwinError, match=r"still\.csv"):
        diagnose(machine, still, quick=True)
