"""A ratchet: what the package weighs may only fall. Whoever makes it lighter lowers the number here."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator

import pytest

from tests.conftest import ROOT

PACKAGE = ROOT / "pinotwin"
NUMERIC = re.compile(r"\b(Floats|Ints|Mask|float)\b")
SAID = re.compile(r"\[[^\]]*\]|shape|\(n\b|unit")
STORY = re.compile(r"(foreign|random|own bench|driller|real|seed)\s?:?\s?\d{2,4}\b|case \d+|By hand", re.I)


def lines(text: str) -> int:
    return text.count("\n")


def module_numbers(text: str) -> int:
    """Count numbers that a module names at its top level."""
    values = (x.value for x in ast.parse(text).body if isinstance(x, ast.Assign | ast.AnnAssign))
    numbers = (v.value for v in values if isinstance(v, ast.Constant))
    return sum(isinstance(x, int | float) and not isinstance(x, bool) for x in numbers)


def numbers_without_unit(text: str) -> int:
    """Count public functions that take or return numbers and say neither a unit nor a shape of them."""
    return sum(_silent(node) for node in _public(ast.parse(text).body))


def _public(body: list[ast.stmt]) -> Iterator[ast.FunctionDef]:
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _public(node.body)
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node


def _silent(node: ast.FunctionDef) -> bool:
    a = node.args
    types = [*(x.annotation for x in (*a.posonlyargs, *a.args, *a.kwonlyargs)), node.returns]
    takes = any(x is not None and NUMERIC.search(ast.unparse(x)) for x in types)
    return takes and not SAID.search(ast.get_docstring(node) or "")


def stories(text: str) -> int:
    """Count places that tell of single cases and seeds."""
    return len(STORY.findall(text))


MOST: dict[Callable[[str], int], int] = {
    lines: 53_538,
    module_numbers: 101,
    numbers_without_unit: 284,
    stories: 5,
}


@pytest.mark.parametrize("weigh", MOST, ids=lambda f: f.__name__)
def test_it_only_falls(weigh: Callable[[str], int]) -> None:
    found = sum(weigh(path.read_text(encoding="utf-8")) for path in sorted(PACKAGE.rglob("*.py")))
    assert found <= MOST[weigh], f"{weigh.__name__} grew from {MOST[weigh]} to {found}: take as much out"


def test_what_is_counted() -> None:
    text = "A = 1\nB: float = 2.5  # as random833 wants it\nC = True\nD = A\n\n\ndef f():\n    E = 3\n"
    assert [weigh(text) for weigh in MOST] == [8, 2, 0, 1]
    bare = "def speed(v: float) -> float: ..."
    told = 'def speed(v: float) -> float:\n    """Return the speed [m/s]."""'
    assert [numbers_without_unit(x) for x in (bare, told)] == [1, 0]
