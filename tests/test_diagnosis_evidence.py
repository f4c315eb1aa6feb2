"""Held-out evidence against dense Gaussians, thresholds per axis, and what a found effect leaves over."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pinotwin.diagnosis.calibration import Calibration
from pinotwin.diagnosis.decide import Named
from pinotwin.diagnosis.findings import _options
from pinotwin.diagnosis.ledger import build_ledger, sums
from pinotwin.diagnosis.search import Screened
from pinotwin.diagnosis.stage import Piece, Stage
from pinotwin.diagnosis.trivial import _leaves
from pinotwin.diagnosis.worth import worth

ROWS, FOLDS = 60, 3


@pytest.fixture
def made():
    """Return base columns, a candidate, an effort and folds of made-up whitened rows."""
    rng = np.random.default_rng(5)
    B, C = rng.standard_normal((ROWS, 4)), rng.standard_normal((ROWS, 3))
    fold = np.repeat(np.arange(FOLDS), ROWS // FOLDS)
    C[fold == 1, 2] = 0.0  # a knot that one block never visits, and ...
    C[fold != 1, 1] *= 1e-9  # ... one that only this block does
    y = B @ [1.0, -2.0, 0.5, 0.0] + C @ [0.7, 1.0, -0.4] + rng.standard_normal(ROWS)
    return B, C, y, fold


def stage(B, y, fold, precision):
    base = SimpleNamespace(count=B.shape[1], precision=precision, change=False)
    where = SimpleNamespace(log=0, joint=0)
    piece = Piece(where, np.arange(ROWS), fold, np.arange(B.shape[1]), B, y)
    return Stage(None, base, None, (piece,), FOLDS)


def deviance(y, V, seen):
    """Return -2 log p of the rows that are not seen, given those that are."""

    def whole(rows):
        W = V[np.ix_(rows, rows)]
        return y[rows] @ np.linalg.solve(W, y[rows]) + np.linalg.slogdet(W)[1]

    every = np.ones(len(y), dtype=bool)
    return whole(every) - whole(seen)


@pytest.mark.parametrize("ridge", [0.02, 0.3])
def test_the_gain_is_the_predictive_deviance_of_dense_gaussians(made, ridge):
    B, C, y, fold = made
    precision = np.diag([0.1, 0.2, 0.3, 0.4])
    ledger = build_ledger(stage(B, y, fold, precision))
    found = worth(ledger, sums(ledger, [C[:, None, :]]), ridge)
    level = ridge * np.mean(np.sum(C**2, axis=0))
    without = np.eye(ROWS) + B @ np.linalg.inv(precision) @ B.T
    with_it = without + C @ C.T / level
    expected = sum(deviance(y, without, fold != f) - deviance(y, with_it, fold != f) for f in range(FOLDS))
    assert found.G[0, 0] == pytest.approx(expected, rel=1e-4)


def test_a_block_that_no_other_foretells_costs_little_once_coefficients_are_held(made):
    B, C, y, fold = made
    ledger = build_ledger(stage(B, y, fold, 0.1 * np.eye(4)))
    free, held = (worth(ledger, sums(ledger, [C[:, None, :]]), r).G[0, 0] for r in (0.0, 0.02))
    assert held > free


def screened(tops, keys):
    return Screened((), keys, np.asarray(tops))


def test_what_one_axis_leaves_open_does_not_hide_the_effect_of_another():
    rng = np.random.default_rng(1)
    quiet, loud = rng.gumbel(5.0, 2.0, 4000), rng.gumbel(900.0, 100.0, 4000)
    found = screened([quiet, loud], (("delay", "X"), ("backlash", "Y"))).thresholds(0.02)
    assert found["X"] == pytest.approx(5.0 - 2.0 * np.log(-np.log(0.99)), rel=0.05)
    assert found["Y"] > 1000.0
    assert screened([quiet, loud], (("delay", "X"), ("backlash", "Y"))).threshold(0.02) > 1000.0


def named(effect, axis, *joints):
    columns = [[(j, None) for j in joints]]
    candidate = SimpleNamespace(effect=effect, axis=axis, columns=columns)
    return SimpleNamespace(candidate=candidate, joints=set(joints))


def test_a_ripple_leaves_more_to_its_like_than_to_friction_or_to_other_axes():
    ripple = named("ripple", "X", 0)
    like = _leaves(ripple, named("encoder_error", "X", 0))
    other = _leaves(ripple, named("viscous", "X", 0))
    apart = _leaves(ripple, named("viscous", "Y", 1))
    wide = _leaves(named("payload", "X", 0, 1), named("viscous", "Y", 1))
    assert like > other > apart
    assert wide > apart


def judged(effect, G, axis="X"):
    candidate = SimpleNamespace(effect=effect, axis=axis)
    return SimpleNamespace(G=G, candidate=candidate, key=(effect, axis))


def test_an_answer_that_leaves_part_of_the_gap_open_shares_with_close_rivals_and_the_unknown():
    known = Calibration(0.01, np.zeros(0), np.zeros(0), {})
    answer, close, far = (
        judged("backlash", 900.0),
        judged("drive_flexibility", 420.0),
        judged("delay", 90.0),
    )
    named = Named(answer, (close, far), 20.0)
    whole, part = (_options(named, known, partial=p) for p in (False, True))
    for options in (whole, part):
        assert sum(p for _, p in options) == pytest.approx(1.0)
        assert options[0][0] is answer
    share = {x if isinstance(x, str) else x.key[0]: p for x, p in part}
    assert whole[0][1] > part[0][1]
    assert share["unknown"] > share["drive_flexibility"] > 10.0 * share["delay"]
