"""Steps that are lost: a position that rests off its command from some stop on, and what only looks like it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from pinotwin.arrays import Floats
from pinotwin.log import Log
from pinotwin.logs.quality import inspect

RATE, STOPS = 100.0, 12


def stops(seed: int) -> tuple[Floats, Floats]:
    """Return time [s] and a command [m] that stops at random places, twelve times for half a second."""
    rng = np.random.default_rng(seed)
    places, rise = rng.uniform(-0.2, 0.2, STOPS + 1), 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 60))
    ways = [np.r_[a + (b - a) * rise, np.full(50, b)] for a, b in pairwise(places)]
    command = np.concatenate(ways)
    return np.arange(len(command)) / RATE, command


def side(command: Floats) -> Floats:
    """Return from which side the command came last, (n,)."""
    moves = np.sign(np.diff(command, prepend=command[:1]))
    last = np.maximum.accumulate(np.where(moves != 0.0, np.arange(len(moves)), 0))
    return np.asarray(moves[last])


def said(t: Floats, command: Floats, off: Floats, seed: int) -> list[str]:
    """Return what is said of a slip of a position that is off its command, read with noise."""
    q = command + off + 2e-6 * np.random.default_rng(seed).normal(size=len(t))
    log = Log({"t": t, "X.q": q, "X.qr": command})
    return [f.message for f in inspect(log, {"X": False}).findings if f.code == "slipped"]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("droop", [0.0, 5e-5], ids=["stepper", "with_friction"])
def test_lost_steps_are_told_with_their_size_and_time(seed: int, droop: float) -> None:
    t, command = stops(seed)
    stop = 3 + seed % 5
    lost = -4e-4 * (t > (stop + 0.3) * 1.1)
    (message,) = said(t, command, lost + droop * side(command), seed)
    assert "-0.4" in message or "-0.39" in message
    assert f"from {(stop + 1) * 1.1 - 0.5:.2g}"[:8] in message


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("kind", ["friction", "growth", "droop", "noise", "returns", "a_while", "tiny"])
def test_what_only_looks_like_it_is_not(seed: int, kind: str) -> None:
    t, command = stops(seed)
    rng = np.random.default_rng(100 + seed)
    once, a_while = (t > 5.5) & (t < 6.6), (t > 4.4) & (t < 8.8)
    off = {
        "friction": 2e-4 * side(command),
        "growth": 1e-5 * t,
        "droop": 1e-3 * np.cos(5.0 * command),
        "noise": 1e-4 * np.repeat(rng.normal(size=STOPS), 110),
        "returns": -4e-4 * once,
        "a_while": -4e-4 * a_while,
        "tiny": -1.5e-5 * (t > 5.5),
    }[kind]
    assert not said(t, command, off, seed)


def test_noise_is_hardly_ever_told_as_a_slip() -> None:
    told = 0
    for seed in range(300):
        t, command = stops(seed)
        places = np.repeat(1e-4 * np.random.default_rng(1000 + seed).normal(size=STOPS), 110)
        told += len(said(t, command, places, seed))
    assert told <= 1
