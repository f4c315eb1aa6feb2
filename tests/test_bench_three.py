"""Three changes at once: what is put together is three different ones, of a machine that can have them."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.questions import three
from benchmarks.questions.other_machines import Elsewhere


@pytest.fixture
def shop(data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    elsewhere = Elsewhere.at_hand(tmp_path, str(data_dir))
    if elsewhere is None:
        pytest.skip("the other simulator beside the data is not here")
    monkeypatch.setattr(sys, "path", [str(elsewhere.scripts), *sys.path])
    return importlib.import_module("shop")


@pytest.mark.parametrize("number", three.NUMBERS)
def test_friction_play_and_a_number_of_the_controller_change_together(shop: Any, number: str) -> None:
    machine = shop.machine("random:2209", 2209)
    change = three.made(shop, shop.make, f"three+{number}", machine)
    assert [c["kind"] for c in change.causes] == ["friction_up", "lost_motion", number]
    (factor,) = change.friction.values()
    assert factor > 1.4
    assert next(iter(change.second.values())).gap > 2e-5
    assert len(change.gains) == 1


def test_a_wrong_first_name_fails(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    case = Path("three-1") / "three+kv"
    row = {
        "case": case,
        "named": {"kv": False, "lost_motion": True},
        "first": False,
        "wrong": [("ripple", "X")],
    }
    monkeypatch.setattr(three, "cases", lambda *_: [case])
    monkeypatch.setattr(three, "asked", lambda _: row)
    assert three.told(None, [1]) == 1  # type: ignore[arg-type]
    said = capsys.readouterr().out
    assert "lost_motion: 1 of 1 named" in said
    assert "kv or ffv or ffa: 0 of 1 named" in said
    assert "first name wrong in 1" in said


def test_a_name_counts_on_its_axis_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Found:
        effects = (
            type("Cause", (), {"effect": "backlash", "axis": "X"}),
            type("Cause", (), {"effect": "kv", "axis": "Y"}),
        )

    causes = [
        {"kind": "lost_motion", "axis": "X", "names": ["backlash"]},
        {"kind": "kv", "axis": "X", "names": ["kv"]},
    ]
    (tmp_path / "answer.json").write_text(json.dumps({"causes": causes}), encoding="utf-8")
    monkeypatch.setattr(three, "read_logs", lambda _: (None, None, None))
    monkeypatch.setattr(three, "twin_of", lambda *_, **__: None)
    monkeypatch.setattr(three, "diagnose", lambda *_, **__: Found)
    got = three.asked(tmp_path)
    assert got["named"] == {"lost_motion": True, "kv": False}
    assert got["first"]
    assert got["wrong"] == [("kv", "Y")]
