"""The number of poles chosen from held-out blocks."""

from __future__ import annotations

import numpy as np
import pytest

from pinotwin.errors import InputError
from pinotwin.loop import LoopData, Structure, select_order
from tests.loop_axes import ball_screw, cascade, record

STEP = 1e-3
FEW = Structure(feedforward_poles=(400.0, 400.0))


def log(truth, level, seconds=5.0):
    qr, vr, ar, d, y = record(truth, 2, seconds, fine=5)
    noise = level * y.std(axis=0) * np.random.default_rng(0).standard_normal(y.shape)
    return LoopData(STEP, qr, d, y + noise, vr=vr, ar=ar)


def test_a_vibratory_mode_pays_for_its_pair():
    choice = select_order(log(ball_screw(), 0.02), FEW, folds=4)
    chosen = choice.trials[choice.chosen].structure
    assert chosen.pole_pairs == 2
    assert any(abs(wn / (2 * np.pi) - 35.0) < 15.0 for wn, _ in choice.model.pole_pairs)


def test_a_rigid_axis_does_not_pay_for_one():
    choice = select_order(log(cascade(ff=400.0), 0.02), FEW, folds=4)
    assert choice.trials[choice.chosen].structure.pole_pairs == 1
    errors = [t.nrmse for t in choice.trials]
    assert errors[choice.best] == min(errors)
    assert [t.structure.order for t in choice.trials] == sorted(t.structure.order for t in choice.trials)


def test_candidates_and_folds_are_checked():
    data = log(cascade(), 0.02, 2.0)
    with pytest.raises(InputError, match="at least 2 folds"):
        select_order(data, folds=1)
    choice = select_order(data, candidates=[FEW], folds=2)
    assert choice.chosen == choice.best == 0
