"""Healthy recordings of machines that were not looked at when the rules were set: nothing is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.evidence.recordings import answers


@pytest.mark.parametrize(
    ("name", "only"),
    [
        ("ODrive map", ""),
        ("ODrive slow turn", ""),
        ("KR300 half", ""),
        ("mill", ("mill 12", "mill 3")),
    ],
)
def test_nothing_is_named_on_another_part_of_a_healthy_recording(
    name: str, only: str | tuple[str, ...], data_dir: Path
) -> None:
    """A motor's first jerk was a push, a robot's halves were other gains, a mill was viscous."""
    found = [(question, said) for question, said in answers(name, data_dir) if question.startswith(only)]
    assert found
    for question, said in found:
        assert (question, said.effects) == (question, [])
        assert (question, said.verdict) == (question, "none")
