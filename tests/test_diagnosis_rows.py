"""Which rows judge a cause, which rows rank its instances, and the servo's law under a load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pinotwin.diagnosis.data.comparison import within
from pinotwin.diagnosis.data.samples import SKIMMED_ROWS, sample
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.search.shortlist import closes
from pinotwin.effects.ripple import Ripple
from pinotwin.effects.sensing import Delay
from tests.one_slide import RATE, SECONDS, motion, rows


@pytest.mark.parametrize(("span", "seconds", "whole"), [(3e-3, 2.9e-3, True), (5e-3, 2.5e-3, False)])
def test_a_delay_moves_all_of_the_effort(span: float, seconds: float, whole: bool) -> None:
    assert Delay("X", span=span).possible(np.array([seconds])) == whole
    assert Delay("X", span=1e-3).possible(np.array([seconds]))


@pytest.mark.parametrize("floor", [0.02, 1.0, 50.0])
def test_what_a_delay_closes_does_not_depend_on_the_unit_of_the_residual(floor: float) -> None:
    """A span was ranked by seconds over the floor: none but the shortest could be a delay."""
    m = replace(motion(), model=motion().u)
    column = Delay("X", span=0.04).columns(m).values[:, 0]
    s = sample(m, 0.04 * column, RULES.block_time)
    residual = {0: s.residual[0] / floor}
    right, short = (closes(s, Delay("X", span=x), residual, {0: floor})[0] for x in (0.04, 0.01))
    few = residual[0][s.skimmed(Delay("X", span=0.04))[1][0]]
    assert right == pytest.approx(float(few @ few), rel=1e-4)
    assert short == 0.0


def test_the_rows_that_are_skimmed_are_rows_of_the_sample() -> None:
    s = rows(np.zeros(int(RATE * SECONDS)))
    ripple = Ripple("X", period=0.3)
    few, at = s.skimmed(ripple)
    assert len(at[0]) <= SKIMMED_ROWS
    assert few[0] == pytest.approx(s.screened(ripple)[0][at[0]], abs=1e-12)


def test_validation_rows_beyond_the_travel_of_the_logs_judge_nothing() -> None:
    zero, wide = np.zeros(int(RATE * SECONDS)), motion(3)
    new, unseen = rows(zero), sample(replace(wide, q=1.5 * wide.q), zero[:, None], RULES.block_time)
    q = unseen.motion.q[unseen.samples(0), 0]
    low, high = (f(new.motion.q[new.samples(0), 0]) for f in (np.min, np.max))
    kept = within(unseen, new)
    left = kept.motion.q[kept.samples(0), 0]
    assert len(left) == len(kept.residual[0]) == len(kept.block[0])
    assert np.count_nonzero((q >= low) & (q <= high)) <= len(left) < len(q)
    assert left.min() > low - 0.05
    assert left.max() < high + 0.05
