"""A load of which the controllers are told: their gains and their acceleration feed-forward follow it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.diagnosis.days import law
from pinotwin.diagnosis.days.mechanisms import zeros
from pinotwin.diagnosis.days.reference import reference
from pinotwin.diagnosis.days.stretch import smooth
from tests.days_machine import Day, machine, write

AHEAD = 0.9


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("told")
    machine(folder)
    return folder


@pytest.fixture(scope="module")
def twin(folder: Path) -> pt.Twin:
    days = [write(folder, f"healthy_{k}", Day(command=10 + k, noise=20 + k, ahead=AHEAD)) for k in range(3)]
    return pt.identify(pt.Machine.load(folder), [str(x) for x in days])


def _diagnosed(folder: Path, twin: pt.Twin, load: float) -> pt.Diagnosis:
    days = [Day(command=30 + k // 2, noise=40 + k, ahead=AHEAD, load=load) for k in range(3)]
    logs = [str(write(folder, f"load_{load}_{k}", day)) for k, day in enumerate(days)]
    return pt.diagnose(twin, logs[:2], validate=logs[2])


@pytest.mark.parametrize("load", [2.0, -1.5])
def test_a_load_is_one_body_though_the_feed_forward_follows(folder: Path, twin: pt.Twin, load: float) -> None:
    found = _diagnosed(folder, twin, load)
    assert [e.effect for e in found.effects] == ["payload"]
    assert found.effects[0].theta["m"] == pytest.approx(load, rel=0.1)
    # The logs in question promise a share, the validation log tells it.
    (first,) = found.effects
    for shrink in (*first.acts.values(), *first.shrink.values()):
        assert shrink.on == "validation"
        assert 0.0 < abs(shrink.promised - shrink.share) < 0.25


def test_without_the_feed_forward_the_law_keeps_more(
    folder: Path, twin: pt.Twin, monkeypatch: pytest.MonkeyPatch
) -> None:
    both = _told(_diagnosed(folder, twin, 2.0))
    monkeypatch.setattr(law.Law, "follows", {"loop_gain": 1.0})
    assert _told(_diagnosed(folder, twin, 2.0)) < 0.9 * both


def _told(d: pt.Diagnosis) -> float:
    return max(x["score"]["law"] for x in d.to_dict()["evidence"] if x["what"] == "told")


def test_a_velocity_loop_that_integrates_the_motor_has_one_gain_for_its_load() -> None:
    rng, n, step, kp, kv, ki = np.random.default_rng(0), 4000, 1e-3, 40.0, 900.0, 30000.0
    t = step * np.arange(n)
    qr = 0.1 * np.sin(2.0 * np.pi * 0.7 * t) + 0.02 * np.sin(2.0 * np.pi * 3.1 * t)
    load = qr - 2e-4 * np.gradient(qr, step) + 3e-4 * smooth(rng.standard_normal(n), step)
    ahead = 3e-7 * np.gradient(np.gradient(load, step), step)  # of its motor, by what the belt gives
    e, v = qr - load, np.gradient(load + ahead, step)
    u = (
        kv * (kp * e - v)
        + ki * (kp * np.cumsum(e) * step - (load + ahead))
        + 0.9 * kv * np.gradient(qr, step)
    )
    c = {"e": e, "ie": np.cumsum(e) * step, "v": v, "a": np.gradient(v, step), "qr": qr, "lead": -ahead}
    c |= {"vr": np.gradient(qr, step), "u": u + 0.5 * smooth(rng.standard_normal(n), step)}
    c["ar"] = np.gradient(c["vr"], step)
    c |= {"jr": np.gradient(c["ar"], step), "du": np.gradient(c["u"], step)}
    found = law.Law.fitted([c])
    assert found.cascade[0] == pytest.approx(kp, rel=0.05)
    assert found.gains[-1] == pytest.approx(ki, rel=0.2)


@pytest.mark.parametrize("shift", [0.5, 1.2])
def test_a_zero_is_told_by_what_it_does_beyond_the_slope(twin: pt.Twin, shift: float) -> None:
    r = reference(twin, ["X", "A"])
    assert r is not None
    s = r.logs[0]
    q = s.motion.q[s.rows]
    still = np.zeros_like(q)
    change = s.low(twin.predict(q - [0.0, shift], still, still) - twin.predict(q, still, still))
    left = {("X", "plant"): 0.0 * change[:, 0], ("A", "plant"): change[:, 1]}
    course = zeros(r, s, left)["zero:A"]["A"]
    found = float(course @ change[:, 1] / (course @ course))
    assert found == pytest.approx(shift, rel=0.02)
    assert np.std(change[:, 1] - found * course) < 0.03 * np.std(change[:, 1])
