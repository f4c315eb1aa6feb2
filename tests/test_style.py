"""The house style, as far as a machine can hold it; the rest is read in review."""

from __future__ import annotations

import ast
import importlib
import inspect
import statistics
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType

import pytest

from tests.conftest import ROOT

FILES = sorted((ROOT / "pinotwin").rglob("*.py"))
METHODS = (FunctionType, classmethod, staticmethod, property)
FUNCTION_LINES, MEDIAN_FUNCTION = 60, 15

# Function -> (lines, why it is not shorter). Empty is best; a number may only fall.
LONG_FUNCTIONS: dict[str, tuple[int, str]] = {}


def short(path: Path) -> str:
    return str(path.relative_to(ROOT / "pinotwin"))


def trees() -> Iterator[tuple[Path, ast.Module]]:
    for path in FILES:
        yield path, ast.parse(path.read_text(encoding="utf-8"))


def functions() -> Iterator[tuple[str, ast.FunctionDef]]:
    for path, tree in trees():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                yield f"{short(path)}:{node.name}", node


def length(node: ast.FunctionDef) -> int:
    assert node.end_lineno is not None
    return node.end_lineno - node.lineno + 1


def test_functions_fit_on_a_screen() -> None:
    lines = {name: length(node) for name, node in functions()}
    assert {
        name: n for name, n in lines.items() if n > LONG_FUNCTIONS.get(name, (FUNCTION_LINES, ""))[0]
    } == {}
    assert statistics.median(lines.values()) <= MEDIAN_FUNCTION


def test_exceptions_to_the_rule_still_exist_and_say_why() -> None:
    lines = {name: length(node) for name, node in functions()}
    for name, (_, reason) in LONG_FUNCTIONS.items():
        assert lines.get(name, 0) > FUNCTION_LINES, f"{name} needs no exception any more"
        assert len(reason) > 20


@pytest.mark.parametrize("path", FILES, ids=short)
def test_habits(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    if tree.body:
        assert ast.get_docstring(tree), "a module says first what it is about"
    for node in ast.walk(tree):
        where = f"{short(path)}:{getattr(node, 'lineno', 0)}"
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            assert name not in ("print", "breakpoint", "eval", "exec"), f"{where}: {name}"
            assert not name.endswith(("set_printoptions", "random.seed", "filterwarnings")), where
            assert name not in ("np.random.rand", "np.random.randn", "np.random.normal"), where
            assert not name.startswith(("pickle.load", "os.system")), where
        if isinstance(node, ast.Global):
            pytest.fail(f"{where}: global state")
        if isinstance(node, ast.ExceptHandler):
            kind = "everything" if node.type is None else ast.unparse(node.type)
            assert kind not in ("everything", "Exception", "BaseException"), f"{where}: {kind}"


def test_the_limits_bite() -> None:
    # A test that can never fail tells nothing: the counting itself, on a known function.
    tree = ast.parse("def f():\n" + "    x = 1\n" * 70)
    (node,) = tree.body
    assert isinstance(node, ast.FunctionDef)
    assert length(node) == 71 > FUNCTION_LINES


def test_a_public_method_has_a_docstring_or_its_base_has() -> None:
    """Ruff's D102 asks for one where the base says it already, too."""
    missing = []
    for path in (p for p in FILES if not p.name.startswith("__")):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        classes = inspect.getmembers(importlib.import_module(name), inspect.isclass)
        for kind in (x for _, x in classes if x.__module__ == name and not x.__name__.startswith("_")):
            methods = (n for n, x in vars(kind).items() if isinstance(x, METHODS) and not n.startswith("_"))
            missing += [
                f"{name}.{kind.__name__}.{n}" for n in methods if not inspect.getdoc(getattr(kind, n))
            ]
    assert missing == []
