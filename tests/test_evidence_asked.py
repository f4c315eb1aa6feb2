"""The parts of the diagnosis' figures that put their own questions: what is asked, and what counts as right."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.evidence import asking, counts, limits, public, spoilt
from benchmarks.evidence.diagnosis import PARTS, Line


def named(*effects: tuple[str, str, float], verdict: str = "explained", **more: Any) -> dict[str, Any]:
    """Return a diagnosis that names effects with axis and size."""
    told = [{"effect": e, "axis": a, "size": {"after": x}, "theta": {}, "course": {}} for e, a, x in effects]
    return {"verdict": verdict, "effects": told, "recording": [], "where": [], "gap": {}, **more}


def test_a_question_is_put_once_and_a_run_that_was_cut_off_goes_on(tmp_path: Path):
    put = []

    def ask(question: str) -> dict[str, Any] | None:
        put.append(question)
        return None if question == "b" else {"verdict": "none"}

    first = asking.kept(tmp_path, "x", "abcd", ask, 2)
    assert [row["question"] for row in first] == ["a", "c"]
    assert [row["question"] for row in asking.kept(tmp_path, "x", "abcd", ask)] == ["a", "c", "d"]
    assert put == ["a", "b", "c", "d"]


@pytest.mark.parametrize(
    ("verdict", "grade", "names", "wrong"),
    [
        ("none", "agrees", [], False),
        ("none", "partly explained", [], True),
        ("explained", "not explained", [1], True),
        ("explained", "gap explained", [1], False),
        ("partly_explained", "not explained", [1], False),
        ("explained", "agrees", [], True),
        ("unexplained", "not explained", [1], True),
    ],
)
def test_a_verdict_is_held_against_grades_and_names(verdict, grade, names, wrong):
    document = {"verdict": verdict, "gap": {"X": {"u": {"grade": grade}}}, "effects": names}
    assert counts.contradicts(document) == wrong


def test_causes_that_are_all_found_are_smaller_than_they_need_be_found_at():
    line = Line("x", 0.8, None, counts.each("found"), most=0.97)
    assert [line.state(x) for x in (0.7, 0.8, 0.97, 1.0)] == ["**MISSED**", "must", "must", "**MISSED**"]
    assert "at most 0.97" in line.judged(0.9)


def test_the_commands_of_a_case_are_those_of_its_readme():
    text = "command: pinotwin identify m a.csv --out t && pinotwin diagnose t b.csv   (other)\nright: x"
    assert public.commands(text) == [["identify", "m", "a.csv", "--out", "t"], ["diagnose", "t", "b.csv"]]
    assert public.commands("command: pinotwin check m; pinotwin new X f\n")[1] == ["new", "X", "f"]


def test_every_public_case_has_its_right_answer(data_dir: Path):
    folder = data_dir.parent / "cases" / "public"
    if not folder.is_dir():
        pytest.skip("the public cases beside the data are not here")
    cases = {x.parent.name: x.read_text(encoding="utf-8") for x in folder.glob("*/README")}
    assert {name.removesuffix(public.TABLE) for name in public.RIGHT} == set(cases)
    assert all(words[0].isalpha() for text in cases.values() for words in public.commands(text))


def test_a_public_case_is_right_by_name_axis_number_instant_and_words():
    zero = partial(public.right, public.RIGHT["joint_zero_off"])
    assert zero(named(("zero", "J2", -0.09)), "")
    assert not zero(named(("zero", "J2", 0.05)), "")
    assert not zero(named(("zero", "J1", 0.0873)), "")
    extra = named(("zero", "J2", 0.05), ("offset", "J3", 1.0))
    assert not zero(extra, "")
    assert public.first(public.RIGHT["joint_zero_off"], extra, "")
    assert not zero(named(verdict="unexplained"), "")
    slip, since = public.RIGHT["joint_slips"], [{"kind": "time", "range": [5.4, 9.0]}]
    assert public.right(slip, named(("zero", "J2", 0.07), where=since), "")
    assert not public.right(slip, named(("zero", "J2", 0.07)), "")
    jitter = public.RIGHT["command_jitters"]
    assert public.right(jitter, named(recording=[{"fault": "command_jitter", "axis": "X"}]), "")
    assert not public.right(jitter, named(("payload", "X", 5.0)), "")
    loop = partial(public.right, public.RIGHT["position_is_the_command"], {})
    assert loop("no closed loop: a command was logged twice")
    assert not loop("Traceback: no closed loop")


@pytest.mark.parametrize(
    ("before", "after", "right"),
    [(0.65, 2.66, True), (0.65, 2.0, True), (0.65, 3.3, False), (None, 3.0, False)],
)
def test_a_number_is_right_as_it_is_or_as_its_change(before, after, right):
    document = named(("coulomb", "X", after))
    document["effects"][0]["size"]["before"] = before
    assert public.right(public.RIGHT["corexy_idler_drags"], document, "at the motor") == right


def test_a_case_of_two_questions_is_right_with_both(tmp_path: Path):
    name, rows = "gas_spring_lost_40_percent", []
    for question, document, text in (
        (name, named(verdict="unexplained"), "J2 is not judged"),
        (name + public.TABLE, named(("offset", "J2", -17.6)), f"{name}: 0.6"),
    ):
        folder = tmp_path / question
        (folder / "found").mkdir(parents=True)
        (folder / "said.txt").write_text(text)
        (folder / "found" / "diagnosis.json").write_text(json.dumps(document))
        rows.append({"question": question, "folder": str(folder), "verdict": document["verdict"]})
    right = {"case": name, "right": True, "first": True, "passed_over": False}
    assert public.judged(rows[:1]) == [right]
    assert public.judged(rows) == [{"case": name, "right": False, "first": False, "passed_over": True}]


@pytest.mark.parametrize(
    ("names", "faults", "machine", "recorded"),
    [
        ([], [["frozen", "X"]], False, True),
        ([["command_late", "X", 0.9]], [], False, True),
        ([["payload", "X", 0.9]], [], True, False),
    ],
)
def test_a_recording_at_fault_is_named_or_the_machine_is(names, faults, machine, recorded):
    row = spoilt.judged({"named": names, "recording": faults})
    assert (row["machine_cause"], row["recorded"]) == (machine, recorded)


def test_the_axis_that_is_spoilt_and_the_clock_are_those_of_the_log(tmp_path: Path, data_dir: Path):
    script = data_dir.parent / "cases" / "robust" / "spoil.py"
    if not script.is_file():
        pytest.skip("the cases beside the data are not here")
    names = [f"{a}.{s}" for a in ("X", "Y") for s in ("qr", "q", "u")]
    well = np.column_stack([0.001 * np.arange(400), np.random.default_rng(0).normal(size=(400, 6))])
    np.savetxt(tmp_path / "a.csv", well, delimiter=",", header=",".join(["t", *names]), comments="")
    spoilt.spoil(script, tmp_path / "a.csv", tmp_path / "b.csv", "other_run", "X")
    ill = np.loadtxt(tmp_path / "b.csv", delimiter=",", skiprows=1)
    assert (tmp_path / "b.csv").read_text().startswith(",".join(["t", *names]))
    assert np.flatnonzero(~np.isclose(ill, well, rtol=1e-6, atol=1e-9).all(axis=0)).tolist() == [3]
    spoilt.spoil(script, tmp_path / "a.csv", tmp_path / "b.csv", "dropped", "X")
    left = np.loadtxt(tmp_path / "b.csv", delimiter=",", skiprows=1)
    assert len(left) == 392
    assert np.diff(left[:, 0]) == pytest.approx(0.001)


@dataclass
class Change:
    """What ``shop.py`` changes."""

    causes: list[str]
    friction: dict[str, float] = field(default_factory=dict)
    second: dict[str, Any] = field(default_factory=dict)
    gains: dict[str, Any] = field(default_factory=dict)
    laws: Any = None
    drive: Any = None


@dataclass
class Second:
    """A second encoder's drive: stiffness [N/m] and play [m]."""

    k: float
    gap: float = 0.0


def put(effect: str, size: float, before: float = 0.0, sign: int = 1, axis: str = "X") -> Any:
    """Return the change of a machine for a stated size."""
    m = SimpleNamespace(
        joint=lambda _: SimpleNamespace(coulomb=10.0, viscous=5.0), second={"X": Second(100.0)}
    )
    stated = {"effect": effect, "axis": axis, "size": size, "before": before}
    return limits.cause(SimpleNamespace(Change=Change), m, stated, sign)


def test_a_cause_is_put_in_at_the_size_that_was_stated():
    assert put("friction_scale", 0.3, 1.0, -1).friction == {"X": pytest.approx(0.7)}
    assert put("coulomb", 4.0).laws("train") == ([("X", "coulomb", {"c": 4.0})], None)
    assert put("viscous", 2.0, sign=-1).laws("train") == ([("X", "viscous", {"b": -2.0})], None)
    assert put("position_gain", 5.0, 50.0, -1).gains == {"X": (1.0, 1.0, 0.9, 1.0)}
    assert put("velocity_feedforward", 0.1, 1.0).gains == {"X": (1.0, 1.0, 1.0, 1.1)}
    assert put("acceleration_feedforward", 1.0, 10.0).gains == {"X": (1.0, 1.1, 1.0, 1.0)}
    assert put("backlash", 3e-5).second == {"X": Second(100.0, 3e-5)}
    assert put("drive_flexibility", 20.0, 200.0, -1).second == {"X": Second(90.0)}
    assert put("effort_scale", 0.05, sign=-1).drive("train") == {"effort_scale": {"X": 0.95}}
    assert put("zero", 1e-3).drive("train")["zero"]["X"](0.0) == 1e-3


def test_what_a_machine_cannot_have_is_not_put_in():
    assert put("coulomb", 12.0, sign=-1) is None
    assert put("friction_scale", 1.2, 1.0, -1) is None
    assert put("acceleration_feedforward", 1.0) is None
    assert put("backlash", 3e-5, axis="R1") is None


def test_stated_sizes_are_drawn_from_the_seed_and_found_by_name_and_axis():
    told = [{"effect": e, "axis": a} for e in ("coulomb", "offset") for a in "XYZ"]
    drawn = limits.drawn_of(told, 7)
    assert drawn == limits.drawn_of(told, 7)
    assert len(drawn) == len(told)
    row = {"named": [["viscous", "X", 0.9]], "verdict": "explained"}
    assert limits.found(row, told[0]) == {"found": True, "seen": True}
    assert limits.found(row, told[1]) == {"found": False, "seen": True}
    assert limits.found({"named": [], "verdict": "none"}, told[0]) == {"found": False, "seen": False}


@pytest.mark.parametrize(("part", "said"), [("public", "public"), ("spoilt", "spoil.py")])
def test_cases_that_are_absent_are_no_figure(part: str, said: str, tmp_path: Path, capsys):
    told = PARTS[part].ask(SimpleNamespace(cases=tmp_path, out=tmp_path, seed=1, machines=1))
    assert all(math.isnan(line.value(told.rows).value) for line in PARTS[part].lines.values())
    assert said in capsys.readouterr().out
