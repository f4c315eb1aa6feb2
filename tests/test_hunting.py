"""A loop that swings about a standing command is named; an axis that only trembles does not move."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.logs.quality import Finding
from pinotwin.logs.quality.inspection import inspect

SHARED = Path(__file__).resolve().parents[2] / "shared" / "cases" / "drives" / "hunting"


def hunts(t: np.ndarray, shake: np.ndarray) -> list[Finding]:
    """Return what is said of an axis that stands from 5 s on and is shaken by so much there, beside another one."""
    noise = np.random.default_rng(0).standard_normal((2, len(t)))
    command = np.where(t < 5.0, 0.3 * np.sin(2.0 * np.pi * t / 5.0), 0.0)
    other = 0.5 * np.sin(2.0 * np.pi * 0.4 * t)
    q = np.round((command + np.where(t < 5.0, 0.0, shake) + 1e-5 * noise[0]) / 1e-5) * 1e-5
    channels = {"A.qr": command, "A.q": q, "B.qr": other, "B.q": other + 1e-5 * noise[1]}
    return [
        f
        for f in inspect(pt.Log({"t": t, **channels}), {"A": True, "B": True}).findings
        if f.code == "loop_hunts"
    ]


def test_a_wave_that_stays_is_hunting_and_what_dies_away_or_comes_from_another_axis_is_not() -> None:
    t = np.arange(10_000) / 500.0
    wave = 3e-3 * np.sin(2.0 * np.pi * 6.0 * t)
    (found,) = hunts(t, wave)
    assert "3 mrad either way at 6.02 Hz" in found.message
    assert "from 5.002 to 20 s" in found.message
    assert not hunts(t, wave * np.exp(5.0 - t))
    assert not hunts(t, 3e-3 * np.sin(2.0 * np.pi * 0.4 * t))
    assert not hunts(t, np.zeros_like(t))


@pytest.mark.skipif(not SHARED.exists(), reason="no shared cases here")
def test_the_shared_log_is_named() -> None:
    found = [f for f in pt.check(SHARED, SHARED / "l.csv").findings if f.code == "loop_hunts"]
    assert [f.channel for f in found] == ["M.q"]
    assert "30 mrad either way at 6.06 Hz" in found[0].message


def test_an_axis_that_only_trembles_does_not_move() -> None:
    t = np.arange(5000) / 500.0
    q = np.round(26e-5 * np.sin(3.0 * t) / 2.0 / 1e-5) * 1e-5
    channels = {"t": t, "A.q": q, "B.q": np.sin(t)}
    quality = inspect(pt.Log(channels), {"A": True, "B": True})
    assert {name: axis.moves for name, axis in quality.axes.items()} == {"A": False, "B": True}
    alone = inspect(pt.Log({"t": t, "A.q": q}), {"A": True})
    assert alone.axes["A"].moves
