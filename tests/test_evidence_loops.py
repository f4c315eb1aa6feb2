"""The figures of closed loops are counted from the answers of the public script."""

from __future__ import annotations

import pytest

from benchmarks.evidence.loops import figures_of


def test_a_machine_that_fails_is_counted_and_is_no_error() -> None:
    rows = [{"mean": m, "mean_moving": 0.9 * m} for m in (0.01, 0.02, 0.06)]
    failed, whole, moving = figures_of([*rows, {"failed": "identify"}])
    assert (failed.value, failed.of) == (1.0, 4)
    assert (whole.value, whole.low, whole.high) == pytest.approx((2.0, 1.0, 6.0))
    assert moving.value == pytest.approx(1.8)
    assert {f.kind for f in (whole, moving)} == {"unseen"}
