"""A ratchet: what the package weighs may only fall. Whoever makes it lighter lowers the number here."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable

import pytest

from tests.conftest import ROOT

PACKAGE = ROOT / "pinotwin"
STORY = re.compile(r"(foreign|random|own bench|driller|real|seed)\s?:?\s?\d{2,4}\b|case \d+|By hand", re.I)


def lines(text: str) -> int:
    return text.count("\n")


def module_numbers(text: str) -> int:
    """Count numbers that a module names at its top level."""
    values = (x.value for x in ast.parse(text).body if isinstance(x, ast.Assign | ast.AnnAssign))
    numbers = (v.value for v in values if isinstance(v, ast.Constant))
    return sum(isinstance(x, int | float) and not isinstance(x, bool) for x in numbers)


def stories(text: str) -> int:
    """Count places that tell of single cases and seeds."""
    return len(STORY.findall(text))


MOST: dict[Callable[[str], int], int] = {
    lines: 64_252,
    module_numbers: 424,
    stories: 6,
}


@pytest.mark.parametrize("weigh", MOST, ids=lambda f: f.__name__)
def test_it_only_falls(weigh: Callable[[str], int]) -> None:
    found = sum(weigh(path.read_text(encoding="utf-8")) for path in sorted(PACKAGE.rglob("*.py")))
    assert found <= MOST[weigh], f"{weigh.__name__} grew from {MOST[weigh]} to {found}: take as much out"


def test_what_is_counted() -> None:
    text = "A = 1\nB: float = 2.5  # as random833 wants it\nC = True\nD = A\n\n\ndef f():\n    E = 3\n"
    assert [weigh(text) for weigh in MOST] == [8, 2, 1]
