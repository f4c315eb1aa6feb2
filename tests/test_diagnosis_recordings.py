"""Healthy recordings of machines that were not looked at when the rules were set: nothing is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.evidence.recordings import questions

QUICK = ("ODrive", "KR300", "mill 12", "mill 3")


@pytest.mark.parametrize("name", QUICK)
def test_nothing_is_named_on_another_part_of_a_healthy_recording(name: str, data_dir: Path) -> None:
    """A motor's first jerk was a push, a robot's halves were other gains, a mill was viscous."""
    asked = [q for q in questions(data_dir) if q.name.startswith(name)]
    assert asked
    for question in asked:
        found = question.answer()
        assert (question.name, found.effects) == (question.name, [])
        assert (question.name, found.verdict) == (question.name, "none")
