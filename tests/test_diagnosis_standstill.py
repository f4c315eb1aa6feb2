"""Friction with a memory on virtual machines: named where an axis stands, and not where it is healthy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pinotwin.bench.cases import Case
from pinotwin.bench.produce import produce
from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.standstill import roughness_at_rest


def said(machine, *effects, seed=21, leave_out=()):
    sealed = produce(Case(0, machine, "structure", "single", effects, seed)).sealed
    return diagnose(
        sealed.machine, sealed.logs, validate=sealed.validation, closed_loop=False, leave_out=leave_out
    )


def test_presliding_is_named_although_rows_in_motion_do_not_show_it():
    found = said("random:3", ("presliding", "Q3", 0.5))
    assert (found.effects[0].effect, found.effects[0].axis) == ("presliding", "Q3")
    assert found.effects[0].shrink["u"].share > 0.3


def test_a_healthy_machine_with_presliding_is_not_accused_of_any():
    found = said("random:3")
    assert (found.verdict, found.effects) == ("none", [])


@pytest.mark.parametrize("size", [0.1])
def test_friction_that_chatters_at_rest_is_said_to_be_unexplained(size):
    found = said("random:2", ("chatter", "Q2", size))
    assert found.verdict in ("unexplained", "partly_explained")
    assert "standstill" in found.remains["Q2"]


def test_a_law_that_is_listed_is_not_missing():
    """The driller lists presliding on every axis: its form was found in this very log."""
    found = said("laser_driller", ("stribeck", "C", 0.04))
    assert ("presliding", "C") not in {(e.effect, e.axis) for e in found.effects}


def test_a_machine_is_diagnosed_though_one_of_its_axes_rests():
    """Its rotor inertia is a candidate that acts on no row at all."""
    made = produce(Case(0, "random:2", "structure", "healthy", (), 5), seconds=4.0).sealed
    rest = {f"Q2.{k}": np.full(len(made.logs[0]), made.logs[0][f"Q2.{k}"][0]) for k in ("q", "qr", "u")}
    logs = [log.with_channels({**log.channels, **rest}) for log in made.logs]
    found = diagnose(made.machine, logs, quick=True)
    assert set(found.gap) == {"Q1"}
    assert any(x.startswith("Q2 hardly moves") for x in found.advice)


def test_what_repeats_differ_by_from_row_to_row_is_told_apart_at_rest():
    """Two runs whose noise is twice as large where the axis stands."""
    rng = np.random.default_rng(3)
    v = np.repeat([0.0, 1.0, 0.0, 1.0], 500)
    size = np.where(v == 0.0, 2.0, 1.0)
    rows = SimpleNamespace(
        channels=[SimpleNamespace(joint=0, log=k, centres=4 * np.arange(2000)) for k in (0, 1)],
        validation=(False, False),
        commands=(0, 0),
        thinner=SimpleNamespace(factor=4),
        motions=[SimpleNamespace(v=np.repeat(v, 4)[:, None])] * 2,
    )
    residuals = tuple(size * rng.standard_normal(2000) for _ in range(2))
    rest = SimpleNamespace(stage=SimpleNamespace(rows=rows), residuals=residuals)
    assert roughness_at_rest(rest, 0) == pytest.approx(2.0, rel=0.1)
    sags = tuple(rng.standard_normal(2000) + 50.0 * k * (v == 0.0) for k in range(2))
    still = SimpleNamespace(stage=SimpleNamespace(rows=rows), residuals=sags)
    assert roughness_at_rest(still, 0) == pytest.approx(1.0, rel=0.1)  # it is held otherwise, and stays
