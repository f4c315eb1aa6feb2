"""Pinocchio computes: its calls are counted while the tool works on a log of the trunnion."""

from __future__ import annotations

from collections import Counter

import pinocchio as pin
import pytest

import pinotwin as pt
from pinotwin.virtual import VirtualMachine, random_trajectory


@pytest.fixture(scope="module")
def log(urdf_dir):
    virtual = VirtualMachine.load(urdf_dir / "trunnion")
    return virtual.record(random_trajectory(virtual, 6.0, seed=1), seed=1).to_log()


@pytest.fixture
def calls(monkeypatch):
    """How often each function of Pinocchio was called."""
    counts = Counter()

    def counting(name, function):
        def counted(*args, **kwargs):
            counts[name] += 1
            return function(*args, **kwargs)

        return counted

    for name in ("computeJointTorqueRegressor", "rneaInParallel"):
        monkeypatch.setattr(pin, name, counting(name, getattr(pin, name)))
    return counts


def test_identify_takes_its_regressor_from_pinocchio(log, urdf_dir, calls):
    machine = pt.Machine.load(urdf_dir / "trunnion")
    calls.clear()
    pt.identify(machine, log, loop=False)
    assert calls["computeJointTorqueRegressor"] > len(log.t)


def test_check_takes_its_regressor_from_pinocchio(log, urdf_dir, calls):
    machine = pt.Machine.load(urdf_dir / "trunnion")
    calls.clear()
    pt.check(machine, log)
    assert calls["computeJointTorqueRegressor"] > len(log.t) // 2
