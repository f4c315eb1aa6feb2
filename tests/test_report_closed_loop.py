"""The closed loop in a report: errors, poles and gains of a twin whose loop is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pinotwin.log import Log
from pinotwin.loop import Servo
from pinotwin.report import identification_report
from pinotwin.report.blocks import Html
from pinotwin.report.closed_loop import closed_loop_content, score_table, servo_table
from pinotwin.report.closed_loop_plots import CAUSES
from pinotwin.report.display import scale_of
from tests.simulated import known_twin, plain_machine, smooth_command
from tests.test_report import read

NOISE = {"q": 2e-7, "u": 0.5}
"""RMS that the measurement is off the prediction by [m or rad, N or N·m]."""


@pytest.fixture(scope="module")
def twin():
    return known_twin(plain_machine("trunnion"))


@pytest.fixture(scope="module")
def log(twin) -> Log:
    """What the twin itself foretells, with alternating errors of known RMS added."""
    command = smooth_command(twin.machine, 1.0, 1000.0)
    predicted = twin.simulate(command)
    channels = dict(command.channels)
    wave = np.where(np.arange(len(command.t)) % 2, 1.0, -1.0)
    for axis in twin.machine.axes:
        channels[f"{axis}.q"] = predicted[f"{axis}.q"] + NOISE["q"] * wave
        channels[f"{axis}.u"] = predicted[f"{axis}.u"] + NOISE["u"] * wave
    return Log(channels, source="known.csv")


@pytest.fixture(scope="module")
def closed(twin, log):
    return closed_loop_content(twin, log)["closed"]


def cells(block: Html) -> list[list[str]]:
    return [row for row in read(block).rows if row]


def test_the_table_states_the_errors_that_were_added(twin, log):
    rows = cells(score_table(twin, log, twin.simulate(log)))
    by = {(r[0], r[1]): r for r in rows}
    assert by["Y", "tracking error"][2] == "0.2 µm"
    assert by["A", "tracking error"][2] == "0.0115 mdeg"  # 2e-7 rad
    assert by["Y", "effort"][2] == "0.5 N"
    assert by["A", "effort"][2] == "0.5 N·m"
    shares = []
    for axis in twin.machine.axes:
        for signal, size in (("tracking error", NOISE["q"]), ("effort", NOISE["u"])):
            y = log[f"{axis}.u"] if signal == "effort" else log[f"{axis}.qr"] - log[f"{axis}.q"]
            shares.append(100.0 * size / np.sqrt(np.mean(y**2)))
            shown = float(by[axis, signal][3].split()[0])
            assert shown == pytest.approx(shares[-1], rel=0.06, abs=0.05)
    assert float(by["mean", ""][3].split()[0]) == pytest.approx(np.mean(shares), abs=0.06)


def test_poles_and_gains_are_those_of_the_twin(twin, log):
    page = identification_report(twin, log)
    rows = read(page).rows
    named, loop = twin.servos["Y"].named(), twin.loops["Y"]
    values = [r[2] for r in rows if len(r) == 7 and "pole" in r[1]]
    for p in loop.pole_table():
        if p["unit"] == "Hz":
            assert f"{p['value']:.4g}" in values
    (kp,) = [r for r in rows if len(r) == 5 and r[:2] == ["Y", "position gain kp"]]
    assert float(kp[2]) == pytest.approx(named["kp"], rel=1e-3)
    assert "Sampled law" not in page


def test_the_simulated_controller_is_shown_with_intervals_and_ties(twin):
    servo = Servo.of_cascade(60.0, 5000.0, 40.0, 0.93, 30.0, velocity_lag=3e-4)
    errors = {"kp": 2.0, "rate": 2.0, "kv": 100.0, "ffa": 9.0, "kp + rate": 1.0, "kp * rate": 20.0}
    servo = dataclasses.replace(servo, errors=errors, other={"kp": 40.0, "rate": 60.0})
    rows = cells(servo_table(dataclasses.replace(twin, servos={"Y": servo})))
    assert rows[0][:4] == ["Y", "position gain kp", "60", "36.71 to 63.29"]
    assert "tied" in rows[0][4]
    assert rows[1][:4] == ["", "velocity gain kv", "5000", "4836 to 5164"]
    by = {row[1]: row for row in rows}
    assert by["velocity gain kv"][4] == "determined"
    assert by["acceleration feed-forward"][4] == "not determined"
    assert by["lag of the velocity"][2] == "0.3 ms"
    assert by["kp + 1/ti"][2:] == ["100", "98.36 to 101.6", "determined"]
    assert by["kp / ti"][2:] == ["2400", "2367 to 2433", "determined"]


def test_the_measured_line_is_command_minus_position(twin, log, closed):
    trace = next(t for t in closed["response"].data if t.name == "measured")
    e = (log["Y.qr"] - log["Y.q"])[np.searchsorted(log.t, trace.x - 1e-4)]  # the rows that a screen needs
    factor = scale_of("e", False, e).factor
    assert len(e) > 100
    assert trace.y == pytest.approx(factor * e, abs=1e-4 * factor * np.abs(e).max())


def test_shares_of_the_causes_fill_the_bars(twin, closed):
    for axis in twin.loops:
        bars = closed["shares"].data
        total = sum(dict(zip(bar.y, bar.x, strict=True)).get(axis, 0.0) for bar in bars)
        assert total == pytest.approx(100.0, abs=1.5)
    assert list(closed["causes"].panels) == list(twin.loops)


def test_a_log_without_command_is_said_and_the_poles_stay(twin, log):
    bare = Log({k: x for k, x in log.channels.items() if not k.endswith(".qr")}, source="bare.csv")
    page = identification_report(twin, bare)
    assert "The command could not be simulated: " in page
    assert "real pole p1" in page


def test_a_twin_without_loop_has_no_section(twin, log):
    assert closed_loop_content(dataclasses.replace(twin, loops={}), log)["closed"] == {}


def test_small_errors_are_shown_in_small_units():
    assert scale_of("e", True, np.radians(0.02)).unit == "mdeg"
    assert scale_of("e", True, np.radians(3.0)).unit == "°"
    assert scale_of("e", False, 1e-5).unit == "µm"
    assert scale_of("e", True, 1.0)(np.array([np.pi]))[0] == pytest.approx(180.0)


def test_every_cause_of_the_decomposition_has_a_colour():
    from pinotwin.analysis.disturbance import CAUSES as KNOWN

    assert set(KNOWN) < set(CAUSES)
