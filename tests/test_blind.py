"""The blind bench in small, and its scoring against hand-made answers."""

from __future__ import annotations

import json

import pytest

from pinotwin.bench.cases import Case, draw_cases
from pinotwin.bench.run import answer
from pinotwin.bench.scoring import Answer, agree, score
from pinotwin.bench.table import lines
from pinotwin.cli.main import main


def made(kind, truth, named, rho=1.0, verdict="explained"):
    return Answer(
        0, "m", "structure", kind, truth, {"X": rho}, verdict, named,
        tuple(n[:2] for n in named[:1]), None, 1.0, {"pursuit": None},
    )  # fmt: skip


def test_cases_depend_only_on_the_seed_and_cover_every_effect():
    one, two = draw_cases(["emps"], 1), draw_cases(["emps"], 1)
    assert one == two
    assert one != draw_cases(["emps"], 1, seed=1)
    assert {c.kind for c in one} == {"healthy", "single", "double", "outside"}
    assert len({c.effects[0][0] for c in one if c.kind == "single"}) >= 15


def test_an_answer_agrees_by_class_and_axis():
    assert agree(("drive_flexibility", "X"), ("joint_flexibility", "X"))
    assert agree(("payload", "C"), ("inertial_coupling", "A"))
    assert not agree(("drive_flexibility", "Y"), ("joint_flexibility", "X"))
    assert not agree(("stribeck", "X"), ("viscous", "X"))


def test_the_table_counts_what_it_says():
    truth = (("stribeck", "X", 0.1),)
    right, wrong = (("stribeck", "X", 0.9),), (("delay", "X", 0.8),)
    answers = [
        made("healthy", (), ()),
        made("healthy", (), wrong),
        made("single", truth, right),
        made("single", truth, (*right, *wrong)),
        made("single", truth, wrong),
        made("single", truth, (), rho=0.01),
        made("outside", (("mains", "X", 0.1),), (), verdict="unexplained"),
    ]
    s = score(answers)
    assert s["healthy"]["false_alarms"] == {"share": 0.5, "of": 2}
    assert s["single"]["top1_rho_above_0.1"] == {"share": pytest.approx(2 / 3), "of": 3}
    assert s["single"]["spurious_extra"] == {"share": 0.5, "of": 2}
    assert s["outside"]["recognised"] == {"share": 1.0, "of": 1}
    assert s["confusion"] == {"stribeck": {"stribeck": 2, "delay": 1}}
    assert any("top-1" in line for line in lines(s))


@pytest.mark.parametrize(
    ("kind", "effects", "expected"),
    [
        ("healthy", (), None),
        ("single", (("stribeck", "X", 0.1),), "stribeck"),
        ("single", (("delay", "X", 0.2),), "delay"),
    ],
)
def test_a_small_bench(kind, effects, expected):
    said = answer(Case(0, "emps", "structure", kind, effects, 11), seconds=8.0)
    assert (said.named[0][0] if said.named else None) == expected
    assert set(said.floors) == {"stepwise_bic", "pursuit"}
    if expected:
        assert said.size > 0.1


def test_bad_arguments_are_refused(tmp_path, capsys):
    assert main(["blind", "--seeds", "0", "--out", str(tmp_path / "b")]) == 2
    assert "at least 1" in capsys.readouterr().err
    assert json.loads("[]") == []
