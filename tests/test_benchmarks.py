"""Every benchmark can be run by name, and one that fails neither hides nor ends the others."""

from __future__ import annotations

import importlib
import inspect
import sys
from pathlib import Path

import pytest

from benchmarks import __main__ as door

NAMES = sorted(p.stem for p in Path(door.__file__).parent.glob("*.py") if not p.stem.startswith("_"))


@pytest.mark.parametrize("name", NAMES)
def test_a_benchmark_needs_no_arguments(name: str) -> None:
    main = importlib.import_module(f"benchmarks.{name}").main
    needed = [p for p in inspect.signature(main).parameters.values() if p.default is p.empty]
    assert needed == []


def test_one_that_fails_is_said_and_the_next_is_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran = []

    def main() -> None:
        ran.append(sys.argv[1:])
        if len(ran) == 1:
            raise ValueError("broken")

    for name in ("kr300", "loop"):
        monkeypatch.setattr(importlib.import_module(f"benchmarks.{name}"), "main", main)
    monkeypatch.setattr(sys, "argv", ["benchmarks", "loop", "kr300", "--seconds", "3"])
    assert door.main() == 1
    assert ran == [["--seconds", "3"]] * 2
    said = capsys.readouterr()
    assert "failed: loop" in said.out
    assert "ValueError: broken" in said.err


def test_a_name_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["benchmarks", "lop"])
    with pytest.raises(SystemExit, match="no benchmark 'lop'"):
        door.main()
