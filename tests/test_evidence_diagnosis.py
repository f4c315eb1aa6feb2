"""The table of the diagnosis: what was measured beside what must be, written between two marks of a page."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from benchmarks.evidence.diagnosis import BEGIN, END, PAGE, PARTS, Line, _share, table, write_page


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
    line = _share("x", [], 1.0, 1.0, "c")
    assert math.isnan(line.value)
    assert line.counts == "0 of 0"


def test_the_table_stands_between_the_marks_and_the_rest_of_the_page_stays(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    part = next(iter(PARTS))
    line = {
        **vars(_share("healthy", [True, True, False], 0.85, 0.95, "score.py")),
        "date": "2026-11-22",
        "code": "x",
    }
    for _ in range(2):
        write_page(page, table({part: [line]}))
    text = page.read_text()
    assert text.startswith(f"before\n{BEGIN}\n| what |")
    assert text.endswith(f"\n{END}\nafter\n")
    assert "| healthy | 0.667 | 2 of 3 | ≥ 0.85 | ≥ 0.95 | **MISSED** | `score.py` | 2026-11-22 |" in text
    assert "old" not in text


def test_a_page_without_marks_is_left_alone(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text("text\n")
    with pytest.raises(ValueError, match="measured"):
        write_page(page, "table")
    assert page.read_text() == "text\n"


def test_the_page_of_the_diagnosis_has_its_marks():
    assert BEGIN in PAGE.read_text(encoding="utf-8")
    assert END in PAGE.read_text(encoding="utf-8")
