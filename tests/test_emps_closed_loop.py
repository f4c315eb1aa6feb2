"""The real closed loop of EMPS, simulated from its command alone, against the published figures.

Published (EMPS_Description.pdf): position 0.013752 %, velocity 0.22911 %, acceleration 8.6036 %,
force 5.848 % of the measured signal's norm; controller kp 160.18 1/s, kv 243.45 V/(m/s).
"""

from __future__ import annotations

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.columns import bind
from pinotwin.signals import derivatives

PUBLISHED = {"position": 0.013752, "velocity": 0.22911, "acceleration": 8.6036, "force": 5.848}
GTAU = 35.15065  # N/V


@pytest.fixture(scope="module")
def log(data_dir):
    return pt.read(data_dir / "emps" / "DATA_EMPS.mat")


@pytest.fixture(scope="module")
def twin(log):
    return pt.identify(pt.Machine.load("emps"), log)


def percent(predicted, measured) -> float:
    inside = slice(49, -49)  # the start-up of the low-pass that differentiates the measured position
    error = np.linalg.norm(predicted[inside] - measured[inside])
    return 100.0 * float(error / np.linalg.norm(measured[inside]))


@pytest.mark.parametrize("controller", ["black", "coupled"])
def test_simulated_from_the_command_it_beats_the_published_simulation(twin, log, controller):
    measured = bind(log, twin.machine.columns)
    command = measured.with_channels({"t": measured.t, "X.qr": measured["X.qr"]})
    predicted = twin.simulate(command, controller=controller)
    truth = derivatives(measured["X.q"][:, None], 1000.0, 100.0)
    model = derivatives(predicted["X.q"][:, None], 1000.0, 100.0)
    names = ("position", "velocity", "acceleration")
    errors = {n: percent(m[:, 0], x[:, 0]) for n, m, x in zip(names, model, truth, strict=True)}
    errors["force"] = percent(predicted["X.u"], measured["X.u"])
    for name, limit in PUBLISHED.items():
        assert errors[name] < limit, (name, errors)


@pytest.mark.parametrize("signal", ["kp", "kv"])
def test_the_servo_has_the_published_gains_within_its_intervals(twin, signal):
    published = {"kp": 160.18, "kv": 243.45 * GTAU}[signal]
    servo = twin.servos["X"]
    low, high = servo.intervals()[signal]
    assert low <= published <= high
    assert servo.named()[signal] == pytest.approx(published, rel=0.01)
    assert servo.determined()[signal]


def test_the_servo_has_no_integral_and_no_feed_forward_as_published(twin):
    servo = twin.servos["X"]
    assert servo.form == "proportional"
    named = servo.named()
    assert (named["rate"], named["ffv"], named["ffa"]) == (0.0, 0.0, 0.0)
    assert set(servo.determined()) == {"kp", "kv"}  # what is not there is not said to be determined
    assert "rate" not in servo.intervals()
