"""The gate: what it asks, what it takes for right, and that a wrong answer fails it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.questions import gate
from benchmarks.questions.__main__ import main
from benchmarks.questions.gate import CHECKS, Check, checks, run_gate
from benchmarks.questions.healthy import Question

RIPPLE = Check(Question("own", "emps", "structure", 8), "ripple", "X", 0.02)


def test_the_quick_gate_has_every_healthy_machine_and_faults_of_every_kind() -> None:
    quick = checks(quick=True)
    assert checks(quick=False) == list(CHECKS)
    assert [c for c in CHECKS if not c.fault] == [c for c in quick if not c.fault]
    assert {c.question.kind for c in quick if c.fault} == {"own", "foreign", "real"}
    assert len(quick) < len(CHECKS)


def test_a_fault_must_be_named_and_a_healthy_machine_must_not_be(tmp_path: Path) -> None:
    assert RIPPLE in CHECKS
    right = run_gate([RIPPLE], tmp_path, None, workers=1)[0]
    assert right.holds, right.said
    assert right.said.startswith("explained: ripple on X")


@pytest.mark.parametrize(
    ("verdict", "first", "healthy", "faulty"),
    [
        ("none", [], True, False),
        ("unexplained", [], False, False),
        ("explained", [("ripple", "X")], False, True),
        ("explained", [("ripple", "Y")], False, False),
        ("explained", [("viscous", "X"), ("ripple", "X")], False, False),
    ],
)
def test_what_is_right(verdict: str, first: list[tuple[str, str]], healthy: bool, faulty: bool) -> None:
    assert replace(RIPPLE, fault="", axis="").holds(verdict, first) == healthy
    assert RIPPLE.holds(verdict, first) == faulty


def test_a_wrong_answer_fails_the_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(gate, "CHECKS", (replace(RIPPLE, axis="nowhere"), replace(RIPPLE, quick=False)))
    monkeypatch.setattr(gate, "produce", None)  # breaks off, which is no answer either
    assert main(["gate", "--quick", "--workers", "1", "--work", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    assert "WRONG" in said
    assert "0 of 1 right" in said
