"""Fixtures shared by the suite."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


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
