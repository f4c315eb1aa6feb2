"""The inspection of a log: every planted fault is found and named, a clean log left in peace."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pinotwin.errors import LogError
from pinotwin.log import Log
from pinotwin.logs.quality import Limits, Quality, inspect, resample
from pinotwin.logs.quality.values import (
    jump_rows,
    lattice,
    quantisation_step,
    repeated_rows,
    saturated_rows,
    sentinel,
    significant_digits,
)

RATE = 500.0
AXES = {"Y": False, "A": True}


def motion(rate: float = RATE, seconds: float = 12.0, lead: float = 0.0) -> dict[str, np.ndarray]:
    """Return the channels of two clean axes: inertia, friction, and efforts ahead by ``lead`` s."""
    n = int(rate * seconds)
    t = np.arange(n) / rate
    rng = np.random.default_rng(0)
    out = {"t": t}
    for name, mass, size in (("Y", 40.0, 0.2), ("A", 0.5, 1.0)):
        f = rng.uniform(0.2, 3.0, 6)
        phase = rng.uniform(0, 2 * np.pi, 6)

        def wave(at: np.ndarray, d: int, f=f, phase=phase, size=size) -> np.ndarray:
            w = 2 * np.pi * f
            return size * np.sum(w**d / f * np.sin(np.outer(at, w) + phase + d * np.pi / 2), axis=1)

        out[f"{name}.q"] = wave(t, 0) + rng.normal(0, 1e-6, n)
        out[f"{name}.qr"] = wave(t, 0)
        v, a = wave(t + lead, 1), wave(t + lead, 2)
        out[f"{name}.u"] = mass * (a + 0.5 * v + 0.3 * np.sign(v)) + rng.normal(0, 0.05 * mass, n)
    return out


def look(channels: dict[str, np.ndarray], **more: object) -> Quality:
    return inspect(Log(channels, "run.csv"), AXES, **more)  # type: ignore[arg-type]


def said(quality: Quality, severity: str = "warning") -> str:
    return "\n".join(str(f) for f in quality.findings if f.severity == severity)


def test_a_clean_log_raises_no_warning() -> None:
    quality = look(motion())
    assert said(quality) == said(quality, "error") == ""
    assert quality.ok
    assert quality.clock is not None
    assert quality.clock.rate == pytest.approx(RATE)
    assert quality.duration == pytest.approx(12.0, abs=0.01)
    assert all(axis.moves for axis in quality.axes.values())
    assert quality.cutoff == pytest.approx(9.35, rel=0.1)
    json.dumps(quality.as_dict(), allow_nan=False)


def test_speed_and_acceleration_reached() -> None:
    t = np.arange(5000) / RATE
    q = 0.3 * np.sin(2 * np.pi * 1.5 * t)
    table = inspect(Log({"t": t, "Y.q": q}), {"Y": False}).axes["Y"]
    assert table.speed == pytest.approx(0.3 * 3 * np.pi, rel=0.01)
    assert table.acceleration == pytest.approx(0.3 * (3 * np.pi) ** 2, rel=0.01)
    assert (table.low, table.high) == pytest.approx((-0.3, 0.3), abs=1e-4)


@pytest.mark.parametrize("lead", [-0.004, -0.0025, 0.0027, 0.006])
def test_a_lead_of_the_effort_is_measured_to_a_fraction_of_a_sample(lead: float) -> None:
    quality = look(motion(lead=lead))
    for axis in quality.axes.values():
        assert axis.lead == pytest.approx(lead, abs=2e-4)
        assert axis.lead_error is not None
        assert axis.lead_error < 2e-4
    how = "leads" if lead > 0 else "lags"
    assert f"warning: Y.u, A.u: effort {how} the position by about {1e3 * abs(lead):.1f} ms" in said(quality)


def test_faults_of_the_clock() -> None:
    channels = motion()
    t = channels["t"].copy()
    t[1000:] += 0.1
    t[2000:] -= 0.05
    t[3000] = t[2999]
    channels["t"] = t
    text = said(look(channels))
    assert "t: the clock runs backward 1 times, first at row 2000; the log is cut there" in text
    assert "t: 1 duplicated time stamps, first at row 3000 (about 500 Hz)" in text
    assert "t: 2 gaps, 51 samples missing at about 500 Hz, the longest 0.102 s, first at row 1000" in text


def test_jitter_and_a_jump_of_the_clock() -> None:
    channels = motion()
    rng = np.random.default_rng(1)
    t = channels["t"] + rng.normal(0, 2e-4, len(channels["t"]))
    t[3000:] += 3600.0
    text = said(look({**channels, "t": t}))
    assert "irregular sampling: interval 2.002 ms, jitter 0.283 ms rms" in text
    assert "(a jump of the clock?)" in text


def test_ten_hertz_is_too_slow_for_inertia() -> None:
    assert "10 Hz is too slow to identify inertia" in said(look(motion(10.0, 200.0)))


def test_a_clock_in_milliseconds() -> None:
    channels = motion()
    for factor, unit in ((1e3, "ms"), (1e6, "us"), (1e9, "ns")):
        quality = look({**channels, "t": factor * channels["t"]})
        assert not quality.ok
        assert f"look like a clock in {unit}: set unit: {unit}" in str(quality.findings[0])


def test_no_clock_and_a_standing_clock_are_errors() -> None:
    channels = motion()
    assert "error: t: the time axis does not advance" in said(
        look({**channels, "t": 0 * channels["t"]}), "error"
    )
    del channels["t"]
    quality = look(channels)
    assert not quality.ok
    assert said(quality, "error").startswith("error: t: no time channel; map its column, or give")


def test_missing_values_and_empty_channels() -> None:
    channels = motion()
    channels["Y.u"][100:103] = np.nan
    channels["A.qr"][:] = np.nan
    quality = look(channels)
    assert "Y.u: 3 values missing, first in row 100; the log is cut there" in said(quality)
    assert "A.qr: holds no number at all; drop it from columns or log it" in said(quality, "error")


def test_an_effort_that_is_not_wired_and_one_that_is_constant() -> None:
    channels = motion()
    channels["Y.u"][:] = 0.0
    channels["A.u"][:] = 4.0
    quality = look(channels)
    assert "Y.u: is always zero: not wired, or not recorded?" in said(quality)
    assert "A.u: is constant at 4" in said(quality, "info")


def test_saturation() -> None:
    channels = motion()
    limit = 0.5 * np.abs(channels["A.u"]).max()
    channels["A.u"] = np.clip(channels["A.u"], -limit, limit)
    quality = look(channels)
    assert quality.channels["A.u"].saturated > 0.02
    assert quality.channels["Y.u"].saturated == 0.0
    assert f"A.u: saturated at {-limit:.4g} or {limit:.4g}" in said(quality)


def test_axes_at_rest_and_axes_without_channels() -> None:
    channels = motion()
    noise = np.random.default_rng(2).normal(0, 1e-4, len(channels["t"]))
    for name in ("Y.q", "Y.qr"):
        channels[name] = noise
    del channels["A.q"], channels["A.qr"]
    quality = look(channels)
    assert "Y: does not move: nothing of it can be identified" in said(quality)
    assert "A: no position A.q; map it under columns in machine.yaml" in said(quality, "error")
    assert "no axis moves; record a motion" in said(quality, "error")
    del channels["Y.u"]
    assert "Y: no effort Y.u" in said(look(channels))


def test_units_that_cannot_be() -> None:
    channels = motion()
    channels["Y.q"] *= 1e3
    channels["A.q"] *= 1e3
    text = said(look(channels))
    assert "Y.q: reaches" in text
    assert "looks like mm, set unit: mm" in text
    assert "looks like deg, set unit: deg" in text
    assert "Y.qr: command and position do not agree" in text


@pytest.mark.parametrize(("frequency", "lasts", "seen"), [(100.0, 0.6, True), (0.5, 12.0, False)])
def test_a_loop_that_swings_between_its_limits(frequency: float, lasts: float, seen: bool) -> None:
    channels = motion()
    t = channels["t"]
    rings = np.where(t < lasts, 20.0, 0.5) * np.sin(2 * np.pi * frequency * t)
    channels["Y.u"] = np.ptp(channels["Y.u"]) * rings
    assert ("Y.u: swings" in said(look(channels))) == seen
    channels["Y.qr"] = channels["Y.qr"] + 1e-3 * rings  # asked for
    assert "Y.u: swings" not in said(look(channels))


def test_a_velocity_in_another_unit() -> None:
    channels = motion()
    channels["A.v"] = np.gradient(channels["A.qr"], 1 / RATE) * 180 / np.pi
    assert "A.v: the position changes 0.0174" in said(look(channels))
    channels["A.v"] *= np.pi / 180
    assert "A.v" not in said(look(channels))


def test_limits() -> None:
    limits = {"Y": Limits(position=(-0.1, 0.1), velocity=0.1, effort=1.0)}
    text = said(look(motion(), limits=limits))
    assert "outside the URDF's limits -0.1 to 0.1" in text
    assert "above the URDF's limit 0.1" in text
    assert "above the URDF's limit 1: check its factor" in text


def test_sentinels_copies_and_the_state_they_share() -> None:
    channels = motion()
    n = len(channels["t"])
    channels["feed"] = np.where(np.arange(n) % 3 == 0, 6.0, 12.0)
    bad = np.concatenate([np.arange(i, i + 60) for i in range(500, 5500, 500)])
    for name in ("Y.q", "Y.qr", "Y.u", "A.q", "A.qr", "A.u"):
        channels[name][bad] = channels[name].max() + 1.0
    channels["feed"][bad] = 50.0
    text = said(look(channels))
    assert "Y.q: jumps to" in text
    assert "and back 10 times: a sentinel value; leave the 600 rows with it out" in text
    assert "600 rows repeat" not in text
    assert "feed: 100 % of the untrustworthy rows have feed = 50; leave all 600 rows" in text


def test_rows_at_rest_may_be_alike() -> None:
    """A second of standstill, rounded as exports are: 7 % of the rows were copies, called a sentinel."""
    rng, channels = np.random.default_rng(0), motion()
    still = slice(0, 500)
    for name, step in (("Y.q", 1e-5), ("A.q", 1.1e-5), ("Y.u", 0.4), ("A.u", 0.004)):
        x = channels[name]
        x[still] = x[500] + step * np.round(0.5 * rng.normal(size=500))
        channels[name] = np.round(x, 6)
    for name in ("Y.qr", "A.qr"):
        channels[name][still] = channels[name][500]
    assert "exact copies" not in said(look(channels))


@pytest.mark.parametrize(("length", "code"), [(60, "sentinel"), (3, "spikes")])
def test_a_few_rows_of_a_sentinel_spoil_no_axis(length: int, code: str) -> None:
    channels = motion()
    beyond = channels["Y.q"].max() + 1.0
    for start in range(500, 5500, 500):
        channels["Y.q"][start : start + length] = beyond
    assert code in {f.code for f in look(channels).findings if f.channel == "Y.q"}


def test_stale_rows() -> None:
    channels = {name: np.repeat(x[::2], 2) for name, x in motion().items()}
    channels["t"] = np.arange(len(channels["Y.q"])) / RATE
    assert "sampled faster than the controller renews its values" in said(look(channels))


def test_lost_values_and_wrap_around() -> None:
    channels = motion()
    channels["Y.q"][[700, 1900]] = 9.0
    turns = 2 * np.pi * 0.3 * channels["t"]
    channels["A.q"] = channels["A.qr"] = np.mod(turns + np.pi, 2 * np.pi) - np.pi
    text = said(look(channels))
    assert "Y.q: stands apart from the rows before and after in 2 rows, first 700" in text
    assert "A.q: wraps around 4 times, first at row 834; give columns.A.q the counter's range" in text
    assert "`wrap: 6.283185307`, in machine.yaml: then it is unwrapped" in text


def test_a_counter_that_wraps_is_told_by_its_range_however_rounded() -> None:
    turns = (
        53.4 * np.arange(4000) / 50.0 + 1800.0
    )  # [rev] at 53.4 rev/s, a counter of 2^32 millionths of a turn
    channels = {"t": np.arange(4000) / 50.0, "S.u": np.sin(turns), "S.q": turns}
    half = 2.0**31 * 1e-6
    wrapped = np.mod(turns + half, 2 * half) - half
    channels["S.q"] = np.array([float(f"{x:.3g}") for x in wrapped])
    found = inspect(Log(channels), {"S": True}, {"S": Limits(velocity=10.0)})
    text = said(found)
    assert "S.q: wraps around 1 times, first at row 326; give columns.S.q the counter's range" in text
    assert "`wrap: 4294.967296`" in text
    assert "above the URDF's limit" not in text  # the wraps are why


def test_a_position_that_leaps_is_told_from_one_that_moves_fast_and_from_a_gap_of_the_clock() -> None:
    channels = motion()
    fast = said(look(channels))
    assert "leaps" not in fast
    late = {name: x.copy() for name, x in channels.items()}
    rows = np.arange(200, 1800, 400) + 30
    for row in rows:
        late["Y.q"][row:] += 3.0
        late["Y.qr"][row:] += 3.0
    assert "Y.q: leaps in" in said(look(late))
    for row in rows:
        late["t"][row:] += 3.0
    assert "leaps" not in said(look(late))


def test_coarse_resolution() -> None:
    channels = motion()
    channels["Y.q"] = np.round(channels["Y.q"], 2)
    quality = look(channels)
    assert quality.channels["Y.q"].step == pytest.approx(0.01)
    assert "Y.q: resolves 0.01: only" in said(quality)


def test_the_significant_digits_of_the_file_survive_the_conversion() -> None:
    channels = motion()
    degrees = np.degrees(channels["A.q"])
    channels["A.q"] = np.radians([float(f"{x:.3g}") for x in degrees])
    log = Log(channels, scale={"A.q": (np.pi / 180, 0.0)})
    quality = inspect(log, AXES)
    assert quality.channels["A.q"].digits == 3
    assert "A.q: numbers have 3 significant digits" in said(quality)


@settings(max_examples=40, deadline=None)
@given(step=st.floats(1e-9, 10.0), offset=st.floats(-1.0, 1.0), seed=st.integers(0, 10**6))
def test_quantisation_step_is_found(step: float, offset: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    counts = np.round(3000 * np.sin(np.linspace(0, 9, 4000)) + rng.normal(0, 3, 4000))
    found = quantisation_step(counts * step + offset * step)
    assert found == pytest.approx(step, rel=1e-6)


@pytest.mark.parametrize(("step", "origin"), [(1e-7, 0.0), (2.0 * np.pi / 2**20, 0.3), (2.5e-5, -1.7)])
def test_a_lattice_holds_over_the_whole_travel(step: float, origin: float) -> None:
    t = np.arange(6000) / 500.0
    x = 0.3 * np.sin(2.0 * np.pi * 0.2 * t) + 1e-3 * np.sin(2.0 * np.pi * 3.0 * t)
    x[:1500] = 100.0 * step * np.sin(20.0 * t[:1500])  # it also stands, or nearly
    x = np.round((origin + step * np.round((x - origin) / step)) * 1e10) / 1e10
    found = lattice(x)
    assert found is not None
    assert found[0] == pytest.approx(step, rel=1e-6)
    rows = (x - found[1]) / found[0]
    assert np.abs(rows - np.round(rows)).max() < 0.1
    assert lattice(x + 0.3 * step * np.random.default_rng(0).normal(size=len(x))) is None


def test_no_step_in_continuous_values_and_too_few() -> None:
    rng = np.random.default_rng(3)
    assert quantisation_step(rng.normal(size=20_000)) is None
    assert quantisation_step(np.sin(np.arange(5000.0))) is None
    assert quantisation_step(np.array([1.0, 2.0, np.nan])) is None


@pytest.mark.parametrize("digits", [2, 3, 4, 5, 6])
def test_significant_digits_are_found(digits: int) -> None:
    x = np.random.default_rng(4).normal(0, 50.0, 20_000)
    assert significant_digits(np.array([float(f"{v:.{digits}g}") for v in x])) == digits


def test_fixed_decimals_and_full_precision_are_no_rounding_to_digits() -> None:
    x = np.random.default_rng(5).normal(0, 50.0, 20_000)
    assert significant_digits(np.round(x, 1)) is None
    assert significant_digits(x) is None
    assert significant_digits(np.round(x)) is None


def test_saturation_is_no_peak_of_a_sine_and_no_coarse_signal() -> None:
    t = np.linspace(0, 20, 20_000)
    assert not saturated_rows(np.sin(t)).any()
    assert not saturated_rows(np.round(20 * np.sin(t) * np.sin(0.31 * t))).any()
    clipped = np.minimum(np.sin(t), 0.9)
    assert saturated_rows(clipped).sum() == (clipped == 0.9).sum()


def test_rows_apart() -> None:
    q = np.sin(np.linspace(0, 6, 1000))
    assert not jump_rows(q).any()
    q[400] = 5.0
    assert np.flatnonzero(jump_rows(q)).tolist() == [400]
    assert sentinel(q) is None


def test_repeated_rows() -> None:
    x = np.array([[1.0, 2], [3, 4], [3, 4], [5, 6], [1, 2]])
    copies, stale = repeated_rows(x)
    assert copies.tolist() == [True, True, True, False, True]
    assert stale.tolist() == [False, False, True, False, False]


def test_resampling_is_said_and_keeps_holes() -> None:
    rng = np.random.default_rng(6)
    t = np.cumsum(rng.uniform(0.001, 0.003, 2000))
    t[1000:] += 1.0
    q = np.sin(t)
    q[500] = np.nan
    log = resample(Log({"t": t, "q": q}, "usb.npy", notes=("old",)), 400.0)
    good = np.isfinite(log["q"])
    np.testing.assert_allclose(log["q"][good], np.sin(log.t[good]), atol=2e-6)
    assert (~good).sum() == 2  # on either side of the one that is missing
    assert log.t[~good].min() > t[499] - 1e-9
    gaps = np.diff(log.t)
    assert np.sum(gaps > 0.0026) == 1
    assert not np.any((log.t > t[999] + 0.0025) & (log.t < t[1000] - 1e-9))
    assert log.notes[0] == "old"
    assert log.notes[1].startswith("resampled from about 494.8 Hz (jitter 0.571 ms rms)")
    assert " to 400 Hz by linear interpolation: 2000 rows became" in log.notes[1]
    assert log.notes[2].startswith("the new rate is lower")


def test_resampling_drops_duplicates_and_says_so() -> None:
    t = np.r_[0.0, 0.1, 0.1, 0.2, 0.3]
    log = resample(Log({"t": t, "q": [0.0, 1.0, 9.0, 2.0, 3.0]}), 10.0)
    np.testing.assert_allclose(log["q"], [0, 1, 2, 3], atol=1e-12)
    assert log.notes[1] == "1 rows with a duplicated or missing stamp were left out"


def test_resampling_what_cannot_be() -> None:
    with pytest.raises(LogError, match=r"x: resample to 0 Hz: the rate must be above 0"):
        resample(Log({"t": [0, 1]}, "x"), 0)
    with pytest.raises(LogError, match=r"x: has no t; map it"):
        resample(Log({"q": [0, 1]}, "x"), 10.0)
    with pytest.raises(LogError, match=r"x: the time axis does not advance"):
        resample(Log({"t": [0, 0]}, "x"), 10.0)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(2, 120))
def test_the_inspection_of_rubbish_never_breaks(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.choice([0.0, 0.01, 0.01, 0.01, -1.0, 5.0, np.nan], size=n)
    channels = {"t": np.cumsum(np.nan_to_num(steps)) if seed % 2 else np.arange(n) * 0.01}
    for name in ("Y.q", "Y.u", "Y.qr", "Y.v", "A.q", "A.u", "state"):
        kind = rng.integers(5)
        x = [
            rng.normal(size=n),
            np.zeros(n),
            np.full(n, np.nan),
            rng.integers(0, 3, n) * 1.0,
            np.where(rng.random(n) < 0.3, np.nan, rng.normal(size=n).cumsum()),
        ][kind]
        if rng.random() < 0.8:
            channels[name] = x
    quality = look(channels)
    assert all("\n" not in f.message for f in quality.findings)
    json.dumps(quality.as_dict(), allow_nan=False)
