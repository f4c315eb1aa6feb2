"""The figures of the diagnosis: what was measured beside what must be."""

from __future__ import annotations

import importlib
import json
import math
from pathlib import Path

import pytest

from benchmarks.evidence import counts, store
from benchmarks.evidence.answers import Given, Runs, effects
from benchmarks.evidence.diagnosis import GIVEN, PARTS, Line, figures_of, keep, measured
from benchmarks.questions.other_machines import Elsewhere
from pinotwin.bench import scoring


@pytest.mark.parametrize(
    ("value", "least", "state"),
    [
        (0.96, True, "aim"),
        (0.90, True, "must"),
        (0.80, True, "**MISSED**"),
        (0.01, False, "aim"),
        (0.92, False, "must"),
        (0.99, False, "**MISSED**"),
        (math.nan, True, "-"),
    ],
)
def test_a_line_says_what_is_reached(value, least, state):
    aim = 0.95 if least else 0.05
    must = 0.85 if least else 0.95
    assert Line("x", must, aim, counts.calibrated, least).state(value) == state


def test_a_line_without_an_aim_reaches_what_it_must():
    assert Line("x", 1.0, None, counts.calibrated).judged(1.0) == "must ≥ 1, reached: must"


def test_nothing_asked_is_no_figure():
    line = counts.share([])
    assert math.isnan(line.value)
    assert line.counts == "0 of 0"


@pytest.mark.parametrize("part", GIVEN)
def test_nothing_asked_is_no_figure_of_any_part(part: str):
    told = PARTS[part].ask(Given([]))
    assert all(math.isnan(line.value(told.rows).value) for line in PARTS[part].lines.values())


def counted(part: str, given: Given) -> dict[str, str]:
    """Return name -> what is behind each line of a part."""
    told = PARTS[part].ask(given)
    return {name: line.value(told.rows).counts for name, line in PARTS[part].lines.items()}


def asked(folder: Path, *rows: dict, machine: str = "") -> Path:
    """Write rows as the scripts do: a line each, the diagnoses beside them."""
    for row in rows:
        if "set" not in row:
            name = machine or f"random{row['seed']}"
            (folder / f"{name}-{row.get('kind', 'none')}-{row['seed']}").mkdir(parents=True, exist_ok=True)
    folder.mkdir(exist_ok=True)
    (folder / "scores.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder / "scores.jsonl"


def test_answers_that_were_given_elsewhere_are_counted(tmp_path: Path):
    row = {"what": "diagnose", "named": [], "first": False, "axis_right": True, "extras": 0}
    ours = [{**row, "kind": k, "seed": s} for s in (7, 8, 11) for k in ("viscous", "ripple")]
    ours[0]["axis_right"] = False
    hum = {**row, "kind": "hum", "seed": 7, "first": True}
    sound = {"what": "healthy", "seed": 7, "situation": "change", "named": []}
    mine = {**row, "kind": "viscous", "seed": 7}
    real = [
        {"set": "emps", "case": f"{k}:X:3", "named": [], "right": k == "delay"} for k in ("delay", "push")
    ]
    given = Given.read(
        [
            asked(tmp_path / "a", *ours, hum, sound),
            asked(tmp_path / "b", mine, machine="trunnion"),
            asked(tmp_path / "c", *real, {"set": "emps", "case": "own", "named": [], "right": True}),
        ]
    )
    assert list(counted("diagnose", given).values()) == ["5 of 6", "0 of 6", "1 of 1"]
    assert counted("healthy", given) == {"foreign_accused": "0 of 1"}
    assert counted("real_faults", given) == {"real": "1 of 2"}
    kept = measured(["diagnose", "real_faults"], given, tmp_path / "out", "abc")
    assert measured([], given, tmp_path / "out") == kept
    figure = figures_of(kept)[0]
    assert (figure.name, figure.value, figure.of, figure.kind) == ("foreign", 5.0, 6, "unseen")
    assert "score.py diagnose --seeds 7:9 --seeds 11:12" in figure.note
    assert "must ≥ 0.86, aim ≥ 0.93, reached: **MISSED**" in figure.note


def day(machine: int, kind: str, **more: object) -> dict:
    """Return a row of `score.py shop`, right and healthy unless more is said."""
    row = {"what": "shop", "seed": machine, "machine": f"random:{machine}", "kind": kind, "axis": ["X"]}
    row |= {"verdict": "explained", "named": [["kv", "X", 0.9]], "first": True, "wrong_extra": False}
    return {**row, "honest": True, "story": None, **more}


def test_machines_over_days_are_counted(tmp_path: Path):
    none = {"axis": [], "verdict": "none", "named": []}
    rows = [
        *(day(1, kind, **none) for kind in counts.HEALTHY),
        *(day(2, kind, **none | {"verdict": "unexplained"}) for kind in counts.HEALTHY[:2]),
        *(day(m, kind) for m in (1, 2) for kind in ("kv", "tooth")),
        day(1, "cut", named=[["external_force", "X", 0.8]], story=True),
        day(2, "cut", named=[["external_force", "Y", 0.8]], first=False, story=False),
        day(1, "ffv", named=[["backlash", "X", 0.8], ["effort_scale", "X", 0.6]], honest=False),
        day(1, "held_rows", **none, recorded=True),
    ]
    rows[-2]["wrong_extra"] = True
    given = Given.read([asked(tmp_path / "a", *rows)])
    assert list(counted("shop", given).values()) == [
        *("2 of 5", "1 of 2"),
        *("6 of 7", "1 of 7", "6 of 7", "1 of 2", "1 of 2", "2 of 7"),
    ]
    told = PARTS["shop"].ask(given)
    assert counts.worst_service(told.rows).which == "cut, of 4"
    assert told.command == "score.py shop --seeds 1:3, score.py shop --kinds none,none_2,none_3 --seeds 1:3"


def test_what_answers_state_is_compared_with_what_is_true(tmp_path: Path):
    names = [(p, x) for x, ps in ((True, (0.9, 0.8, 0.5)), (False, (0.5, 0.4))) for p in ps]
    rows = [day(k, "kv", named=[["kv", "X", p]], first=x) for k, (p, x) in enumerate(names)]
    rows.append(day(0, "none", axis=[], named=[["kv", "X", 0.3]]))
    del rows[-1]["first"]  # a healthy day has none: any name is wrong
    shrinks = [{"promised": 0.9, "share": 0.8}, {"promised": 0.7, "share": 0.7}]
    given = Given.read([asked(tmp_path / "a", *rows)])
    for k, kind in enumerate(("kv", "kv")):
        folder = tmp_path / "a" / f"random{k}-shop-{k}" / kind / "diagnosis"
        folder.mkdir(parents=True)
        told = {"effects": [{"shrink": {"u": shrinks[k], "on": "validation"}}]}
        (folder / "diagnosis.json").write_text(json.dumps(told))
    every = PARTS["stated"].ask(given).rows
    assert counts.discriminated(every).value == pytest.approx((9 - 0.5) / 9)
    assert counts.kept_promise(every) == counts.Measured(pytest.approx(0.1), "1 promises")
    assert math.isnan(counts.calibrated(every).value)


def test_a_counterbalance_has_a_twin_of_its_own(tmp_path: Path):
    folder = tmp_path / "random7-shop-7-balanced" / "counterbalance" / "diagnosis"
    folder.mkdir(parents=True)
    (folder / "diagnosis.json").write_text('{"effects": [1]}')
    assert effects(day(7, "counterbalance", folder=str(tmp_path))) == [1]
    assert effects(day(7, "kv", folder=str(tmp_path))) == []


def test_three_changes_are_counted_each():
    rows = [
        {"named": {"friction_up": True, "lost_motion": True, "kv": k}, "first": k, "wrong": [1] * k}
        for k in (True, False)
    ]
    found = counts.worst_of_three(rows)
    assert (found.counts, found.which) == ("1 of 2", "number of the controller, of 3")
    assert counts.false_first(rows).counts == "0 of 2"
    assert counts.false_first([*rows, {"first": False, "wrong": [1]}]).counts == "1 of 3"


def test_the_rows_of_the_own_bench_are_there():
    rows = [*scoring.healthy_rows([]), *scoring.top_rows([], []), *scoring.unknown_rows([], [])]
    rows += scoring.several_rows([], [])
    empty = [{"name": row.name, "share": {"hits": 0, "of": 0}} for row in rows]
    assert [line.value(empty).counts for line in PARTS["bench"].lines.values()] == ["0 of 0"] * 4


def test_names_that_send_astray_are_right_where_the_other_simulator_says(data_dir: Path, monkeypatch):
    elsewhere = Elsewhere.at_hand(Path(), str(data_dir))
    if elsewhere is None:
        pytest.skip("the other simulator beside the data is not here")
    monkeypatch.syspath_prepend(str(elsewhere.scripts))
    shop = importlib.import_module("shop")
    for name, kinds in counts.RIGHT.items():
        assert set(kinds) == {kind for kind, names in shop.NAMES.items() if name in names}


def test_faults_of_the_effort_are_asked_without_the_command(tmp_path: Path):
    class At:
        def real(self, name: str) -> tuple[Path, list[Path], Path]:
            return tmp_path / name, [], Path()

    (tmp_path / "emps").mkdir()
    (tmp_path / "emps" / "b.csv").write_text("t,X.qr,X.q,X.u\n0,1,2,3\n")
    row = {"set": "emps", "case": "push:X:3", "named": [], "right": True}
    sound = {**row, "case": "own"}
    given = Given.read([asked(tmp_path, row, sound)])
    assert [r["case"] for r in given.rows] == ["own"]
    Runs(At(), tmp_path, 0, 1)._without_command(tmp_path / "alone" / "emps")
    assert (tmp_path / "alone" / "emps" / "b.csv").read_text() == "t,X.q,X.u\n0,2,3\n"
    assert len(Given.read([asked(tmp_path / "alone", row, sound)]).rows) == 2


def test_a_question_that_was_asked_twice_is_not_chosen_from(tmp_path: Path):
    row = {"set": "emps", "case": "own", "named": [], "right": True}
    with pytest.raises(ValueError, match="asked twice: emps own"):
        Given.read([asked(tmp_path / "c", row, {**row, "right": False})])


def test_friction_with_the_load_that_became_an_asymmetry_is_no_question_asked_twice(tmp_path: Path):
    row = {"what": "diagnose", "seed": 7, "kind": "coulomb_asymmetric", "first": False, "named": []}
    given = Given.read([asked(tmp_path / "c", row, {**row, "first": True})])
    assert [r.get("asked") for r in given.rows] == [None, "load_friction"]


def test_a_line_that_was_not_measured_stays_as_it_was(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(store, "FILE", tmp_path / "figures.json")
    monkeypatch.setattr(store, "PAGE", tmp_path / "figures.md")
    row = {"value": 0.05, "counts": "", "which": "", "command": "asked", "date": "then", "commit": "0"}
    keep({"calibration": row})
    before = store.read()["diagnosis"]["figures"]["calibration"]
    keep({"promised": row})
    assert store.read()["diagnosis"]["figures"]["calibration"] == before


def test_every_line_has_a_name_of_its_own():
    names = [name for part in PARTS.values() for name in part.lines]
    assert len(set(names)) == len(names)
