"""The example runs at a small size and its figures beat the source's."""

from __future__ import annotations

import importlib.util

import pytest

from tests.conftest import ROOT
from tests.test_vibration_flexible import machine


def test_flexure_rig_example(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    path = ROOT / "examples" / "flexure_rig.py"
    assert len(path.read_text().splitlines()) <= 110
    spec = importlib.util.spec_from_file_location("flexure_rig_example", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    out = module.main(10.0, 2, machine())
    for angle, velocity, acceleration in out["rows"].values():
        assert angle < 0.001
        assert velocity < 0.0474
        assert acceleration < 7.33
    assert out["effort"][1]["Y"] < 0.5 * out["effort"][0]["Y"]
    assert out["k"] == pytest.approx(1.0, abs=0.05)
    assert out["held"] == pytest.approx(20.0, rel=0.03)
    said = capsys.readouterr().out
    assert "Table 7-2" in said
    assert "(not used) from imu1" in said
