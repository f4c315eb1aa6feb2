"""Tracking error by cause: the parts add up, and each is what its cause alone would make."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import integrate

import pinotwin as pt
from pinotwin.analysis.decomposition import COMMAND, decompose
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.simulation import respond, simulate
from tests.simulated import known_twin, plain_machine, smooth_command


@pytest.fixture(scope="module")
def twin():
    return known_twin(plain_machine("trunnion"))


@pytest.fixture(scope="module")
def log(twin) -> Log:
    return smooth_command(twin.machine, 1.0, 1000.0)


@pytest.fixture(scope="module")
def parts(twin, log):
    return decompose(twin, log)


def test_errors_sum_to_the_simulated_error(twin, log, parts):
    predicted = simulate(twin, log)
    for axis in parts.axes:
        e = predicted[f"{axis}.e"]
        assert np.abs(parts.error(axis) - e).max() < 1e-6 * np.abs(e).max()


def test_disturbances_sum_to_the_simulated_disturbance(twin, log, parts):
    found = respond(twin, log)
    for axis in parts.axes:
        d = found.d[:, twin.machine.axes[axis].index]
        assert np.abs(parts.disturbance(axis) - d).max() < 1e-6 * np.abs(d).max()


def test_what_the_tables_leave_is_negligible(parts):
    for axis in parts.axes:
        d = parts.disturbances[axis]
        assert np.sqrt(np.mean(d["other"] ** 2)) < 1e-3 * np.sqrt(np.mean(parts.disturbance(axis) ** 2))


def test_an_error_is_the_response_of_the_loop_to_its_disturbance(twin, log, parts):
    """Own integration of M v' + C v = u - d, u = kv (kp e - v + (1/ti) int) by scipy."""
    axis = "Y"
    law, i = twin.servos[axis].cascade(), twin.machine.axes[axis].index
    M, C = twin.diagonal["inertia"][i], twin.diagonal["viscous"][i]
    d = parts.disturbances[axis]["inertial_coupling"]

    def rate(t, x):  # type: ignore[no-untyped-def]
        q, v, total = x
        w = -law["kp"] * q - v
        u = law["kv"] * (w + law["rate"] * total)
        return [v, (u - C * v - np.interp(t, parts.t, d)) / M, w]

    found = integrate.solve_ivp(rate, (0.0, 1.0), [0, 0, 0], t_eval=parts.t, max_step=1e-3, rtol=1e-8)
    e = parts.errors[axis]["inertial_coupling"]
    assert np.sqrt(np.mean((-found.y[0] - e) ** 2)) < 5e-3 * np.sqrt(np.mean(e**2))


def test_without_effort_only_the_command_is_left(twin, log):
    free = known_twin(plain_machine("trunnion"), scale=0.0)
    quiet = {name: np.zeros(len(log)) for name in ("Y.qr", "A.qr", "C.qr")}
    found = decompose(free, Log({**log.channels, **quiet, "Y.qr": log["Y.qr"]}, "Y alone"))
    assert found.shares("Y")[COMMAND] > 0.5
    assert found.shares("A")["inertial_coupling"] > 0.9


def test_an_external_force_has_its_own_part(twin, log):
    force = 100.0 * np.exp(-(((log.t - 0.5) / 0.01) ** 2))
    found = decompose(twin, Log({**log.channels, "C_link.fy": force}, "hit"))
    assert np.allclose(found.disturbances["Y"]["external"], -force, atol=1e-9)
    late = found.t < 0.4
    assert np.abs(found.errors["Y"]["external"][late]).max() < 1e-12


def test_shares_are_the_integrals_of_the_absolute_errors(parts):
    for axis in parts.axes:
        shares = parts.shares(axis)
        assert sum(shares.values()) == pytest.approx(1.0, abs=1e-12)
        friction, command = (
            np.trapezoid(np.abs(parts.errors[axis][c]), parts.t) for c in ("friction", COMMAND)
        )
        assert shares["friction"] / shares[COMMAND] == pytest.approx(friction / command, rel=1e-12)
        rows = [row for row in parts.table() if row["axis"] == axis]
        assert [row["share"] for row in rows] == sorted(shares.values(), reverse=True)


def test_a_window_is_a_cut_of_the_whole(twin, log, parts):
    some = decompose(twin, log, (0.3, 0.6))
    rows = (parts.t >= 0.3) & (parts.t <= 0.6)
    assert np.array_equal(some.t, parts.t[rows])
    assert np.array_equal(some.errors["A"]["gravity"], parts.errors["A"]["gravity"][rows])


def test_a_window_outside_the_log_is_refused(twin, log):
    with pytest.raises(DataError, match=r"window 5 to 6 s holds 0 rows; the log runs from 0 to 1 s"):
        decompose(twin, log, (5.0, 6.0))


def test_axes_without_a_loop_are_left_out(twin, log):
    part = dataclasses.replace(twin, loops={"Y": twin.loops["Y"]})
    assert decompose(part, log).axes == ("Y",)


def test_a_motion_is_taken_for_its_command(twin, log, parts):
    measured = simulate(twin, log)
    whole = Log({**log.channels, **{k: x for k, x in measured.channels.items() if k != "t"}}, "measured")
    motion = pt.prepare(twin.machine, whole, cutoff=0.0)
    found = decompose(twin, motion)
    for axis in parts.axes:
        np.testing.assert_allclose(
            found.error(axis), parts.error(axis), atol=0.01 * np.abs(parts.error(axis)).max()
        )
    with pytest.raises(DataError, match="this motion has no command"):
        decompose(twin, dataclasses.replace(motion, qr=None))
    with pytest.raises(DataError, match=r"several stretches; take one: motion.cut"):
        decompose(twin, pt.Motion.join([motion, motion]))
