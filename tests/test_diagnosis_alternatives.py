"""What else a found effect may be: isolability of its own signature, the model confidence set, leavings."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pinotwin.diagnosis.admission import Judged
from pinotwin.diagnosis.bank import Batch, Shelf
from pinotwin.diagnosis.base import Base, _unknown
from pinotwin.diagnosis.catalogue.sensing import _late
from pinotwin.diagnosis.confidence_set import LEVEL, confidence_set, rejected
from pinotwin.diagnosis.confirm import beyond_doubt
from pinotwin.diagnosis.context import Family
from pinotwin.diagnosis.decide import Decision, Named, _Search
from pinotwin.diagnosis.isolability import not_isolable
from pinotwin.diagnosis.search import Settings
from pinotwin.diagnosis.stage import Piece, Stage
from pinotwin.effects import Ripple, Stribeck, Viscous

ROWS = 600
STEP = 0.01


class Rows(Stage):
    """A stage whose candidates are whitened already."""

    def project(self, columns):
        return columns


def world(*, effort=None):
    """Return a context and a stage of one axis that goes to and fro."""
    t = STEP * np.arange(ROWS)
    base = Base((), np.zeros(1), np.zeros(1), np.zeros((1, 1)))
    channel = SimpleNamespace(log=0, joint=0, centres=np.arange(ROWS))
    y = np.zeros(ROWS) if effort is None else effort
    slope = np.sin(9.0 * t)[:, None]
    piece = Piece(channel, np.arange(ROWS), np.arange(ROWS) // 100, np.arange(1), slope, y)
    rows = SimpleNamespace(motions=[SimpleNamespace(step=STEP)], channels=())
    stage = Rows(rows, base, None, (piece,), 6)
    context = SimpleNamespace(scenes=(SimpleNamespace(t=t),), rows=rows, machine=SimpleNamespace(axes={}))
    return context, stage


def constant(s, _):
    return np.ones((ROWS, 1))


def either_way(s, _):
    up = np.sin(3.0 * s.t) > 0.0
    return np.stack([up, ~up], axis=1).astype(float)


def wave(s, _):
    return np.sin(5.0 * s.t)[:, None]


MAKERS = {"gravity": constant, "coulomb_asymmetric": either_way, "ripple_like": wave}


def shelves(context):
    out = {}
    for name, make in MAKERS.items():
        names = tuple("ab")[: make(context.scenes[0], {}).shape[1]]
        family = Family(name, "X", names, make)
        columns = [make(context.scenes[0], {})[:, None, :]]
        out[name] = Shelf(family, (Batch(family.shapes, columns),))
    return out


def found(context, name, theta):
    family = shelves(context)[name].family
    candidate = family.at(context, {})
    theta = np.asarray(theta, dtype=float)
    gain = float(np.sum((candidate.columns[0] @ theta) ** 2))
    return Judged(family, candidate, gain, gain, theta, 1.0, identifiable=True)


@pytest.mark.parametrize(
    ("name", "theta", "same"),
    [
        ("gravity", [1.0], {"coulomb_asymmetric"}),
        ("coulomb_asymmetric", [1.0, 1.0], {"gravity"}),
        ("coulomb_asymmetric", [1.0, -1.0], set()),
        ("ripple_like", [1.0], set()),
    ],
)
def test_what_a_found_effect_is_confused_with_depends_on_its_coefficients(name, theta, same):
    context, stage = world()
    what = found(context, name, theta)
    said = not_isolable(context, list(shelves(context).values()), stage, what, Settings())
    assert {effect for effect, _ in said} == same


def test_the_smaller_an_effect_the_less_it_is_told_from_its_like():
    context, stage = world()
    bank = list(shelves(context).values())
    mixed = [1.0, 0.4]  # mostly a constant
    small, large = (
        not_isolable(
            context, bank, stage, found(context, "coulomb_asymmetric", s * np.array(mixed)), Settings()
        )
        for s in (0.05, 1.0)
    )
    assert ("gravity", "X") in small
    assert ("gravity", "X") not in large


def test_equal_models_are_kept_as_often_as_stated():
    rng = np.random.default_rng(4)
    kept = [
        confidence_set(rng.standard_normal((4, 80)) + rng.standard_normal(80), rng) >= LEVEL
        for _ in range(150)
    ]
    share = np.mean(kept, axis=0)
    assert np.all(share > 1.0 - LEVEL - 0.05)
    assert np.mean(np.all(kept, axis=1)) > 1.0 - LEVEL - 0.08


def test_a_worse_model_is_rejected_and_the_best_never():
    rng = np.random.default_rng(5)
    shared = 3.0 * rng.standard_normal(100)  # what all models share does not hide a difference
    losses = shared + 0.3 * rng.standard_normal((3, 100)) + np.array([[0.0], [0.02], [1.0]])
    p = confidence_set(losses, rng)
    assert p.max() == 1.0
    assert p[2] < LEVEL < min(p[:2])


def test_data_reject_an_effect_of_another_course():
    rng = np.random.default_rng(6)
    context, _ = world()
    effort = 0.5 * constant(context.scenes[0], {})[:, 0] + rng.standard_normal(ROWS)
    context, stage = world(effort=effort)
    own, other = found(context, "gravity", [0.5]), found(context, "ripple_like", [0.1])
    off = rejected(stage, None, [], [own, other], rng)
    assert set(off) == {("ripple_like", "X")}


def test_a_member_is_judged_without_what_it_leaves_over():
    a, b, quiet, left = (SimpleNamespace(key=(k, "X")) for k in ("ripple", "delay", "viscous", "table"))
    search = _Search(None, [], None, None, Settings(), [a, b], [quiet], leavings=[(left, a.key)])
    assert search.beside(a) == [quiet, b]
    assert search.beside(b) == [quiet, left, a]
    assert search.admitted == [quiet, left, a, b]


def test_a_delay_as_long_as_the_span_leaves_nothing():
    t = np.arange(400) * 2e-3
    effort = np.cumsum(np.random.default_rng(7).standard_normal(400))
    motion = SimpleNamespace(t=t, segments=[slice(0, 150), slice(150, 400)])
    late = np.concatenate([np.interp(t[s] - 6e-3, t[s], effort[s]) for s in motion.segments])
    np.testing.assert_allclose(6e-3 * _late(motion, effort, 6e-3), late - effort, atol=1e-12)
    slope = -np.gradient(effort, 2e-3)
    assert np.std(late - effort - 6e-3 * slope) > 0.2 * np.std(late - effort)


@pytest.mark.parametrize(("s", "error", "unknown"), [(0.2, 2.0, True), (2.4, 0.2, False)])
def test_a_twin_that_never_saw_an_effect_does_not_know_its_shape(s, error, unknown):
    effects = (Viscous(axis="X"), Stribeck(axis="X", v_s=1.0), Ripple(axis="Y", period=0.1))
    theta, sd = np.array([3.0, s, 0.5, 0.5]), np.array([9.0, error, 0.1, 0.1])
    twin = SimpleNamespace(effects=effects, theta=theta, covariance=np.diag(sd**2))
    assert (("stribeck", "X") in _unknown(twin)) == unknown
    assert not _unknown(twin) & {("viscous", "X"), ("ripple", "Y")}  # no shape; well known


@pytest.mark.parametrize(
    ("kind", "kept"), [("assumed", ["gravity"]), ("repeats", ["gravity", "ripple_like"])]
)
def test_one_log_without_repeats_needs_more_than_a_healthy_machine_comes_near(kind, kept):
    context, stage = world()
    strong, weak = found(context, "gravity", [1.0]), found(context, "ripple_like", [1.0])
    named = tuple(Named(replace(j, G=gain), (), 20.0) for j, gain in ((strong, 40.0), (weak, 25.0)))
    decision = Decision(named, (), stage, stage, None, (), None, ())
    rows = SimpleNamespace(validation=(False,))
    start = SimpleNamespace(stage=SimpleNamespace(rows=rows, noise=SimpleNamespace(kind=kind)))
    left = beyond_doubt(start, decision)
    assert [n.judged.key[0] for n in left.named] == kept
