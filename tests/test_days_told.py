"""A load of which the controllers are told: their gains and their acceleration feed-forward follow it."""

from __future__ import annotations

from pathlib import Path

import pytest

import pinotwin as pt
from pinotwin.diagnosis.days import law
from tests.days_machine import Day, machine, write

AHEAD = 0.9


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("told")
    machine(folder)
    return folder


@pytest.fixture(scope="module")
def twin(folder: Path) -> pt.Twin:
    days = [write(folder, f"healthy_{k}", Day(command=10 + k, noise=20 + k, ahead=AHEAD)) for k in range(3)]
    return pt.identify(pt.Machine.load(folder), [str(x) for x in days])


def _diagnosed(folder: Path, twin: pt.Twin, load: float) -> pt.Diagnosis:
    days = [Day(command=30 + k // 2, noise=40 + k, ahead=AHEAD, load=load) for k in range(3)]
    logs = [str(write(folder, f"load_{load}_{k}", day)) for k, day in enumerate(days)]
    return pt.diagnose(twin, logs[:2], validate=logs[2])


@pytest.mark.parametrize("load", [2.0, -1.5])
def test_a_load_is_one_body_though_the_feed_forward_follows(folder: Path, twin: pt.Twin, load: float) -> None:
    found = _diagnosed(folder, twin, load)
    assert [e.effect for e in found.effects] == ["payload"]
    assert found.effects[0].theta["m"] == pytest.approx(load, rel=0.1)


def test_without_the_feed_forward_the_law_keeps_more(
    folder: Path, twin: pt.Twin, monkeypatch: pytest.MonkeyPatch
) -> None:
    both = _told(_diagnosed(folder, twin, 2.0))
    monkeypatch.setattr(law, "TOLD", ("loop_gain",))
    assert _told(_diagnosed(folder, twin, 2.0)) < 0.9 * both


def _told(d: pt.Diagnosis) -> float:
    return max(x["score"]["law"] for x in d.to_dict()["evidence"] if x["what"] == "told")
