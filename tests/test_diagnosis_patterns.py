"""What is left over follows something: another form of a named effect, a curve of the axis, a hum."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pinotwin.bench.cases import Case
from pinotwin.bench.produce import produce
from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.limits import reached
from pinotwin.diagnosis.patterns import hum

STEP, ROWS = 0.008, 1500


def said(machine, *effects, leave_out=(), seed=21):
    sealed = produce(Case(0, machine, "structure", "single", effects, seed)).sealed
    return diagnose(
        sealed.machine, sealed.logs, validate=sealed.validation, closed_loop=False, leave_out=leave_out
    )


def noisy_runs(amplitude, frequency):
    """Return a ledger of two runs of white noise with a line of other phase in each."""
    rng = np.random.default_rng(1)
    t = STEP * np.arange(ROWS)
    pieces = []
    for phase in (0.3, 2.1):
        y = rng.standard_normal(ROWS) + amplitude * np.sin(2 * np.pi * frequency * t + phase)
        channel = SimpleNamespace(joint=0, log=0, centres=np.arange(ROWS))
        pieces.append(
            SimpleNamespace(
                channel=channel, kept=np.arange(ROWS), y=y, B=np.zeros((ROWS, 1)), columns=np.arange(1)
            )
        )
    motions = [np.zeros(ROWS).view(Run)] * 2
    rows = SimpleNamespace(motions=motions, row_step=STEP)
    return SimpleNamespace(stage=SimpleNamespace(rows=rows, pieces=pieces), theta=np.zeros(1))


class Run(np.ndarray):
    """An array of as many samples as a run has, with its step."""

    step = STEP


def test_a_hum_brings_half_its_squared_amplitude_per_row_at_its_frequency():
    deviance, frequency = hum(noisy_runs(0.5, 17.3), 0)
    assert frequency == pytest.approx(17.3, abs=0.05)
    assert deviance == pytest.approx(2 * ROWS * 0.5**2 / 2, rel=0.2)


def test_noise_alone_does_not_hum():
    assert hum(noisy_runs(0.0, 17.3), 0)[0] < 40.0


def test_a_hum_of_no_axis_is_unexplained_and_said_with_its_frequency():
    found = said("random:2", ("mains", "Q2", 0.01))
    assert found.verdict in ("unexplained", "partly_explained")
    assert "time-periodic" in found.remains["Q2"]


def test_a_ripple_that_grows_with_speed_is_only_partly_its_cousin():
    found = said("random:3", ("ripple_speed", "Q3", 0.02))
    assert found.verdict == "partly_explained"
    assert "varies with speed" in found.remains["Q3"]
    assert found.effects[0].confidence < 0.6


def test_the_right_effect_leaves_no_pattern():
    found = said("emps", ("ripple", "X", 0.0076))
    assert (found.effects[0].effect, found.verdict) == ("ripple", "explained")


def test_a_dry_friction_that_differs_along_the_travel_is_said_to_go_with_position():
    found = said("emps", ("coulomb_position", "X", 0.03))
    assert (found.verdict, found.effects) == ("unexplained", [])
    assert "position" in found.remains["X"]


def test_a_curve_of_speed_is_seen_where_the_catalogue_has_none():
    found = said("random:2", ("quadratic_drag", "Q2", 0.05), leave_out=("quadratic_drag",))
    assert found.verdict in ("unexplained", "partly_explained")
    assert "speed" in found.remains["Q2"]


def motion(q, qr, u):
    """Return a motion of one axis."""
    column = [np.asarray(x, dtype=float)[:, None] for x in (q, qr, u)]
    t = 1e-3 * np.arange(len(column[0]))
    return SimpleNamespace(q=column[0], qr=column[1], u=column[2], t=t, step=1e-3)


def test_an_axis_that_holds_a_weight_is_not_at_its_limit():
    rng = np.random.default_rng(2)
    t = 1e-3 * np.arange(6000)
    qr = np.where(t < 3.0, 0.1 * (1.0 - np.cos(2 * np.pi * t)), 0.0)
    weight = np.where(t < 3.0, 80.0 - 30.0 * np.abs(np.sin(7.0 * t)), 100.0)
    u = weight + 0.2 * rng.standard_normal(len(t))
    behind = np.where(t < 3.0, 1e-6 * rng.standard_normal(len(t)), 1e-4)  # it sags
    assert reached([motion(qr - behind, qr, u)], 0) is None


def test_an_axis_whose_effort_is_cut_off_is_at_its_limit():
    rng = np.random.default_rng(2)
    t = 1e-3 * np.arange(6000)
    qr = 0.1 * (1.0 - np.cos(2 * np.pi * t))
    wanted = 100.0 * np.cos(2 * np.pi * t)
    u = np.clip(wanted, -70.0, 70.0) + 0.1 * rng.standard_normal(len(t))
    behind = 1e-6 * rng.standard_normal(len(t)) + 1e-4 * (np.abs(wanted) > 70.0)
    limit = reached([motion(qr - behind, qr, u)], 0)
    assert limit is not None
    assert limit.level == pytest.approx(70.0, rel=0.01)
    assert limit.samples[0][np.abs(wanted) > 72.0].mean() > 0.99
