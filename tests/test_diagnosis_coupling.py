"""What one axis does to the others, held against Pinocchio; evidence with columns of very unlike size."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from pinotwin.diagnosis.catalogue.dynamics import _carried, _sprung
from pinotwin.diagnosis.catalogue.sensing import _encoder
from pinotwin.diagnosis.context import Scene, shaken
from pinotwin.diagnosis.ledger import build_ledger, residual_of
from pinotwin.diagnosis.shrinking import foretold
from pinotwin.diagnosis.stage import Piece, Stage
from pinotwin.diagnosis.trivial import left_by

STEP, JOINT, ERROR, PERIOD = 1e-3, 1, 2e-4, 2.0 * np.pi / 24


class Path(SimpleNamespace):
    """As much of a motion as columns of the sensing need."""

    def __init__(self, q):
        super().__init__(q=q, step=STEP)

    def __len__(self):
        return len(self.q)


@pytest.fixture(scope="module")
def arm():
    """Return a six-axis arm without gravity, its motion, and a context that holds no more than this."""
    model = pin.buildSampleModelManipulator()
    model.gravity = pin.Motion.Zero()
    t = np.arange(3000) * STEP
    q = 0.6 * np.sin(np.outer(t, np.linspace(0.9, 1.7, model.nv)) + np.arange(model.nv))
    data = model.createData()
    mass = np.stack([pin.crba(model, data, x, pin.Convention.WORLD) for x in q])
    mass = np.triu(mass) + np.triu(mass, 1).transpose(0, 2, 1)
    scene = Scene(0, Path(q), None, None, None, mass)
    context = SimpleNamespace(
        scenes=(scene,),
        machine=SimpleNamespace(nv=model.nv, rotary=[True] * model.nv),
        travel=lambda j: (q[:, j].min(), q[:, j].max()),
    )
    return model, scene, context


def efforts(model, q):
    """Return the efforts along a path, its derivatives by central differences."""
    v, data = np.gradient(q, STEP, axis=0), model.createData()
    a = np.gradient(v, STEP, axis=0)
    return np.stack([pin.rnea(model, data, *x) for x in zip(q, v, a, strict=True)])


def test_an_encoder_error_shakes_the_other_axes_as_rnea_says(arm):
    model, scene, context = arm
    read = scene.motion.q
    real = read.copy()
    real[:, JOINT] -= ERROR * np.sin(2.0 * np.pi * read[:, JOINT] / PERIOD)
    gap = (efforts(model, real) - efforts(model, read))[10:-10]
    family = _encoder(context, "J1", JOINT, STEP)
    columns = dict(family.make(scene, {"period": PERIOD}))
    assert family.shakes
    assert next(iter(columns)) == JOINT
    assert len(columns) > 3
    for joint, x in columns.items():
        left = gap[:, joint] - ERROR * x[10:-10, 1]
        if np.std(gap[:, joint]) > 0.05 * np.std(gap[:, JOINT]):
            assert np.std(left) < 0.1 * np.std(gap[:, joint]), joint


def test_a_load_that_is_but_a_part_of_the_inertia_shakes_the_more(arm):
    _, scene, context = arm

    def ones(s, _):
        return np.ones(len(s.motion))

    whole, part = (dict(shaken(context, JOINT, ones, load)(scene, {})) for load in (1.0, 0.5))
    np.testing.assert_allclose(part[JOINT], whole[JOINT])
    np.testing.assert_allclose(part[0], 2.0 * whole[0])


def test_columns_of_any_size_count():
    """Those of an encoder error are of the order of 1e6: others beside them were taken for nothing."""
    rng = np.random.default_rng(2)
    plain = rng.standard_normal((80, 3))
    y = plain @ [1.0, 2.0, -1.0] + 0.1 * rng.standard_normal(80)
    B = plain * [1e-8, 1.0, 1e7]
    base = SimpleNamespace(count=3, precision=np.zeros((3, 3)), change=False)
    piece = Piece(SimpleNamespace(log=0, joint=0), np.arange(80), np.arange(80) // 40, np.arange(3), B, y)
    ledger = build_ledger(Stage(None, base, None, (piece,), 2))
    expected = y - plain @ np.linalg.lstsq(plain, y, rcond=None)[0]
    np.testing.assert_allclose(residual_of(piece, ledger.theta), expected, atol=1e-6)


def left(before, after):
    """Return errors of one joint, before and after, as a gap holds them."""
    rows = np.arange(len(before))
    channel = SimpleNamespace(joint=0, log=0, centres=rows)
    pieces = (SimpleNamespace(channel=channel, kept=rows),)
    stage = SimpleNamespace(pieces=pieces, rows=SimpleNamespace(motions=[SimpleNamespace(step=0.01)]))
    return [SimpleNamespace(delivered=SimpleNamespace(stage=stage, values=(x,))) for x in (before, after)]


@pytest.mark.parametrize("part", [0.0, 0.5, 1.0])
def test_what_effects_foretell_counts_whatever_else_is_in_the_gap(part):
    rng = np.random.default_rng(3)
    own, other = rng.standard_normal((2, 20000))
    gap = part * own + 8.0 * other
    slope, error = foretold(*left(gap, gap - own), 0)
    assert error == pytest.approx(8.0 / np.sqrt(20000), rel=0.3)
    assert abs(slope - part) < 3.0 * error


def test_two_that_hide_each_other_are_not_left_over():
    """The first of two that are much alike looks as if it were both; given the other it is not."""
    first, second = (
        SimpleNamespace(G=g, joints={0}, candidate=SimpleNamespace(effect=e, axis="X"))
        for e, g in (("viscous", 57000.0), ("coulomb", 2300.0))
    )
    assert left_by(first, first.G, second)
    assert not left_by(first, 3000.0, second)


def test_a_spring_passes_on_what_scipy_says_while_the_posture_changes_the_inertia():
    rng = np.random.default_rng(8)
    t = 2e-3 * np.arange(1500)
    load = np.interp(t, np.arange(0.0, 3.1, 0.05), rng.standard_normal(62))
    ratio = 1.0 + 0.5 * np.sin(3.0 * t)  # of the mean inertia over that of the posture
    w, zeta = 2.0 * np.pi * 22.0, 0.08

    def slope(now, s):
        r = np.interp(now, t, ratio)
        return [s[1], r * (np.interp(now, t, load) - w**2 * s[0] - 2.0 * zeta * w * s[1])]

    exact = solve_ivp(
        slope, (0.0, t[-1]), [load[0] / w**2, 0.0], t_eval=t, rtol=1e-9, atol=1e-12, max_step=2e-3
    )
    effort = w**2 * exact.y[0] + 2.0 * zeta * w * exact.y[1]
    np.testing.assert_allclose(_sprung(load, ratio, w, zeta, 2e-3), effort, atol=5e-5)
    constant = _sprung(load, np.ones(1500), w, zeta, 2e-3)
    assert np.std(constant - effort) > 0.2 * np.std(effort - load)  # one frequency does not do


def test_play_without_a_gap_is_a_spring():
    t = 2e-3 * np.arange(2000)
    q = 0.1 * np.sin(2.0 * np.pi * 1.5 * t) + 0.01 * np.sin(2.0 * np.pi * 6.0 * t)
    a = np.gradient(np.gradient(q, 2e-3), 2e-3)
    ratio, w, zeta = 1.0 + 0.4 * np.sin(2.0 * t), 2.0 * np.pi * 25.0, 0.1
    carried = _carried(q, np.zeros(2000), ratio, 0.0, w, zeta, 2e-3)  # per inertia
    sprung = ratio * _sprung(a / ratio, ratio, w, zeta, 2e-3)
    inner = slice(300, -10)
    assert np.std((carried - sprung)[inner]) < 0.1 * np.std((sprung - a)[inner])
