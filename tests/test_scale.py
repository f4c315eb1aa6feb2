"""Efforts of unknown scale: amperes without a torque constant, and a servo that is known by its law alone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicSpline

import pinotwin as pt
from pinotwin.analysis.comparison import compare
from pinotwin.columns import Column, bind
from pinotwin.errors import LogError, MachineError
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.machine.sections import parse_columns
from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual.withholding import changed
from tests.simulated import known_twin, plain_machine, smooth_command

CONSTANTS = {"Y": 35.0, "A": 3.1, "C": 2.2}
"""Of the motors with their gears [N/A or N·m/A]."""


def table() -> Machine:
    return dataclasses.replace(plain_machine("trunnion").with_rigid_joints(), columns={})


def recorded(machine: Machine, seed: int) -> Log:
    """A log of the machine's own efforts [N or N·m] and a little noise, along a smooth motion."""
    twin, command = known_twin(machine), smooth_command(machine, 12.0, 250.0, seed=seed)
    axes = [CubicSpline(command.t, command[f"{name}.qr"]) for name in machine.names]
    q, v, a = (np.stack([axis(command.t, k) for axis in axes], axis=1) for k in range(3))
    u = twin.predict(q, v, a)
    u += 0.01 * u.std(axis=0) * np.random.default_rng(seed).standard_normal(u.shape)
    columns = {f"{n}.{x}": y[:, k] for k, n in enumerate(machine.names) for x, y in (("q", q), ("u", u))}
    return Log({**command.channels, **columns}, source=f"{seed}.csv")


def in_amperes(log: Log, but: tuple[str, ...] = ()) -> Log:
    """The same log with the currents of the motors in place of their efforts."""
    constants = {f"{name}.u": k for name, k in CONSTANTS.items() if name not in but}
    channels = {name: x / constants.get(name, 1.0) for name, x in log.channels.items()}
    return Log(channels, log.source, units=dict.fromkeys(constants, "A"))


@pytest.fixture(scope="module")
def twins() -> tuple[pt.Twin, pt.Twin, Log]:
    """Twins of one log in N and in A, and that log in A."""
    machine = table()
    log = recorded(machine, 1)
    current = in_amperes(log)
    return pt.identify(machine, log, loop=False), pt.identify(machine, current, loop=False), current


def test_each_axis_has_the_size_of_its_unit_from_the_masses(twins):
    sizes = twins[1].quality["sizes"]
    for name, constant in CONSTANTS.items():
        low, high = sizes[name]["interval95"]
        assert low < constant < high
        assert sizes[name]["source"] == "URDF"
    assert any("1 A is" in line for line in twins[1].quality["warnings"])


def test_friction_is_in_the_units_of_the_log_with_the_interval_that_it_has_there(twins):
    known, found, _ = twins
    for name, constant in CONSTANTS.items():
        for key in (f"{name}.viscous.b", f"{name}.coulomb.c"):
            one, other = known.parameters[key], found.parameters[key]
            assert other.unit == one.unit.replace("N·m" if name != "Y" else "N", "A")
            assert other.value * constant == pytest.approx(one.value, rel=0.01, abs=one.error)
            assert other.error * constant == pytest.approx(one.error, rel=0.1)
    for name in ("m_Y*", "mz_A*", "Izz_C*"):  # what hangs on the size is no surer than that
        one, other = (twin.parameters[f"rigid_body.{name}"] for twin in (known, found))
        assert other.error > 10.0 * one.error
        assert abs(other.value - one.value) < 1.96 * other.error


def test_the_twin_predicts_and_knows_the_size_when_it_is_read_again(twins, tmp_path):
    _, found, current = twins
    found.save(tmp_path / "twin")
    again = pt.Twin.load(tmp_path / "twin")
    motion = again.motion(current)
    size = found.quality["sizes"]["Y"]["size"]
    y = again.machine.axes["Y"].index
    assert motion.u[:, y].std() == pytest.approx(size * current["Y.u"].std(), rel=0.1)
    assert found.quality["axes"]["Y"]["held_out"]["nrmse"] < 0.05
    bound = bind(current, table().columns)
    np.testing.assert_allclose(bind(bound, again.machine.columns)["Y.u"], size * current["Y.u"])


def test_nothing_moves_between_two_days_in_amperes(twins):
    later = pt.identify(table(), in_amperes(recorded(table(), 2)), loop=False)
    assert compare(twins[1], later).moved == ()


def test_a_factor_of_one_axis_tells_that_of_the_others_by_what_they_share():
    found = pt.identify(table(), in_amperes(recorded(table(), 1), but=("A",)), loop=False)
    sizes = found.quality["sizes"]
    assert set(sizes) == {"Y", "C"}
    assert sizes["C"]["source"] == "given"
    assert sizes["Y"]["size"] == pytest.approx(35.0, rel=0.1)


def test_without_masses_nothing_is_said_of_the_size():
    machine = table()
    model = machine.model.copy()
    for k in range(1, model.njoints):
        model.inertias[k] = pin.Inertia(1.0, model.inertias[k].lever, model.inertias[k].inertia)
    machine = dataclasses.replace(machine, model=model)
    found = pt.identify(machine, in_amperes(recorded(table(), 1)), loop=False)
    assert found.quality["sizes"]["Y"]["interval95"] is None
    assert any("masses and N are guesses" in line for line in found.quality["warnings"])


def test_a_law_makes_the_effort_of_command_and_position():
    t = np.linspace(0.0, 1.0, 101)
    log = Log({"t": t, "X.qr": np.sin(t), "X.q": np.zeros(101)})
    bound = bind(log, parse_columns({"X.u": {"law": "pd", "kp": 40.0, "kd": 2.0}}))
    np.testing.assert_allclose(bound["X.u"][1:-1], (40.0 * np.sin(t) + 2.0 * np.cos(t))[1:-1], atol=1e-4)
    with pytest.raises(LogError, match=r"X\.u: its law needs X\.qr; map it under `columns`"):
        bind(Log({"t": t, "X.q": t}), {"X.u": Column(law="pd", kp=1.0)})
    with pytest.raises(MachineError, match=r"columns\.X\.u: a law needs its gain kp"):
        parse_columns({"X.u": {"law": "pd"}})


def test_a_position_servo_without_torque_has_its_ratios_of_friction_and_inertia(tmp_path):
    virtual = VirtualMachine.load(Machine.load("emps").path.parent, withhold=["drive_flexibility"])
    true = virtual.truth.axes["X"]
    law = {"kind": "pid", "kp": 9e5, "kv": 1.5e4, "ki": 0.0, "velocity_feedforward": 0.0}
    axis = changed(true, "controller", **law, velocity_filter=1500.0)
    virtual = dataclasses.replace(virtual, truth=dataclasses.replace(virtual.truth, axes={"X": axis}))
    log = virtual.record(random_trajectory(virtual, 16.0, 3), seed=3).to_log()
    path = Machine.load("emps").path.parent
    text = (path / "machine.yaml").read_text(encoding="utf-8").split("columns:")[0]
    (tmp_path / "emps.urdf").write_text((path / "emps.urdf").read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "machine.yaml").write_text(
        f"{text}\neffort: {{law: pd, kp: 60.0, kd: 1.0}}\n", encoding="utf-8"
    )
    known = pt.identify("emps", log, loop=False)
    alone = log.with_channels({k: x for k, x in log.channels.items() if k != "X.u"})
    found = pt.identify(tmp_path, alone, loop=False)
    assert found.parameters["X.coulomb.c"].unit == "law"
    found.save(tmp_path / "twin")
    u = pt.Twin.load(tmp_path / "twin").motion(alone).u[:, 0]
    assert np.corrcoef(u, known.motion(log).u[:, 0])[0, 1] > 0.99
    for name in ("viscous.b", "coulomb.c"):
        size = found.quality["sizes"]["X"]["size"]
        ratios = [
            one.parameters[f"X.{name}"].value * unit / one.theta[0]
            for one, unit in ((known, 1.0), (found, size))
        ]
        assert ratios[1] == pytest.approx(ratios[0], rel=0.05)
