"""Shapes of the base: the speed at which friction fades, found on rows in motion."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pinotwin.bench.cases import Case
from pinotwin.bench.plants import virtual
from pinotwin.bench.produce import produce
from pinotwin.diagnosis.prepare import ready
from pinotwin.diagnosis.shapes import faded
from pinotwin.effects import Presliding

MACHINE = "random:3"


@pytest.fixture(scope="module")
def start():
    sealed = produce(Case(0, MACHINE, "structure", "healthy", (), 5)).sealed
    return ready(sealed.machine, sealed.logs, (), lambda stage: None)


@pytest.fixture(scope="module")
def truth():
    axes = virtual(MACHINE).truth.axes
    return {a: axes[a].friction.stribeck_speed for a in ("Q1", "Q2")}


def speeds(effects):
    return {e.axis: e.v_s for e in effects if isinstance(e, Presliding)}


def again(start, times):
    """Return the speeds that are found from others, so many times as high."""
    effects = tuple(
        replace(e, v_s=times * e.v_s) if isinstance(e, Presliding) else e for e in start.stage.base.effects
    )
    return speeds(faded(effects, start.stage.rows.fitted, start.stage.noise))


def test_a_speed_that_is_far_off_is_found_where_the_motion_tells_it(start, truth):
    found = again(start, 15.0)
    for axis, true in truth.items():
        assert found[axis] == pytest.approx(true, rel=0.4)  # its law's exponent is not the listing's


def test_a_speed_that_does_well_stays_as_it_was_identified(start):
    own = speeds(start.stage.base.effects)
    assert again(start, 1.0) == own
