"""A loop closed on the load's encoder: the position regulated is ``<axis>.ql``, the motor stands elsewhere.

The truth is written out below and shares nothing with the model: two masses and a spring, a screw that has
grown warm, dry friction, and a drive at 8 kHz with its position loop on the scale and its velocity loop on the motor.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import pinotwin as pt
from pinotwin.errors import LogError, MachineError
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.machine import LoopShape, Machine
from pinotwin.machine.parts import MachineFile
from pinotwin.machine.sections import loops
from pinotwin.simulation import compare
from pinotwin.system.reading import read
from tests.simulated import plain_machine, smooth_command

MOTOR, LOAD = 30.0, 65.0
"""Masses [kg]."""
STIFF = 3.0e7
"""Of the drive [N/m]: the load against the motor held still swings at 108 Hz."""
GROWTH = 5e-4
"""By which the warm screw turns less than the load goes: why such machines have scales."""
H = 1.25e-4


def recorded(seed: int, seconds: float = 12.0, rate: float = 500.0, closed_on: str = "load") -> Log:
    """Return a log of the drive along a random command."""
    made = smooth_command(plain_machine("trunnion"), seconds, rate, seed=seed)
    t, qr = made.t, made["Y.qr"]
    sub, spline = round(1.0 / rate / H), CubicSpline(t, qr)
    fine = H * np.arange((len(t) - 1) * sub + 1)
    r, vr, ar = (spline(fine, k).tolist() for k in range(3))
    rng = np.random.default_rng(seed)
    kp, kv, ki, ffa = 45.0, 9000.0, 9000.0 * 35.0, 85.0
    m = x = last = r[0]
    vm = vx = seen = total = 0.0
    rows = []
    for k in range(len(fine)):
        reading = round(m * (1.0 - GROWTH) / 1e-8) * 1e-8
        if k == 0:
            last = reading
        seen += 0.35 * ((reading - last) / H - seen)
        last = reading
        wanted = kp * (r[k] - (x if closed_on == "load" else reading)) + 0.99 * vr[k] - seen
        u = kv * wanted + total + ffa * ar[k]
        total += ki * wanted * H
        if k % sub == 0:
            rows.append((reading, x, u))
        spring = STIFF * (m - x) + 2.0e3 * (vm - vx)
        vm += H * (u - 300.0 * vm - spring) / MOTOR
        vm -= min(max(vm, -H * 20.0 / MOTOR), H * 20.0 / MOTOR)
        vx += H * (spring - 50.0 * vx) / LOAD
        m, x = m + H * vm, x + H * vx
    q, ql, u = np.array(rows).T
    noise = rng.normal(0.0, 1.0, len(t))
    return Log({"t": t, "X.qr": qr, "X.q": q, "X.ql": ql, "X.u": u + noise}, source=f"{seed}.csv")


def machine(closed_on: str) -> Machine:
    loop = {"X": LoopShape(closed_on=closed_on, stated=False)}
    return dataclasses.replace(Machine.load("emps"), columns={}, loop=loop)


@pytest.fixture(scope="module")
def logs():
    return recorded(1), recorded(2)


def test_the_regulated_position_is_what_is_identified_and_predicted(logs):
    log, unseen = logs
    errors = {}
    late = unseen.t > 0.5  # the true drive begins without the state of its motion
    for closed_on in ("load", "motor"):
        twin = pt.identify(machine(closed_on), log)
        said = twin.simulate(Log({k: unseen[k] for k in ("t", "X.qr")}, source="command"))
        measured = unseen["X.qr"] - unseen["X.ql" if closed_on == "load" else "X.q"]
        for name, true in (("e", measured), ("u", unseen["X.u"])):
            left = np.sqrt(np.mean((said[f"X.{name}"] - true)[late] ** 2))
            errors[closed_on, name] = left / np.sqrt(np.mean(true[late] ** 2))
        scored = compare(twin.machine, unseen, said)["X"]["e"]["rms"]
        assert scored == pytest.approx(np.sqrt(np.mean((said["X.e"] - measured) ** 2)))
        assert ("X.ql" in said) == (closed_on == "load")
        if closed_on == "load":
            np.testing.assert_allclose(said["X.ql"], unseen["X.qr"] - said["X.e"], atol=1e-12)
    assert errors["load", "e"] < 0.02
    assert errors["load", "u"] < 0.02
    assert errors["load", "e"] < 0.25 * errors["motor", "e"]


@pytest.mark.parametrize("closed_on", ["load", "motor"])
def test_a_loop_that_is_closed_on_the_load_is_proposed(closed_on):
    twin = pt.identify(machine("motor"), recorded(3, closed_on=closed_on))
    said = [x for x in twin.quality["warnings"] if "closed_on" in x]
    wanted = "X: its law fits better with the position at the load; give loop: {X: {closed_on: load}}"
    assert said == ([wanted] if closed_on == "load" else [])


def test_the_motion_lost_between_motor_and_load_is_a_number_of_the_twin(logs):
    log = logs[0]
    speed = np.gradient(log["X.q"], log.t)
    play, bent = (
        25e-6 * np.tanh(speed / 1e-3),
        50.0 * np.mean(np.abs(speed)) / STIFF,
    )  # by the load's friction
    twin = pt.identify(machine("motor"), log.with_channels({**log.channels, "X.ql": log["X.ql"] - play}))
    value, low, high = twin.servos["X"].service()["lost motion"]
    assert value == pytest.approx(2.0 * (25e-6 + bent), rel=0.02)
    assert 0.0 < high - low < 5e-6


def test_the_gains_are_those_of_the_loop_that_is_closed(logs):
    servo = pt.identify(machine("load"), logs[0]).servos["X"]
    assert servo.combined()["kp + rate"] == pytest.approx(45.0 + 35.0, rel=0.05)
    assert servo.named()["kv"] == pytest.approx(9000.0, rel=0.05)


def test_the_tracking_error_of_a_motion_is_that_of_the_encoder(logs):
    motion = prepare(machine("load"), logs[0])
    assert motion.ql is not None
    assert motion.on_load == (True,)
    np.testing.assert_array_equal(motion.error, motion.qr - motion.ql)
    np.testing.assert_array_equal(motion.cut(10, 500).error, motion.error[10:500])
    np.testing.assert_array_equal(prepare(machine("motor"), logs[0]).error, motion.qr - motion.q)


def test_a_log_without_that_encoder_is_refused(logs):
    log = Log({k: x for k, x in logs[0].channels.items() if k != "X.ql"}, source="day.csv")
    with pytest.raises(LogError, match=r"^day.csv: no channel X.ql, on which loop.X.closed_on says that the"):
        pt.identify(machine("load"), log)
    pt.identify(machine("motor"), log, loop=False)


def test_coupled_motors_have_no_loop_on_the_load():
    spec = {"loop": {"X": {"closed_on": "load"}}, "transmission": {"X": {"X": 1.0}}}
    with pytest.raises(MachineError, match=r"^loop.X.closed_on: a loop on the load's encoder behind a trans"):
        loops(read(spec, MachineFile, ""), ("X",))
    shape = loops(read({"loop": spec["loop"]}, MachineFile, ""), ("X",))["X"]
    assert not shape.stated
