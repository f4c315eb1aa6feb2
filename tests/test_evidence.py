"""What README and docs state of real recordings is measured again; half as much more is a failure."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

from benchmarks.evidence import store

MORE = 1.5


@pytest.mark.parametrize("part", ["emps", "lwr4", "panda"])
def test_a_recording_is_predicted_as_well_as_stated(
    part: str, data_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PINOTWIN_DATA", str(data_dir))
    for figure in importlib.import_module(f"benchmarks.evidence.{part}").figures():
        assert figure.value <= MORE * store.value(f"{part}.{figure.name}"), figure
