"""Fixtures shared by the suite."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from pinotwin.diagnosis.result import Diagnosis

ROOT = Path(__file__).resolve().parents[1]

# The same examples in every run; `make fuzz` (PINOTWIN_FUZZ) looks at others, and at more.
settings.register_profile("same", derandomize=True)
settings.register_profile("others", derandomize=False)
settings.load_profile("others" if "PINOTWIN_FUZZ" in os.environ else "same")


SLOW = (
    "test_examples.py",
    "test_each.py",
    "test_blind.py::test_two_processes",
    "test_vibration_flexible.py::test_flexible_plant_and_its_spring",
    "test_imu_batch.py::test_the_table_of_methods",
    "test_imu_clock.py::test_offset_and_skew_over_fifty",
    "test_bench_engine.py::test_an_item_that_always_kills",
    "test_examples_numbered.py::test_the_notebook_runs",
)
"""What `make slow` runs and `make test` does not: a fifth of the time, for which 15 minutes of CI have no room."""

FIRST = (
    "test_docs",  # every kernel is compiled here, once
    "test_types",  # meanwhile: needs none
    "test_examples",
    "test_new",  # needs few
    "test_blind",
    "test_each",
    "test_kills",
    "test_tutorials",
    "test_diagnosis_passive",
    "test_plausible",
    "test_diagnosis_encoders",
    "test_examples_numbered",
    "test_diagnosis",
    "test_closed_loop_virtual",
    "test_diagnosis_servo",
    "test_days_account",
    "test_days_structure",
    "test_days",
    "test_diagnosis_named",
    "test_vibration",
    "test_imu_batch",
    "test_diagnosis_runs",
    "test_diagnosis_payload",
    "test_evidence",
    "test_flexible_twin",
    "test_fit_bodies",
    "test_diagnosis_real",
    "test_terminal",
    "test_vibration_example",
    "test_closed_on_load",
    "test_effects_listed",
    "test_improvement",
)
"""Files that take longest, first: a long one that comes last leaves a core idle. Two cores start with a file each."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the files of FIRST first, in that order; the rest stays as it is."""
    place = {name: k for k, name in enumerate(FIRST)}
    for item in items:
        if any(part in item.nodeid for part in SLOW):
            item.add_marker("slow")
    items.sort(key=lambda item: place.get(item.path.stem, len(FIRST)))


def _data_root() -> Path:
    return Path(os.environ.get("PINOTWIN_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of the real recordings; skips where they are absent, fails where they must not be."""
    root = _data_root()
    if not root.is_dir():
        if os.environ.get("PINOTWIN_REQUIRE_DATA"):
            pytest.fail(f"real recordings required but {root} does not exist")
        pytest.skip(f"real recordings are not at hand ({root}); set PINOTWIN_DATA")
    return root


@pytest.fixture(scope="session")
def urdf_dir() -> Path:
    """Folder of the bundled machines."""
    return ROOT / "urdf"


@pytest.fixture(autouse=True)
def lines_stay_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Output is wrapped where COLUMNS is set, as pytest-xdist does; tests read whole lines."""
    monkeypatch.delenv("COLUMNS", raising=False)


@pytest.fixture(scope="session", autouse=True)
def answers_hold() -> Iterator[None]:
    """Every diagnosis that a test makes holds what holds of all of them; see :mod:`tests.invariants`."""
    from pinotwin.diagnosis import pipeline
    from tests.invariants import invariants

    last = pipeline.with_open_signals

    def checked(found: Diagnosis) -> Diagnosis:
        said = last(found)
        assert invariants(said.to_dict()) == []
        return said

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "with_open_signals", checked)
        yield
