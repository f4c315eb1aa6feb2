"""Twins and diagnoses side by side: a change is found, chance is not, a series is drawn."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.analysis.comparison import compare
from pinotwin.cli.compare import moved_lines
from pinotwin.cli.main import main
from pinotwin.loop.servo import FOLLOWING, Servo
from pinotwin.report.comparison import effort_grade
from pinotwin.twin import Parameter
from tests.simulated import known_twin, plain_machine, smooth_command

SIGMA = 0.02


def twin_of(seed: int, **changed: float) -> pt.Twin:
    """A twin of which every parameter is known with an error, drawn; some differ in truth."""
    twin = known_twin(plain_machine("trunnion"))
    rng = np.random.default_rng(seed)
    theta, rows = twin.theta.copy(), []
    for key, effect, s in zip(twin.keys, twin.effects, twin.slices, strict=True):
        for k, coefficient in enumerate(effect.coefficients()):
            name = f"{key}.{coefficient.name}"
            truth = theta[s][k] + changed.get(name.replace(".", "_"), 0.0)
            error = SIGMA * max(abs(theta[s][k]), 0.1)
            theta[s.start + k] = value = truth + error * rng.standard_normal()
            rows.append(Parameter(name, key, "linear", value, coefficient.unit, error, True, "good"))
    return dataclasses.replace(twin, theta=theta, parameters=tuple(rows))


def test_what_moved_is_found_and_chance_is_not():
    found = compare(twin_of(1), twin_of(2, Y_viscous_b=12.0))
    assert [row.name for row in found.moved] == ["Y.viscous.b"]
    assert [key for key, *_ in found.causes] == ["Y.viscous"]
    row = found.to_dict()["parameters"][[r.name for r in found.rows].index("Y.viscous.b")]
    low, high = row["change_interval90"]
    assert low < 12.0 < high


def test_false_discoveries_keep_their_rate():
    wrong = sum(len(compare(twin_of(2 * k), twin_of(2 * k + 1)).moved) > 0 for k in range(40))
    assert wrong <= 8  # 5 % of 40 is 2; 9 or more would come once in 5000


def test_errors_widen_by_how_much_worse_unseen_data_are_predicted():
    moved = twin_of(2, Y_viscous_b=8.0)
    assert "Y.viscous.b" in [row.name for row in compare(twin_of(1), moved).moved]
    axes = {"Y": {"fit": 0.01, "held_out": {"nrmse": 0.06}}}
    worse = dataclasses.replace(moved, quality={"axes": axes})
    found = compare(twin_of(1), worse)
    assert found.widening["Y"] == pytest.approx(6.0)
    assert found.moved == ()


def test_a_table_is_not_asked_knot_by_knot():
    one, two = twin_of(1), twin_of(2)
    key = "Y.position_table"
    knots = [Parameter(f"{key}.m{k}", key, "linear", k, "N", 0.01, True, "") for k in range(13)]
    far = [dataclasses.replace(row, value=row.value + 9.0) for row in knots]
    pairs = ((one, knots), (two, far))
    found = compare(*(dataclasses.replace(t, parameters=(*t.parameters, *k)) for t, k in pairs))
    assert found.moved == ()
    assert "Y.position_table.m3" in [row.name for row in found.rows]


def test_errors_on_the_same_log_and_effort_of_each_effect():
    machine = plain_machine("trunnion")
    truth = known_twin(machine)
    command = smooth_command(machine, 5.0, 500.0)
    made = truth.simulate(command)
    channels = {"t": command.t}
    for axis in machine.axes:
        channels |= {
            f"{axis}.qr": command[f"{axis}.qr"],
            f"{axis}.q": made[f"{axis}.q"],
            f"{axis}.u": made[f"{axis}.u"],
        }
    off = twin_of(3, Y_viscous_b=40.0)
    found = compare(truth, off, labels=("true", "off"), log=pt.Log(channels))
    effort = found.errors["Y"]["effort"]
    assert effort["off"]["rms"] > 3.0 * effort["true"]["rms"]
    assert found.errors["Y"]["simulated u"]["true"]["nrmse"] < 0.02
    assert next(iter(found.shifts)) == "Y.viscous"


def test_different_machines_are_refused():
    with pytest.raises(pt.InputError, match="twins of different machines \\(emps, trunnion\\)"):
        compare(twin_of(1), known_twin(plain_machine("emps")))
    with pytest.raises(pt.InputError, match="two twins or more"):
        compare(twin_of(1))


def test_command_writes_a_page_and_json_for_a_series(tmp_path, capsys):
    names = ["march", "april", "may"]
    for k, name in enumerate(names):
        twin_of(k, Y_viscous_b=10.0 * k).save(tmp_path / name)
    words = [
        "compare",
        *(str(tmp_path / n) for n in names),
        "--out",
        str(tmp_path / "out"),
        "--json",
        str(tmp_path / "c.json"),
    ]
    assert main(words) == 0
    content = json.loads((tmp_path / "c.json").read_text())
    assert content["labels"] == names
    assert content["moved"] == ["Y.viscous.b"]
    page = (tmp_path / "out" / "compare.html").read_text()
    assert "Y.viscous.b" in page
    assert "http://" not in page.split("<script", 1)[0]
    out = capsys.readouterr().out
    assert "Y.viscous.b" in out
    assert max(map(len, out.replace(str(tmp_path), "").splitlines())) <= 80


def test_diagnoses_side_by_side(tmp_path, capsys):
    size = {
        "name": "viscous.b",
        "before": 51.2,
        "after": 297.0,
        "unit": "N·s/m",
        "interval90": [290.0, 304.0],
    }
    effect = {"effect": "viscous", "axis": "Y", "confidence": 0.9, "size": size, "sizes": [size]}
    for name, effects in (("a", [effect]), ("b", []), ("c", [])):
        (tmp_path / name).mkdir()
        word = "gap explained" if effects else "agrees"
        gap = {"Y": {"u": {"rms": 2.0, "nrmse": 0.1, "noise": 0.1, "grade": word}}}
        logs = [{"source": f"{name}.csv", "fingerprint": f"1234{name}"}]
        made = {"version": "0.1.0", "date": "2026-11-23", "logs": logs, "twin_from": None}
        document = {"verdict": "explained" if effects else "none", "gap": gap, "effects": effects}
        document["provenance"] = made
        (tmp_path / name / "diagnosis.json").write_text(json.dumps(document))
    folders = [str(tmp_path / name) for name in "abc"]
    assert main(["compare", *folders, "--out", str(tmp_path / "out")]) == 0
    assert "Only a: Viscous friction on Y" in capsys.readouterr().out
    content = json.loads((tmp_path / "out" / "compare.json").read_text())
    assert content["verdicts"] == {"a": "explained", "b": "none", "c": "none"}
    page = (tmp_path / "out" / "compare.html").read_text()
    assert "51.2 -&gt; 297 N·s/m (90\u00a0%)" in page
    assert page.count(">agrees</span>") == 2
    assert "b.csv (1234b)" in page
    assert "Over time" in page


def test_a_twins_error_is_graded_by_what_it_left_of_its_own_logs():
    assert effort_grade({"rms": 1.2, "misfit": 1.0}) == "within misfit"
    assert effort_grade({"rms": 9.0, "misfit": 1.0}) == "not explained"
    assert effort_grade({"rms": 9.0, "misfit": None}) == ""


def test_what_is_neither_is_one_line(tmp_path, capsys):
    assert main(["compare", str(tmp_path), str(tmp_path), "--out", str(tmp_path / "o")]) == 2
    assert "neither twin.json nor diagnosis.json" in capsys.readouterr().err


def test_a_controller_that_was_tuned_is_said_though_the_plant_is_as_it_was(tmp_path):
    """Kv = kp / (1 - ffv) goes from 15 to 90 1/s."""
    twins = []
    for seed, (kp, ffv) in enumerate([(17.0, -0.12), (12.0, 0.867)]):
        servo = Servo.of_cascade(kp, 5000.0, 40.0, ffv, 30.0)
        errors = {FOLLOWING: 2e-4, "kp": 0.2, "kv": 50.0, "rate": 0.5, "ffv": 0.005, "ffa": 1.0}
        servo = dataclasses.replace(servo, errors=errors)
        dataclasses.replace(twin_of(seed), servos={"Y": servo}).save(tmp_path / str(seed))
        twins.append(tmp_path / str(seed))
    found = compare(*twins)
    assert found.moved == ()
    assert "Controller: Y.Kv 15.179 ± 0.076 → 90.2 ± 2.7 1/s (+494%); Y.ffv" in found.sentence
    row = found.to_dict()["controller"][0]
    values = [row["values"][label]["value"] for label in found.labels]
    assert values == pytest.approx([17.0 / 1.12, 12.0 / 0.133])
    assert any("Y.Kv" in line for line in moved_lines(found))
    assert ">Y.Kv<" in found.save(tmp_path / "out").joinpath("compare.html").read_text()
