"""The figures of the diagnosis: what was measured beside what must be."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from benchmarks.evidence.answers import Given
from benchmarks.evidence.diagnosis import (
    NAMES,
    PARTS,
    Line,
    diagnose,
    figures_of,
    healthy,
    named_machines,
    payload,
    real_faults,
    share,
)


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
    assert Line("x", value, must, aim, least, "", "").state == state


def test_nothing_asked_is_no_figure():
    line = share("x", [], 1.0, 1.0, "c")
    assert math.isnan(line.value)
    assert line.counts == "0 of 0"


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
    sound = {"what": "healthy", "seed": 7, "situation": "change", "silent": True, "unnamed": True}
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
    first, extra, outside = diagnose(given)
    assert (first.counts, extra.counts, outside.counts) == ("5 of 6", "0 of 6", "1 of 1")
    assert first.command == "score.py diagnose --seeds 7:9 --seeds 11:12"
    assert healthy(given)[0].counts == "0 of 1"
    assert [line.counts for line in named_machines(given)] == ["1 of 1", "0 of 0"]
    assert real_faults(given)[0].counts == "1 of 2"
    assert math.isnan(payload(given)[0].value)
    lines = {"diagnose": [{**vars(line), "date": "2026-11-23"} for line in diagnose(given)]}
    figure = figures_of(lines)[0]
    assert (figure.name, figure.value, figure.of, figure.kind) == ("foreign", 5.0, 6, "unseen")
    assert "score.py diagnose" in figure.note


def test_a_question_that_was_asked_twice_is_not_chosen_from(tmp_path: Path):
    row = {"set": "emps", "case": "own", "named": [], "right": True}
    with pytest.raises(ValueError, match="asked twice: emps own"):
        Given.read([asked(tmp_path / "c", row, {**row, "right": False})])


def test_friction_with_the_load_that_became_an_asymmetry_is_no_question_asked_twice(tmp_path: Path):
    row = {"what": "diagnose", "seed": 7, "kind": "coulomb_asymmetric", "first": False, "named": []}
    given = Given.read([asked(tmp_path / "c", row, {**row, "first": True})])
    assert [r.get("asked") for r in given.rows] == [None, "load_friction"]


def test_every_line_has_a_name_of_its_own():
    names = [name for part in PARTS for name in NAMES[part]]
    assert len(set(names)) == len(names)
