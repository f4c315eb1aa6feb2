"""Long logs: shapes are searched on pieces of them and settled on all rows."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import pinotwin as pt
from pinotwin.effects import Coulomb, Ripple, Viscous
from pinotwin.identification.loop_parts import loop_data
from pinotwin.identification.settings import Settings

PITCH = 0.031  # m


def log(seconds: float = 40.0, rate: float = 250.0) -> pt.Log:
    """Return a slide of 95 kg with viscous and dry friction and a ripple."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    w, size = 2.0 * np.pi * np.array([0.13, 0.41, 0.87]), np.array([0.06, 0.03, 0.01])
    wave = np.outer(t, w)
    q, v, a = np.sin(wave) @ size, np.cos(wave) @ (size * w), -np.sin(wave) @ (size * w**2)
    u = 95.0 * a + 200.0 * v + 20.0 * np.sign(v) + 6.0 * np.cos(2.0 * np.pi * q / PITCH + 0.4)
    u += np.random.default_rng(1).normal(0.0, 2.0, len(t))
    return pt.Log({"t": t, "X.q": q, "X.u": u}, source="slide")


def slide() -> pt.Machine:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "X")
    model.appendBodyToJoint(joint, pin.Inertia(95.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    machine = pt.Machine.from_model(model, ["X"], name="slide")
    return machine.with_effects("X", (Viscous("X"), Coulomb("X"), Ripple("X")))


def found(log: pt.Log, **numbers: int) -> pt.Twin:
    return pt.identify(slide(), log, loop=False, settings=Settings(**numbers))


def test_a_long_log_gives_the_shapes_of_all_its_rows():
    whole, pieces = found(log(), long=10**6), found(log(), long=4000, short=2400)
    a, b = ({p.name: p for p in twin.parameters} for twin in (whole, pieces))
    pitch = next(name for name in a if name.endswith("ripple.period"))
    assert b[pitch].value == pytest.approx(PITCH, abs=4.0 * b[pitch].error)
    for name, parameter in a.items():
        if parameter.determined:
            assert b[name].value == pytest.approx(parameter.value, abs=0.02 * parameter.error)
            assert b[name].error == pytest.approx(parameter.error, rel=1e-2)


def test_pieces_too_short_to_tell_are_none():
    twin = found(log(), long=4000, short=600)
    period = next(p for p in twin.parameters if p.name.endswith("ripple.period"))
    assert period.value == pytest.approx(PITCH, abs=4.0 * period.error)


def test_a_long_loop_is_fitted_to_pieces_in_which_the_axis_moves():
    moving = log()
    rest = np.full(5000, moving["X.q"][-1])
    q = np.concatenate([moving["X.q"], rest])
    t = np.arange(len(q)) * 0.004
    u = np.concatenate([moving["X.u"], np.zeros(5000)])
    motion = pt.prepare(slide(), pt.Log({"t": t, "X.q": q, "X.qr": q + 1e-6 * u, "X.u": u}, source="slide"))
    data = loop_data(motion, np.sin(motion.q), "X", Settings(long=4000, short=2400))
    assert 1200 <= data.rows <= 2400
    assert all(np.ptp(data.qr[s]) > 0.0 for s in data.segments)
    assert data.segments[-1].stop > 0.8 * len(moving)  # over all of the motion, not its beginning
