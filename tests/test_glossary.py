"""Every word of a verdict or grade that the program prints is explained in docs/glossary.md."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import pinotwin
from pinotwin.cli import diagnose, each
from pinotwin.diagnosis import phrases
from pinotwin.diagnosis.grade import MEANING, Grade, printed
from pinotwin.diagnosis.result import Verdict
from pinotwin.logs.quality.results import Severity
from pinotwin.report import blind, simulation, verdict
from pinotwin.simulation.run import FORMS
from pinotwin.twin.parameters import verdict as parameter_verdict

GLOSSARY = (Path(__file__).parents[1] / "docs" / "glossary.md").read_text(encoding="utf-8")
FIRST = " | ".join(line.split("|")[1] for line in GLOSSARY.splitlines() if line.startswith("|"))
TEXT = " ".join(GLOSSARY.split())

PRINTED = {
    *get_args(Grade),
    *get_args(Verdict),
    *get_args(Severity),
    *simulation.GRADES,
    *FORMS,
    *(word for _, word, _ in verdict.GRADES),
    *(verdict.grade(x)[0] for x in (0.0, 99.0, float("nan"))),
    *(parameter_verdict(1.0, e, at_bound=False).split(":")[0] for e in (0.0, 0.3, 0.9, np.inf)),
    parameter_verdict(1.0, 0.1, at_bound=True),
    *(words for words, _ in blind.STATES.values()),
    each.FAILED,
}
PRINTED |= {printed(word) for word in PRINTED}


def chips() -> set[str]:
    """Return the words that stand in the code as the text of a coloured label."""
    out = set()
    for path in (Path(pinotwin.__file__).parent / "report").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            called = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "chip"
            if called and node.args and isinstance(node.args[0], ast.Constant):
                out.add(str(node.args[0].value))
    return out


@pytest.mark.parametrize("word", sorted(PRINTED | chips()))
def test_every_word_of_a_result_is_explained(word: str) -> None:
    assert re.search(rf"`{re.escape(word)}`", FIRST), f"docs/glossary.md has no row of {word!r}"


def test_labels_are_found_in_the_code() -> None:
    assert {"tied", "given", "determined"} <= chips()


def test_grades_mean_what_the_page_says() -> None:
    for grade, meaning in MEANING.items():
        start = meaning.split(";")[0].split(",")[0]
        assert start in TEXT, f"{grade}: the glossary says something else than {meaning!r}"


def test_other_words_of_an_answer_are_explained() -> None:
    for word in (*diagnose.OTHERWISE.values(), *phrases.KINDS.values()):
        assert word in TEXT, word


def test_limits_of_an_axis_stand_as_they_are() -> None:
    told = [f"{100 * limit:g}" for limit, _, _ in verdict.GRADES]
    assert f"below {', '.join(told[:-1])} and {told[-1]} %" in TEXT
