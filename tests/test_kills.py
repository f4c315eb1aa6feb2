"""Kills, full disks and forbidden folders over some commands; `python -m tests.kills` does so over all of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from pinotwin.system import writing
from tests import kills
from tests.rig import good_log, write_log, write_machine


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    write_machine(folder / "rig")
    write_log(folder / "0.csv", good_log())
    write_log(folder / "1.csv", {**good_log(), "X.u": 1.02 * good_log()["X.u"]})
    for name, more in (("twin", ["--cutoff", "40"]), ("other", ["--cutoff", "50"])):
        kills.ran("identify", "rig", "0.csv", "--no-loop", *more, "--out", name, cwd=folder)
    return folder


@pytest.mark.parametrize("command", ["new", "record", "identify", "export"])
def test_nothing_earlier_is_lost(command: str, inputs: Path) -> None:
    found = kills.attack(command, inputs, count=3, seed=1)
    assert found["kills"] + found["ended"] == 3
    assert found["refused"] >= 1
    assert {what: found[what] for what in kills.BAD} == dict.fromkeys(kills.BAD, 0)


def test_every_command_has_its_attack() -> None:
    assert set(kills.commands()) >= {"identify", "diagnose", "record", "blind", "vibration"}


def test_a_loss_would_be_seen(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that writes straight to its target is caught by the full disk."""
    one = kills.Attack("check", inputs, tmp_path)
    assert one.full_disk()["lost"] == 0
    monkeypatch.setattr(writing, "write_text", lambda path, text: Path(path).write_text(text))
    assert one.full_disk()["lost"] == 1
