"""The flexible twin end to end: one short log of the virtual rig, judged as chapter 7 judges the real one."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import yaml
from scipy.signal import butter, sosfiltfilt

from pinotwin.analysis.disturbance import reacting
from pinotwin.analysis.modal import animate, servo_modes
from pinotwin.cli.main import main as command_line
from pinotwin.diagnosis import diagnose
from pinotwin.log import Log
from pinotwin.report import identification_report
from pinotwin.simulation import wide_loops
from pinotwin.trajectories.moves import random_trajectory
from pinotwin.twin import Twin
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual import columns as c
from tests.conftest import ROOT
from tests.test_examples import example

rig_moves = example("rig_moves")

SECONDS = 6.0


@cache
def found() -> dict:
    return example("flexure_twin").main(SECONDS)


@pytest.fixture(autouse=True)
def _at_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


@cache
def unseen() -> tuple[Log, tuple[np.ndarray, ...]]:
    """Return a log with the limits of Table C-1, and the true vibration at its rows."""
    vm = VirtualMachine.load("urdf/flexure_rig")
    path = random_trajectory(vm, SECONDS, 12, rig_moves.limits_c1(vm))
    run = vm.record(path, seed=2)
    return run.to_log(), run.truth.joint("delta")


def true_poles(lag: float = 3e-4) -> np.ndarray:
    """Return the poles of A and the link with Y at rest, from the sealed truth [rad/s].

    Bodies count from the ground as in Eq. 5.4; inertias are means over the travel of A.
    """
    vm = VirtualMachine.load("urdf/flexure_rig")
    tables = vm.tables()
    k, damper = tables.springs[0, :2]
    kp, kd, ki = (tables.P[1, i] for i in (c.KP, c.KV, c.KI))
    b = vm.truth.axes["A"].friction.viscous
    postures = [np.array([0, 0, a, 0]) for a in np.linspace(-1.4, 1.4, 29)]
    M = np.mean([vm.inertia(q) for q in postures], axis=0)
    I, IA = M[1, 1] - 2 * M[1, 2] + M[2, 2], M[2, 2]
    A = np.zeros((6, 6))  # q_A', q_d, their rates, integral of e, filtered effort
    A[0, 2] = A[1, 3] = 1.0
    A[2, [2, 3, 5]] = np.array([-b, b, 1.0]) / IA
    A[3, [1, 2, 3, 5]] = np.array([-k, b, -damper - b, -1.0]) / I
    A[4, :2] = -1.0, 1.0
    A[5] = np.array([-kp, kp, -kd, kd, ki, -1.0]) / lag
    return np.linalg.eigvals(A)


def test_all_four_figures_beat_the_source() -> None:
    """Means <= 4.08 % on the trained and <= 4.5 % on the unseen trajectory, from the command alone."""
    rows = found()["rows"]
    for what in ("spring as states", "3 x 3 of order 7"):
        assert np.mean(rows["Table 7-4", what]) < 2.0
        assert np.mean(rows["Table C-2", what]) < 4.5
    # the measurement by which the default was chosen: no worse, and without a further pair of poles
    states, wide = (
        np.mean([rows[t, what] for t in ("Table 7-4", "Table C-2", "Fig. 7-2")])
        for what in ("spring as states", "3 x 3 of order 7")
    )
    assert states < 1.02 * wide


def test_inter_axis_vibration_and_posture() -> None:
    """The zones of Fig. 7-2: the ringing that A leaves in e_Y at constant speed; Y in e_A by its tilt."""
    twin = found()["twin"]
    vm = VirtualMachine.load("urdf/flexure_rig")
    log = vm.record(rig_moves.zones(vm), seed=5).to_log()
    predicted = twin.simulate(log)
    steady = (log.t > 1.0) & (log.t < 3.4)  # zone A: Y at 0.05 m/s, A starts and stops
    sos = butter(2, (8.0, 40.0), "bandpass", fs=400.0, output="sos")
    e, x = (sosfiltfilt(sos, y) for y in (log["Y.qr"] - log["Y.q"], predicted["Y.e"]))
    assert np.std(e[steady]) > 1e-6
    assert np.std((x - e)[steady]) < 0.1 * np.std(e[steady])
    e = log["A.qr"] - log["A.q"]
    for start in (8.5, 11.0):  # zone C: 72 deg and less
        part = (log.t > start) & (log.t < start + 1.5)
        assert np.std((predicted["A.e"] - e)[part]) < 0.2 * np.std(e[part])


def test_structural_pole_of_the_7th_order_loop() -> None:
    """Within 2 % in frequency and 20 % in damping of the sealed truth."""
    loop = wide_loops(found()["twin"])["A"]
    assert (loop.structure.order, loop.disturbances) == (7, ("d", "delta"))
    assert loop.outputs == ("e", "u", "delta.v")
    wn, zeta = loop.pole_pairs[1]
    true = min((s for s in true_poles() if s.imag > 0), key=lambda s: abs(s.imag - wn))
    assert wn == pytest.approx(abs(true), rel=0.02)
    assert zeta == pytest.approx(-true.real / abs(true), rel=0.20)


def test_hammer_pulses_at_32_and_73_degrees() -> None:
    for tilt, errors in found()["hits"].items():
        assert max(errors) < 10.0, tilt


def test_vibration_from_the_command_alone() -> None:
    log, (q, v, a) = unseen()
    predicted = found()["twin"].simulate(log)
    for true, kind, limit in ((v, "v", 0.05), (a, "a", 0.1)):
        x = predicted[f"delta.{kind}"]
        assert np.sqrt(np.mean((x - true) ** 2) / np.mean(true**2)) < limit
    x = predicted["delta.q"]  # a load that never moves is invisible: the mean is not judged
    assert np.std(x - q) < 0.05 * np.std(q)


def test_the_twin_survives_the_disk_and_writes_its_spring(tmp_path) -> None:
    twin = found()["twin"]
    folder = twin.save(tmp_path / "twin")
    spring = yaml.safe_load((folder / "machine.yaml").read_text())["passive"]["delta"]
    k, damper = found()["spring"]
    assert spring["stiffness"] == pytest.approx(k)
    assert spring["damping"] == pytest.approx(damper)
    log, _ = unseen()
    asked = Log({n: log[n][:400] for n in ("t", "Y.qr", "A.qr", "C.qr")})
    again = Twin.load(folder)
    for loops in ("black", "vibration"):
        a, b = (x.simulate(asked, controller=loops) for x in (twin, again))
        np.testing.assert_allclose(a["delta.v"], b["delta.v"], rtol=1e-6, atol=1e-9)
    rows = np.column_stack(list(asked.channels.values()))
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(asked.channels), comments="")
    out = tmp_path / "out.csv"
    assert command_line(["simulate", str(folder), str(tmp_path / "log.csv"), "--out", str(out)]) == 0
    header = out.read_text().partition("\n")[0].split(",")
    assert {"delta.q", "delta.v", "delta.a", "Y.e", "A.u"} <= set(header)


def test_loops_are_tied_to_the_mass() -> None:
    """u - d moves the known mass: the rows agree at any frequency (1 N at 1 kHz moves 1/M)."""
    twin = found()["twin"]
    for axis in "YA":
        assert twin.quality["loops"][axis]["tied"]["taken"]
        i = twin.machine.axes[axis].index
        M, C = (twin.diagonal[k][i] for k in ("inertia", "viscous"))
        for s in (5j, 200j, -30 + 900j):
            G = [np.divide(*(np.polyval(p, s) for p in twin.loops[axis].numerator(y, "d"))) for y in "eu"]
            assert G[1] == pytest.approx(1 - (M * s**2 + C * s) * G[0], rel=1e-6)


def test_modes_with_the_servo_closed() -> None:
    """Against the eigenvalues of the true machine under its true PID: Y, link and A together."""
    vm = VirtualMachine.load("urdf/flexure_rig")
    P, M = vm.tables().P, vm.inertia()
    k, damper = vm.tables().springs[0, :2]
    n, lag, motors = 4, 5e-4, (0, 2, 3)
    A = np.zeros((2 * n + 6, 2 * n + 6))
    A[:n, n : 2 * n] = np.eye(n)
    inverse = np.linalg.inv(M)
    b = [vm.truth.axes[name].friction.viscous for name in "YAC"]
    A[n : 2 * n, 1] = -inverse[:, 1] * k
    A[n : 2 * n, n : 2 * n] = -inverse @ np.diag([b[0], damper, b[1], b[2]])
    for i, j in enumerate(motors):
        e, u = 2 * n + i, 2 * n + 3 + i
        A[e, j] = -1.0
        A[n : 2 * n, u] += inverse[:, j]
        A[u, [j, n + j, e, u]] = np.array([-P[i, c.KP], -P[i, c.KV], P[i, c.KI], -1.0]) / lag
    modes = servo_modes(found()["twin"])
    light = [s for s in np.linalg.eigvals(A) if s.imag > 0 and -s.real / abs(s) < 0.5]
    assert len(modes) == len(light) == 1
    assert modes[0].frequency == pytest.approx(abs(light[0]) / (2 * np.pi), rel=0.02)
    assert modes[0].damping == pytest.approx(-light[0].real / abs(light[0]), rel=0.2)
    assert modes.locked == ()
    t, q = animate(modes, 1, 0.05)
    assert q.shape == (len(t), 4)
    assert np.ptp(q[:, 1]) > 0.0


def test_view_shows_the_mode_with_the_servo_closed(tmp_path, capsys) -> None:
    folder, page = found()["twin"].save(tmp_path / "twin"), tmp_path / "mode.html"
    words = ["view", str(folder), "--posture", "A=30deg", "--mode", "1", "--html", str(page)]
    assert command_line([*words, "--servo"]) == 0
    closed = capsys.readouterr().out
    mode = servo_modes(found()["twin"], {"A": np.radians(30.0)})[0]
    assert f"mode 1: {mode.frequency:.2f} Hz, damping {mode.damping:.3f}" in closed
    assert page.stat().st_size > 100_000
    assert command_line(["view", str(folder), "--servo"]) == 2
    assert "--servo belongs to --mode" in capsys.readouterr().err


def test_report_shows_the_vibration_and_the_poles() -> None:
    log, _ = unseen()
    page = identification_report(found()["twin"], log)
    for words in (
        "Structural flexibility",
        "Spring of delta",
        "Loops with the vibration as output",
    ):
        assert words in page


def test_which_axis_sits_on_a_passive_joint() -> None:
    assert reacting(found()["twin"].machine) == {"delta": "A"}


def test_a_flexible_twin_is_diagnosed_with_its_joint_bent_as_it_foretells() -> None:
    """Its rows are the flexible machine's: without the deflection the twin would not fit them."""
    said = diagnose(found()["twin"], unseen()[0], quick=True)
    assert said.gap["A"]["u"].nrmse < 0.03
    assert "delta" not in said.gap  # nothing was measured of it
