"""A log of one speed tells c + b v at that speed, and neither c nor b."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import pinotwin as pt
from tests.slide import URDF

MASS, VISCOUS, DRY, DISTANCE = 70.0, 60.0, 20.0, 1e-3  # kg, N·s/m, N, m over which friction turns
SPEED, RAMP, STEP = 0.2, 0.04, 0.001  # m/s, s, s


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> pt.Machine:
    folder: Path = tmp_path_factory.mktemp("slide")
    (folder / "slide.urdf").write_text(URDF)
    spec = "name: slide\nurdf: slide.urdf\naxes: {X: {joint: X, effects: [viscous, coulomb, offset]}}\n"
    (folder / "machine.yaml").write_text(spec)
    return pt.Machine.load(folder)


def log(speeds: tuple[float, ...], seed: int = 0) -> pt.Log:
    """Return a log to and fro, a second each way, at some speeds in turn; dry friction turns as Dahl's."""
    t = np.arange(0.0, 24.0, STEP)
    way = np.floor(t).astype(int)
    goal = np.array(speeds)[way % len(speeds)] * np.where(way // len(speeds) % 2, -1.0, 1.0)
    steps = np.round(RAMP / STEP).astype(int)
    v = lfilter(np.ones(steps) / steps, [1.0], lfilter(np.ones(steps) / steps, [1.0], goal))
    q, a, z = np.cumsum(v) * STEP, np.gradient(v, STEP), np.zeros(len(t))
    for k in range(1, len(t)):
        s = np.sign(v[k])
        z[k] = s + (z[k - 1] - s) * np.exp(-abs(v[k]) * STEP / DISTANCE)
    noise = np.random.default_rng(seed).normal(size=len(t))
    return pt.Log.from_arrays(t, q=q, u=MASS * a + VISCOUS * v + DRY * z + noise, axes=["X"])


def test_one_speed_tells_the_sum_alone(machine: pt.Machine) -> None:
    off = []
    for seed in range(6):
        twin = pt.identify(machine, log((SPEED,), seed), loop=False)
        row = twin.quality["one_speed"]["X"]
        assert row["speed"] == pytest.approx(SPEED, rel=0.01)
        off.append((row["effort"] - DRY - VISCOUS * row["speed"]) / row["half"])
    assert np.mean(off) == pytest.approx(0.0, abs=0.5), off
    assert np.abs(off).max() < 1.5, off
    assert not any(twin.parameters[f"X.{x}"].determined for x in ("viscous.b", "coulomb.c"))
    assert {"X.viscous.b", "X.coulomb.c"} in [set(group) for group in twin.groups]
    said = next(x for x in twin.quality["warnings"] if "one speed" in x)
    assert said.startswith("X moves at one speed: of its friction only c + b v = 3")
    assert said.endswith("N at 0.2 m/s is known")


def test_logs_of_other_speeds_tell_its_parts(machine: pt.Machine, tmp_path: Path) -> None:
    twin = pt.identify(machine, log((SPEED, 0.5 * SPEED)), loop=False)
    assert twin.quality["one_speed"] == {}
    assert twin.parameters["X.viscous.b"].determined
    saved = pt.Twin.load(pt.identify(machine, log((SPEED,)), loop=False).save(tmp_path))
    more = pt.update(saved, log((0.4 * SPEED,)))
    assert more.quality["one_speed"] == {}
    assert not any("one speed" in x for x in more.quality["warnings"])
    assert more.parameters["X.viscous.b"].determined
