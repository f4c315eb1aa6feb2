"""Tables: their prior, the pitches that a log shows beside it, and what they say where no log has been."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.effects.position import PositionTable
from pinotwin.errors import MachineError
from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual.folder import read_folder
from tests.one_slide import motion


def twin_of(*, ripple: bool) -> pt.Twin:
    folder = read_folder(pt.machines()["trunnion"])
    axes = {k: a if ripple else replace(a, ripple=()) for k, a in folder.truth.axes.items()}
    virtual = VirtualMachine.build(replace(folder, truth=replace(folder.truth, axes=axes)))
    log = virtual.record(random_trajectory(virtual, 20.0, 171), seed=171).to_log()
    return pt.identify(pt.Machine.load("trunnion"), log, loop=False)


def table_of(twin: pt.Twin, axis: str) -> PositionTable:
    return next(e for e in twin.effects if isinstance(e, PositionTable) and e.axis == axis)


def test_pitches_of_the_truth_are_found_and_no_others() -> None:
    twin = twin_of(ripple=True)
    assert sorted(table_of(twin, "Y").pitches) == pytest.approx([0.016 / 3, 0.016, 0.032], rel=0.02)
    assert sorted(table_of(twin, "A").pitches) == pytest.approx([0.14279967, 0.28559933], rel=0.02)
    assert any(
        "Y: the knots of its position table are 0.005 m apart, not 0.001" in x
        for x in twin.quality["warnings"]
    )
    motion = twin.misfit.motion
    beyond = replace(motion, q=np.where(np.arange(3) == 0, 0.19, motion.q))
    outside, inside = (float(np.median(twin.effort_error(m)[:, 0])) for m in (beyond, motion))
    assert outside > 2.0 * inside


def test_a_machine_without_ripple_has_no_pitches() -> None:
    twin = twin_of(ripple=False)
    assert [table_of(twin, axis).pitches for axis in "YA"] == [(), ()]


def test_given_pitches_are_waves_beside_the_curve() -> None:
    at = motion()
    table = PositionTable("X", spacing=0.1, pitches=(0.3,), amplitude=2.0, length=0.2).fitted_to(at)
    count, values = len(table.knots), table.columns(at).values[:, 0]
    assert values[:, :count].sum(axis=1) == pytest.approx(1.0)
    assert np.hypot(*values[:, count:].T) == pytest.approx(1.0)
    rows, _ = table.belief()
    assert rows.shape == (count, count + 2)
    assert not rows[:, count:].any()
    with pytest.raises(MachineError, match="pitch must be positive"):
        PositionTable("X", pitches=(0.3, 0.0))
