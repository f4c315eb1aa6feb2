"""What decides in identify is handed over by its caller, and one rule says when an optional part is taken."""

from __future__ import annotations

import dataclasses

import pytest

import pinotwin as pt
from pinotwin.identification import Settings
from pinotwin.identification.settings import better


@pytest.mark.parametrize(
    ("errors", "pays", "taken"),
    [
        ({"usual": 1.0, "other": 0.96}, 0.95, "usual"),
        ({"usual": 1.0, "other": 0.94}, 0.95, "other"),
        ({"usual": 1.0, "other": 0.94, "third": 0.9}, 0.95, "third"),
        ({"usual": 1.0, "tied": 1.009}, 1.01, "tied"),
        ({"usual": 1.0, "tied": 1.02}, 1.01, "usual"),
        ({"usual": float("inf"), "other": float("inf")}, 0.95, "usual"),
    ],
)
def test_the_usual_model_stays_unless_another_pays(errors, pays, taken):
    usual, *others = errors
    assert better(usual, others, errors.__getitem__, pays) == taken


def test_settings_are_frozen_and_every_one_is_said():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Settings().pays = 0.5
    text = Settings.__doc__ or ""
    for field in dataclasses.fields(Settings):
        assert f"        {field.name}: " in text


def test_identify_decides_by_the_settings_of_its_caller(data_dir):
    log = pt.read(data_dir / "emps" / "DATA_EMPS.mat")
    usual = pt.identify("emps", log, loop=False)
    other = pt.identify("emps", log, loop=False, settings=Settings(folds=3, condition=1.0, kept=2400))
    assert (usual.quality["folds"], other.quality["folds"]) == (5, 3)
    assert not any("condition number" in said for said in usual.quality["warnings"])
    assert any("condition number" in said for said in other.quality["warnings"])
    assert len(other.misfit.motion) == 2400
    slow = pt.identify("emps", log, settings=Settings(slowest=1e-4))
    assert any("no closed loop: the log has 1e+03 Hz" in said for said in slow.quality["warnings"])
