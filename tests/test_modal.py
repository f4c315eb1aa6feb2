"""Modes against closed forms, the tap tests of the source, and the time domain."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

from pinotwin.analysis.modal import animate, modes
from pinotwin.cli.main import main
from pinotwin.errors import MachineError
from pinotwin.machine import Machine


@pytest.fixture(scope="module")
def rig() -> Machine:
    return Machine.load("flexure_rig")


def test_rig_has_the_modes_of_appendix_a(rig: Machine) -> None:
    """20 Hz held, 34.6 Hz free; the whole tree gives 21.1/35.0 at 0 and 19.7/33.0 Hz at 90 deg."""
    for angle, held, free in ((0.0, 21.11, 34.99), (np.pi / 2, 19.66, 32.99)):
        assert modes(rig, {"A": angle})[0].frequency == pytest.approx(held, abs=0.01)
        assert modes(rig, {"A": angle}, locked=["A", "C"])[0].frequency == pytest.approx(free, abs=0.01)
    assert modes(rig, {"A": 1.3})[0].frequency == pytest.approx(20.0, rel=0.01)
    assert modes(rig, {"A": np.pi / 2}, locked="none")[0].frequency == pytest.approx(34.6, rel=0.01)
    assert modes(rig)[0].damping == pytest.approx(0.05, rel=0.1)


def test_one_degree_of_freedom_in_closed_form(rig: Machine) -> None:
    part = rig.passive["delta"]
    inertia = pin.crba(rig.model, rig.model.createData(), rig.posture())[1, 1]
    wn = np.sqrt(part.stiffness / inertia)  # type: ignore[operator]
    mode = modes(rig, gravity=False)[0]
    assert mode.frequency == pytest.approx(wn / (2 * np.pi), rel=1e-12)
    assert mode.damping == pytest.approx(part.damping / (2 * inertia * wn), rel=1e-12)  # type: ignore[operator]
    np.testing.assert_allclose(mode.energy, [0, 1, 0, 0], atol=1e-12)
    assert np.vdot(mode.shape, mode.shape).real * inertia == pytest.approx(1.0)


def test_a_free_tilting_axis_is_a_pendulum(rig: Machine) -> None:
    M = pin.crba(rig.model, rig.model.createData(), rig.posture())[2, 2]
    moment = 6.0 * 0.0796 + 4.3 * 0.095
    slow = modes(rig, locked=["Y", "C"], stiffness={"delta": 1e12})[0]
    assert slow.frequency == pytest.approx(np.sqrt(moment * 9.81 / M) / (2 * np.pi), rel=1e-4)
    assert len(modes(rig, {"A": np.pi}, locked=["Y", "C"])) == 1  # upside down it falls


def test_a_closed_servo_couples_with_the_flexure(rig: Machine) -> None:
    """The characteristic determinant of the undamped machine is zero at each frequency."""
    k = {"Y": 2e6, "A": 3e3, "C": 500.0}
    found = modes(rig, {"A": 0.7}, stiffness=k, damping={"delta": 0.0}, gravity=False)
    M = pin.crba(rig.model, rig.model.createData(), rig.posture({"A": 0.7}))
    M = np.triu(M) + np.triu(M, 1).T
    K = np.diag([k["Y"], rig.passive["delta"].stiffness, k["A"], k["C"]])  # type: ignore[list-item]
    assert len(found) == 4
    for mode in found.modes:
        f = mode.frequency

        def det(x: float) -> float:
            return float(np.linalg.det(K / 1e4 - (2 * np.pi * x) ** 2 * M / 1e4))

        assert brentq(det, 0.999 * f, 1.001 * f, xtol=1e-10) == pytest.approx(f, rel=1e-9)
        assert mode.energy.sum() == pytest.approx(1.0)
        assert mode.damping == pytest.approx(0.0, abs=1e-9)


def test_free_vibration_in_time_follows_the_mode(rig: Machine) -> None:
    """Integrate Pinocchio's forward dynamics with Y free, from the shape, and count periods."""
    found = modes(rig, locked=["A", "C"], damping={"delta": 0.0}, gravity=False)
    shape = np.real(found[0].shape)
    model, data = rig.model, rig.model.createData()
    q, v, h = 1e-5 * shape / np.abs(shape).max(), np.zeros(4), 2e-5
    k = rig.passive["delta"].stiffness
    crossings, last = [], q[1]
    for i in range(7500):
        M = pin.crba(model, data, q)[:2, :2]
        M = np.array([[M[0, 0], M[0, 1]], [M[0, 1], M[1, 1]]])
        v[:2] += h * np.linalg.solve(M, [0.0, -k * q[1]])  # type: ignore[operator]
        q = q + h * v
        if last > 0 >= q[1]:
            crossings.append(i * h)
        last = q[1]
    assert 1.0 / np.mean(np.diff(crossings)) == pytest.approx(found[0].frequency, rel=2e-3)


def test_unknown_names_and_springs_are_refused(rig: Machine) -> None:
    with pytest.raises(MachineError, match="no axis 'Z'; known"):
        modes(rig, locked=["Z"])
    with pytest.raises(MachineError, match="no axis 'delt'; did you mean 'delta'"):
        modes(rig, stiffness={"delt": 1.0})
    soft = replace(rig, passive={"delta": replace(rig.passive["delta"], stiffness=None)})
    with pytest.raises(MachineError, match="'delta' has no stiffness; give `passive:"):
        modes(soft)
    assert modes(soft, stiffness={"delta": 59280.0})[0].frequency > 20
    assert len(modes(Machine.load("trunnion"))) == 0


def test_animation_shows_one_period(rig: Machine) -> None:
    found = modes(rig)
    t, q = animate(found, 1, 0.1)
    np.testing.assert_allclose(q[0], q[-1], atol=1e-12)
    assert np.ptp(q[:, 1]) == pytest.approx(0.2)
    assert t[0] == 0.0
    with pytest.raises(MachineError, match=r"no mode 2: 1 vibration\(s\) at this posture \(21.1 Hz\)"):
        animate(found, 2, 0.1)


def test_view_writes_a_page_with_the_mode(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "mode.html"
    words = ["view", "flexure_rig", "--mode", "1", "--html", str(page)]
    assert main([*words, "--posture", "A=90deg"]) == 0
    assert "mode 1: 19.66 Hz" in capsys.readouterr().out
    assert "MeshCat" in page.read_text()
    assert main([*words, "--free", "Q"]) == 2
    assert main(["view", "flexure_rig", "--free", "--html", str(page)]) == 2
    assert "--free belongs to --mode N" in capsys.readouterr().err
