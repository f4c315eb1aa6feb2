"""The search for ripple orders: on real cogging maps, on noise alone, on known orders."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from benchmarks._ripple_orders import false_alarm, ratio_at, ripple_orders
from pinotwin.errors import DataError


def cogging(data_dir: Path, which: str) -> tuple[np.ndarray, np.ndarray]:
    path = data_dir / "odrive_cogging" / f"coggingmap_0_cogging_measure_final_{which}_16.npy"
    current = np.load(path)
    counts = np.flatnonzero(current)  # 0 means that the count was not visited
    return 2 * np.pi * counts / 8192, current[counts]


def test_cogging_map_a_names_the_orders_and_predicts_map_b(data_dir: Path) -> None:
    """7 pole pairs, 12 slots: 7, 14, 28 from the magnets, 12, 36 from the slots, 84 their lcm."""
    found = ripple_orders(*cogging(data_dir, "a"))
    assert found.orders[:6].tolist() == [7, 28, 14, 36, 12, 84]
    np.testing.assert_allclose(found.amplitude[:6], [0.86, 0.56, 0.35, 0.29, 0.26, 0.11], atol=0.015)
    report = found.compare(*cogging(data_dir, "b"))
    assert report["correlation"] > 0.995
    assert report["nrmse_std"] < 0.09
    assert np.all(found.chance < 0.01)


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_noise_alone_names_no_order(colour: float) -> None:
    rng = np.random.default_rng(7)
    q = np.arange(512) * (2 * np.pi / 512)
    named = 0
    for _ in range(40):
        u = lfilter([1.0], [1.0, -colour], rng.normal(size=700))[188:]
        named += len(ripple_orders(q, u).orders) > 0
    # At a chance of 1 % each, 5 or more of 40 happen once in 20 000.
    assert named < 5


def test_false_alarm_formula_against_simulation() -> None:
    rng = np.random.default_rng(2)
    median = np.sort(rng.exponential(size=(200_000, 24)), axis=1)[:, 11]
    exceeded = np.mean(rng.exponential(size=200_000) > 6.0 * median)
    assert false_alarm(np.array([6.0]))[0] == pytest.approx(exceeded, rel=0.05)
    assert false_alarm(np.array([ratio_at(1e-5)]))[0] == pytest.approx(1e-5)


def test_known_orders_are_found_in_an_irregular_log() -> None:
    rng = np.random.default_rng(3)
    q = np.cumsum(rng.uniform(0.0, 2e-3, 20_000))  # more rows than are kept unbinned
    u = 0.4 + 1.0 * np.cos(7 * q - 0.5) + 0.3 * np.sin(36 * q) + 0.3 * rng.normal(size=len(q))
    found = ripple_orders(q, u)
    assert found.orders.tolist() == [7, 36]
    np.testing.assert_allclose(found.amplitude, [1.0, 0.3], atol=0.02)
    assert found.phase[0] == pytest.approx(0.5, abs=0.03)
    assert found.mean == pytest.approx(0.4, abs=0.02)
    assert found.travel == pytest.approx(np.ptp(q) / (2 * np.pi))


def test_linear_axis_gives_pitches_that_are_not_whole() -> None:
    rng = np.random.default_rng(5)
    q = np.sort(rng.uniform(-0.3, 0.3, 3000))
    u = 2.0 * np.cos(2 * np.pi * q / 0.0242) + rng.normal(size=len(q))
    found = ripple_orders(q, u, rotary=False)
    assert 1 / found.orders[0] == pytest.approx(0.0242, rel=2e-3)
    assert found.amplitude[0] == pytest.approx(2.0, rel=0.05)


def test_less_than_a_revolution_is_refused() -> None:
    q = np.linspace(0, 5.0, 500)
    with pytest.raises(DataError, match=r"need a full revolution; these data cover 0\.80 of one"):
        ripple_orders(q, np.sin(7 * q))
    with pytest.raises(DataError, match="record more positions"):
        ripple_orders(np.linspace(0, 6.3, 40), np.ones(40))
