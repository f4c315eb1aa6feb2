"""Loads that hang on an axis by a spring have states of their own in the coupled machine."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import pinotwin as pt
from pinotwin.analysis.disturbance import generalised_disturbance
from pinotwin.effects import JointFlexibility, Viscous
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.loop import Servo
from pinotwin.simulation import respond
from pinotwin.simulation.run import as_motion
from pinotwin.twin import Twin
from tests.simulated import nominal_twin

MASS, DRAG, SHARE, FREQUENCY, DAMPING = 90.0, 50.0, 0.25, 24.0, 0.02
GAINS = {"kp": 12.0, "kv": 3000.0, "rate": 8.0, "ffv": 0.95, "ffa": 60.0}


def twin(share: float = SHARE) -> Twin:
    machine = pt.Machine.load("emps")
    flexible = JointFlexibility("X", frequency=FREQUENCY, damping=DAMPING)
    made = nominal_twin(machine.with_effects("X", (Viscous("X"), flexible)))
    theta = made.theta.copy()
    sizes = {"rigid_body": [MASS], "X.viscous": [DRAG], "X.joint_flexibility": [share]}
    for key, where in zip(made.keys, made.slices, strict=True):
        theta[where] = sizes[key]
    diagonal = {"inertia": np.array([MASS]), "viscous": np.array([DRAG]), "stiffness": np.zeros(1)}
    return dataclasses.replace(made, theta=theta, diagonal=diagonal, servos={"X": Servo.of_cascade(**GAINS)})


def command() -> Log:
    t = np.arange(1501) / 500.0
    rise = np.clip((t - 0.3) / 0.15, 0.0, 1.0)
    back = np.clip((t - 1.5) / 0.2, 0.0, 1.0)
    smooth = [x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3) for x in (rise, back)]
    return Log({"t": t, "X.qr": 0.05 * smooth[0] - 0.03 * smooth[1]}, source="two moves")


def two_masses(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Error and effort of a motor and a load on a spring under the law, by Runge-Kutta."""
    path, (k_e, k_i, k_v, k_vr, k_w, k_ar) = CubicSpline(log.t, log["X.qr"]), Servo.of_cascade(**GAINS).gains
    load, w = SHARE * MASS, 2.0 * np.pi * FREQUENCY

    def law(t, x):
        r, vr, ar = (path(t, k) for k in range(3))
        return k_e * (r - x[0]) + x[4] - k_v * x[1] + k_vr * vr + k_ar * ar, k_i * (r - x[0]) + k_w * vr

    def rates(t, x):
        u, wound = law(t, x)
        force = load * (w * w * (x[0] - x[2]) + 2.0 * DAMPING * w * (x[1] - x[3]))
        return [x[1], (u - DRAG * x[1] - force) / (MASS - load), x[3], force / load, wound]

    found = solve_ivp(
        rates, (0.0, log.t[-1]), np.zeros(5), t_eval=log.t, rtol=1e-9, atol=1e-12, max_step=1e-3
    )
    u = np.array([law(t, x)[0] for t, x in zip(found.t, found.y.T, strict=True)])
    return log["X.qr"] - found.y[0], u


def test_the_coupled_machine_swings_like_two_masses() -> None:
    log = command()
    e, u = two_masses(log)
    said, stiff = (twin(share).simulate(log, controller="coupled", step=2.5e-5) for share in (SHARE, 0.0))
    for true, name in ((e, "X.e"), (u, "X.u")):
        assert np.std(said[name] - true) < 0.02 * np.std(stiff[name] - true)


def test_the_effect_says_of_the_simulated_motion_what_moved_it() -> None:
    """The column along the motion and the states of the simulation are one spring."""
    found = respond(twin(), command(), controller="coupled")
    motion = as_motion(twin(), found)
    assert twin().effort(motion)[:, 0] == pytest.approx(found.u[:, 0], abs=0.02 * np.std(found.u))


def test_a_free_loop_has_the_mode_among_its_poles_and_not_in_its_disturbance() -> None:
    found = respond(twin(), command(), controller="coupled")
    motion = as_motion(twin(), found)
    with_mode, without = (
        generalised_disturbance(twin(), motion, twin().diagonal, modes=modes) for modes in (True, False)
    )
    assert np.std(without) < 1e-6 * np.std(with_mode)


def test_a_load_that_no_gain_holds_is_said() -> None:
    wild = dataclasses.replace(twin(0.9), servos={"X": Servo.of_cascade(60.0, 40000.0, 60.0, 1.0, 90.0)})
    with pytest.raises(DataError, match="diverges from its command"):
        wild.simulate(command(), controller="coupled")
