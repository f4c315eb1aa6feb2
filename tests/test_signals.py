"""Signals: closed forms, MATLAB's conventions, and scipy as oracles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal as scipy_signal

from pinotwin.errors import DataError
from pinotwin.signals import (
    autocorrelation,
    burg,
    clock,
    decimate_zero_phase,
    derivatives,
    differentiate,
    edge_samples,
    interior,
    lagrange_error,
    low_pass,
    segments,
    spectra,
    suggest_cutoff,
    uniform,
    welch,
)


def test_low_pass_is_matlabs_filtfilt() -> None:
    # MATLAB extends by 3 * (length of b - 1) samples; scipy takes the same when told so.
    x = np.random.default_rng(0).normal(size=(400, 3)).cumsum(axis=0)
    for order, cutoff in ((2, 20.0), (4, 100.0), (5, 60.0)):
        b, a = scipy_signal.butter(order, cutoff, fs=1000.0)
        expected = scipy_signal.filtfilt(b, a, x, axis=0, padlen=3 * order)
        np.testing.assert_allclose(low_pass(x, 1000.0, cutoff, order), expected, atol=1e-8)


@pytest.mark.parametrize("shape", [(60,), (400, 3)])
def test_the_filter_that_is_designed_once_gives_what_scipys_gives_to_the_last_bit(
    shape: tuple[int, ...],
) -> None:
    x = np.random.default_rng(1).normal(size=shape).cumsum(axis=0)
    for order, cutoff in ((4, 24.0), (2, 3.0), (4, 24.0)):
        sos = scipy_signal.butter(order, cutoff, fs=200.0, output="sos")
        expected = scipy_signal.sosfiltfilt(sos, x, axis=0, padlen=3 * order)
        np.testing.assert_array_equal(low_pass(x, 200.0, cutoff, order), expected)


@pytest.mark.parametrize("f", [2.0, 40.0, 100.0, 200.0])
def test_low_pass_has_no_phase_and_the_gain_of_both_ways(f: float) -> None:
    t = np.arange(4000) / 1000.0
    x = np.sin(2 * np.pi * f * t)
    y = low_pass(x, 1000.0, 100.0)[1000:3000]
    # Bilinear Butterworth: |H|^2 = 1 / (1 + (tan(pi f / fs) / tan(pi fc / fs))^(2 n)).
    ratio = np.tan(np.pi * f / 1000.0) / np.tan(np.pi * 100.0 / 1000.0)
    np.testing.assert_allclose(y, x[1000:3000] / (1.0 + ratio**8), atol=1e-6)


def test_low_pass_keeps_its_digits_at_a_very_low_corner() -> None:
    # At corner / rate = 1e-4 the polynomial form of order 6 is off by whole numbers.
    x = np.full(40_000, 2.0)
    np.testing.assert_allclose(low_pass(x, 5000.0, 0.5, 6), x, rtol=1e-6)


def test_segments_are_filtered_apart() -> None:
    x = np.random.default_rng(1).normal(size=(300, 2))
    parts = (slice(0, 120), slice(120, 300))
    whole = low_pass(x, 100.0, 10.0, segments=parts)
    for part in parts:
        np.testing.assert_array_equal(whole[part], low_pass(x[part], 100.0, 10.0))
    slope = differentiate(x, 0.01, parts)
    np.testing.assert_array_equal(slope[119], (x[119] - x[118]) / 0.01)


def test_no_corner_changes_nothing() -> None:
    x = np.random.default_rng(2).normal(size=100)
    for cutoff in (np.inf, 50.0, 80.0):
        np.testing.assert_array_equal(low_pass(x, 100.0, cutoff), x)


def test_bad_filters_are_refused() -> None:
    with pytest.raises(DataError, match=r"corner -1\.0 Hz and order 4 must be above 0"):
        low_pass(np.zeros(50), 100.0, -1.0)
    with pytest.raises(DataError, match=r"stretch of 10 samples is too short .* needs 13"):
        low_pass(np.zeros(10), 100.0, 10.0)
    with pytest.raises(DataError, match="decimation by 0"):
        decimate_zero_phase(np.zeros(100), 0)
    with pytest.raises(DataError, match="one sample has no derivative"):
        differentiate(np.zeros(1), 1.0)


@settings(max_examples=25, deadline=None)
@given(c=st.lists(st.floats(-5, 5), min_size=3, max_size=3), rate=st.floats(10, 5000))
def test_central_differences_are_exact_on_a_parabola(c: list[float], rate: float) -> None:
    t = np.arange(60) / rate
    q, v, a = derivatives(c[0] + c[1] * t + c[2] * t**2, rate)
    scale = 1e-9 * rate**2
    np.testing.assert_allclose(v[1:-1], (c[1] + 2 * c[2] * t)[1:-1], atol=scale)
    np.testing.assert_allclose(a[2:-2], 2 * c[2], atol=scale)
    assert q.shape == v.shape == a.shape


@pytest.mark.parametrize(("n", "factor"), [(24792, 10), (1000, 7), (501, 4), (96, 2)])
def test_decimate_is_matlabs(n: int, factor: int) -> None:
    # MATLAB: filtfilt(cheby1(8, .05, .8/r)), then y(nbeg:r:end), nbeg = r - (r*ceil(n/r) - n).
    x = np.random.default_rng(3).normal(size=n).cumsum()
    b, a = scipy_signal.cheby1(8, 0.05, 0.8 / factor)
    first = factor - (factor * -(-n // factor) - n)
    filtered = scipy_signal.filtfilt(b, a, x, padlen=24)
    expected = filtered[first - 1 :: factor]
    got = decimate_zero_phase(x, factor)
    assert len(got) == -(-n // factor)
    np.testing.assert_allclose(got, expected, rtol=1e-4, atol=1e-4 * np.abs(x).max())


def test_decimate_stretch_by_stretch() -> None:
    x = np.random.default_rng(4).normal(size=(500, 2))
    parts = (slice(0, 200), slice(210, 500))
    got = decimate_zero_phase(x, 5, parts)
    expected = np.concatenate([decimate_zero_phase(x[p], 5) for p in parts])
    np.testing.assert_array_equal(got, expected)
    np.testing.assert_array_equal(decimate_zero_phase(x, 1, parts), np.delete(x, np.s_[200:210], 0))


@pytest.mark.parametrize(
    ("cutoff", "order"), [(5.0, 2), (20.0, 4), (60.0, 4), (20.0, 6), (404.0, 4), (460.0, 4)]
)
def test_edge_samples_cover_the_start_up(cutoff: float, order: int) -> None:
    # A step is the start-up at its worst: beyond the count less than 2 % of it is left.
    x = np.r_[np.zeros(1000), np.ones(1000)]
    sos = scipy_signal.butter(order, cutoff, fs=1000.0, output="sos")
    once = scipy_signal.sosfilt(sos, x)
    count = edge_samples(cutoff, 1000.0, order)
    assert np.abs(once[1000 + count :] - 1.0).max() < 0.02
    assert count < 1000
    assert edge_samples(np.inf, 1000.0) == 2


def test_interior_cuts_every_stretch() -> None:
    keep = interior(20, 2, (slice(0, 8), slice(10, 13)))
    assert np.flatnonzero(keep).tolist() == [2, 3, 4, 5]


def test_clock_and_segments() -> None:
    t = np.arange(100) * 0.01
    t[50:] += 0.05  # 5 samples lost
    t[80] = t[79]
    c = clock(t)
    assert c.rate == pytest.approx(100.0)
    assert c.gaps == (50, 81)
    assert c.missing == 6
    assert c.longest == pytest.approx(0.06)
    assert c.duplicated == (80,)
    assert segments(t) == (slice(0, 50), slice(50, 80), slice(80, 81), slice(81, 100))
    valid = np.ones(100, dtype=bool)
    valid[10] = False
    assert segments(t, valid=valid)[:2] == (slice(0, 10), slice(11, 50))
    with pytest.raises(DataError, match="does not advance"):
        clock(np.zeros(5))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_segments_are_uniform_disjoint_and_complete(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.choice([1.0, 1.0, 1.0, 1.0, 3.0, 0.0, -2.0], size=60))
    parts = segments(t)
    covered = np.concatenate([np.arange(s.start, s.stop) for s in parts])
    np.testing.assert_array_equal(covered, np.arange(60))
    step = clock(t).step
    for part in parts:
        assert np.all(np.abs(np.diff(t[part]) - step) <= 0.5 * step)


def test_uniform_makes_nothing_up_between_stretches() -> None:
    t = np.r_[0.0, 1.0, 2.0, 10.0, 11.0]
    grid, x, parts = uniform(t, np.column_stack([2 * t, t**0]), 2.0, (slice(0, 3), slice(3, 5)))
    np.testing.assert_allclose(grid, [0, 0.5, 1, 1.5, 2, 10, 10.5, 11])
    np.testing.assert_allclose(x[:, 0], 2 * grid)
    assert parts == (slice(0, 5), slice(5, 8))


def test_welch_keeps_the_power() -> None:
    rng = np.random.default_rng(5)
    x = np.column_stack([rng.normal(0, 2.0, 50_000), rng.normal(0, 0.5, 50_000)])
    spectrum = welch(x, 200.0, [slice(0, 20_000), slice(20_000, 50_000)])
    power = spectrum.density.sum(axis=0) * spectrum.f[1]
    np.testing.assert_allclose(power, [4.0, 0.25], rtol=0.03)
    with pytest.raises(DataError, match="has 5 samples; a spectrum needs 16"):
        welch(np.zeros(5), 1.0)


def _ar(a: np.ndarray, n: int, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=n + 500)
    return scipy_signal.lfilter([1.0], a, noise)[500:]


def test_autocorrelation_of_an_ar1() -> None:
    r = autocorrelation(_ar(np.array([1.0, -0.8]), 200_000, 6), 10)
    np.testing.assert_allclose(r, 0.8 ** np.arange(11), atol=0.02)
    with pytest.raises(DataError, match="needs a longer signal"):
        autocorrelation(np.ones(50), 10)


def test_an_autoregression_is_found_and_its_filter_whitens() -> None:
    true = np.poly([0.9 * np.exp(0.5j), 0.9 * np.exp(-0.5j), -0.4]).real
    x = _ar(true, 100_000, 7)
    a, variance = burg([x[:40_000], x[40_000:]], 3)
    np.testing.assert_allclose(-a, true[1:], atol=0.01)
    assert variance == pytest.approx(1.0, rel=0.02)
    e = scipy_signal.lfilter([1.0, *-a], [1.0], x)[3:]
    assert np.abs(autocorrelation(e, 20)[1:]).max() < 4 / np.sqrt(len(e))


def test_an_autoregression_is_stable_even_on_a_sine_and_on_nothing() -> None:
    a, _ = burg([np.sin(0.3 * np.arange(200))], 8)
    assert np.abs(np.roots([1.0, *-a])).max() < 1.0 + 1e-5  # rounding of roots
    a, variance = burg([np.zeros(50)], 2)
    assert (len(a), variance) == (0, 0.0)
    assert len(burg([np.random.default_rng(0).standard_normal(50)], 30)[0]) < 30


def _swept(rate: float, top: float, seed: int, step: float) -> np.ndarray:
    """Return a position whose acceleration has components up to ``top`` Hz, quantised."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(30 * rate)) / rate
    f = np.linspace(0.3, top, 25)
    phase = rng.uniform(0, 2 * np.pi, 25)
    q = (np.sin(2 * np.pi * np.outer(t, f) + phase) / (2 * np.pi * f) ** 2).sum(axis=1)
    return np.round(q / step) * step


@pytest.mark.parametrize("top", [5.0, 12.0, 30.0])
def test_the_corner_lies_above_the_motion_and_below_the_noise(top: float) -> None:
    rate, step = 1000.0, 2e-6
    corner = suggest_cutoff(_swept(rate, top, 8, step), rate)
    assert top <= corner
    # Noise let through, from the quantisation: step^2/12 spread over the band, times the gain.
    noise = step**2 / 12 / (rate / 2) * (2 * np.pi) ** 4 * corner**5 / 5
    assert noise < 0.05 * 25 / 2


def test_the_corner_ignores_axes_at_rest_and_mains_lines() -> None:
    rate = 1000.0
    moving = _swept(rate, 10.0, 9, 2e-6)
    alone = suggest_cutoff(moving, rate)
    rest = np.random.default_rng(10).normal(0, 1e-6, len(moving))
    assert suggest_cutoff(np.column_stack([moving, rest]), rate) == pytest.approx(alone, rel=0.2)
    hum = 3e-6 * np.sin(2 * np.pi * 300.0 * np.arange(len(moving)) / rate)
    assert suggest_cutoff(moving + hum, rate) < 2.0 * alone


def test_motion_up_to_nyquist_and_no_motion_need_no_filter() -> None:
    rng = np.random.default_rng(11)
    assert suggest_cutoff(rng.normal(size=3000).cumsum().cumsum(), 50.0) == np.inf
    assert suggest_cutoff(np.zeros((500, 2)), 50.0) == np.inf
    assert suggest_cutoff(rng.normal(size=3000), 50.0) == np.inf
    assert suggest_cutoff(np.zeros(10), 50.0) == np.inf


def test_the_trend_of_a_window_is_its_least_squares_line() -> None:
    x = np.cumsum(np.random.default_rng(0).normal(size=(20000, 3)), axis=0)
    _, expected = scipy_signal.welch(x, fs=500.0, nperseg=2500, detrend="linear", axis=0)
    np.testing.assert_allclose(spectra.welch(x, 500.0).density, expected, rtol=1e-10)


def test_few_lags_are_those_of_many() -> None:
    x = np.cumsum(np.random.default_rng(1).normal(size=5000))
    few = spectra.autocorrelation(x, 8)
    np.testing.assert_allclose(few, spectra.autocorrelation(x, 100)[: len(few)], atol=1e-12)


def test_the_cubic_through_its_neighbours_misses_a_fourth_power_by_its_known_error() -> None:
    t = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 30))
    found = lagrange_error(t, np.stack([t**3 - 2 * t, t**4], axis=1))
    product = np.prod([t[2:-2] - t[k : 26 + k] for k in (0, 1, 3, 4)], axis=0)
    np.testing.assert_allclose(found, np.stack([0 * product, product], axis=1), atol=1e-6)
