"""A virtual machine as a whole: tracking, sticking, sensors, repeats, limits of what it may say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicSpline

from pinotwin.dynamics import frame_rotation
from pinotwin.errors import InputError, MachineError
from pinotwin.logs.write import write_log
from pinotwin.trajectories.moves import Trajectory, rest
from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual.axis_truth import Friction
from pinotwin.virtual.folder import Folder, read_folder, read_truth
from pinotwin.virtual.imu import link_motion
from pinotwin.virtual.truth import Pulse, Truth
from tests.true_poles import closed_loop_poles
from tests.virtual_motion import inverse_dynamics

BUNDLED = ("trunnion", "laser_driller", "flexure_rig", "emps", "tx40")


@pytest.fixture(scope="module")
def trunnion(urdf_dir) -> VirtualMachine:
    return VirtualMachine.load(urdf_dir / "trunnion")


@pytest.fixture(scope="module")
def run(trunnion):
    return trunnion.record(random_trajectory(trunnion, 6.0, 1), seed=1)


def standstill(machine: VirtualMachine, seconds: float = 2.0) -> Trajectory:
    home = {n: float(np.mean(lim.travel)) for n, lim in machine.limits.items()}
    return Trajectory(seconds, {n: rest(q) for n, q in home.items()})


def with_truth(folder: Path, **changes) -> VirtualMachine:
    found = read_folder(folder)
    return VirtualMachine.build(replace(found, truth=replace(found.truth, **changes)))


@pytest.mark.parametrize("name", BUNDLED)
def test_every_bundled_machine_tracks(urdf_dir, name):
    machine = VirtualMachine.load(urdf_dir / name)
    r = machine.record(random_trajectory(machine, 5.0, 2), seed=1)
    assert closed_loop_poles(machine).real.max() < 0.0
    for axis in machine.axes:
        e = r.log[f"{axis}.qr"] - r.log[f"{axis}.q"]
        span = machine.scales[axis].travel
        assert np.abs(e).max() < 0.03 * span
        assert np.abs(e[:100]).max() < 1e-3 * span
        assert np.abs(r.log[f"{axis}.u"]).max() < machine.truth.axes[axis].controller.effort_limit


def test_a_folder_without_sealed_truth_runs_by_rules(tmp_path):
    text = """<robot name="r"><link name="base"/>
      <link name="a"><inertial><origin xyz="0 0 0.1"/><mass value="4"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="b"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
        <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="s" type="prismatic"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
        <limit lower="-0.3" upper="0.3" velocity="0.5" effort="100"/></joint>
      <joint name="r" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
      </joint></robot>"""
    urdf = tmp_path / "r.urdf"
    urdf.write_text(text)
    machine = VirtualMachine.build(Folder("r", urdf, {"S": "s", "R": "r"}, {}, Truth()))
    r = machine.record(random_trajectory(machine, 5.0, 2), seed=1)
    for axis in ("S", "R"):
        e = r.log[f"{axis}.qr"] - r.log[f"{axis}.q"]
        assert np.abs(e).max() < 0.02 * machine.scales[axis].travel
    weight = np.median(r.log["S.u"])
    assert weight == pytest.approx(9.81 * sum(body.mass for body in machine.true.inertias), rel=0.2)


def test_efforts_obey_the_true_dynamics(trunnion):
    """Noise-free: motor effort = rigid body + armature + friction + ripple and cables."""
    bare = VirtualMachine.build(
        replace(read_folder_of(trunnion), truth=trunnion.truth),
        withhold=["ripple", "position_table"],
    )
    r = bare.record(random_trajectory(bare, 4.0, 3), seed=0, noise=False, truth_rate=4000.0)
    tau = inverse_dynamics(r.truth) + r.truth.friction
    for i, axis in enumerate(bare.axes):
        # The kernel holds M and h over a period and the truth's rows are at its edges.
        rms = np.sqrt(np.mean((tau[1:, i] - r.truth.u[1:, i]) ** 2))
        assert rms < 5e-3 * np.sqrt(np.mean(r.truth.u[:, i] ** 2)), axis


def read_folder_of(machine: VirtualMachine) -> Folder:
    return read_folder(Path(__file__).resolve().parents[1] / "urdf" / machine.name)


def test_halving_the_step_changes_little(trunnion):
    trajectory = random_trajectory(trunnion, 3.0, 5)
    coarse = trunnion.record(trajectory, seed=0, noise=False)
    timing = trunnion.timing._replace(updates=4, substeps=4)
    fine = replace(trunnion, timing=timing).record(trajectory, seed=0, noise=False)
    for axis in trunnion.axes:
        for k, signal in (("q", 1e-6), ("u", 1e-2)):
            gap = np.abs(fine.log[f"{axis}.{k}"] - coarse.log[f"{axis}.{k}"]).max()
            assert gap < signal * np.ptp(fine.log[f"{axis}.{k}"])


def test_energy_falls_without_motors_and_never_rises(tmp_path):
    """A pendulum with LuGre friction, left alone: mechanical energy falls until it sticks."""
    text = """<robot name="p"><link name="base"/>
      <link name="a"><inertial><origin xyz="0 0 -0.3"/><mass value="2"/>
        <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="j" type="revolute"><parent link="base"/><child link="a"/><axis xyz="1 0 0"/>
        <limit lower="-2" upper="2" velocity="3" effort="10"/></joint></robot>"""
    urdf = tmp_path / "p.urdf"
    urdf.write_text(text)
    machine = VirtualMachine.build(Folder("p", urdf, {"J": "j"}, {}, Truth()))
    axis = machine.truth.axes["J"]
    free = replace(axis.controller, kp=0.0, kv=0.0, ki=0.0, acceleration_feedforward=0.0)
    axis = replace(axis, controller=free, friction=Friction("lugre", 0.5, 1.3, 0.02, 0.01, 1e-4))
    machine = replace(machine, truth=replace(machine.truth, axes={"J": axis}))
    push = Pulse("a", 0.2, 0.2, moment=(12.0, 0.0, 0.0))
    r = machine.record(standstill(machine, 14.0), seed=0, noise=False, external=[push])
    q, v, _ = r.truth.joint("j")
    M = machine.inertia()[0, 0]
    body = machine.true.inertias[1]
    weight = 9.81 * body.mass * np.linalg.norm(body.lever)
    angle = np.arctan2(body.lever[1], -body.lever[2])
    energy = 0.5 * M * v**2 - weight * np.cos(q + angle)
    after = energy[r.truth.t > 0.41]
    assert after[0] - after[-1] > 0.5
    assert np.diff(after).max() < 1e-3 * (after[0] - after[-1])
    assert np.ptp(q[-500:]) < 1e-7  # it stuck


def test_nothing_creeps_at_standstill(trunnion):
    r = trunnion.record(standstill(trunnion, 6.0), seed=0, noise=False)
    for name in trunnion.joints:
        q, v, _ = r.truth.joint(name)
        assert np.ptp(q[r.truth.t > 5.0]) < 1e-9
        assert np.abs(v[r.truth.t > 5.0]).max() < 1e-8


def test_the_seed_decides_everything(trunnion, run):
    again = trunnion.record(random_trajectory(trunnion, 6.0, 1), seed=1)
    for name, x in run.log.items():
        np.testing.assert_array_equal(x, again.log[name])


def test_repeats_differ_by_noise_and_scatter_only(trunnion, run):
    trajectory = random_trajectory(trunnion, 6.0, 1)
    other = trunnion.record(trajectory, seed=2)
    for axis in trunnion.axes:
        np.testing.assert_array_equal(run.log[f"{axis}.qr"], other.log[f"{axis}.qr"])
        gap = np.std(run.log[f"{axis}.u"] - other.log[f"{axis}.u"])
        assert 0.0 < gap < 0.08 * np.sqrt(np.mean(run.log[f"{axis}.u"] ** 2))
    quiet = [trunnion.record(trajectory, seed=s, noise=False) for s in (1, 2)]
    for name, x in quiet[0].log.items():
        np.testing.assert_array_equal(x, quiet[1].log[name])


def test_friction_scatters_from_run_to_run_by_what_is_asked(trunnion):
    drawn = [trunnion.scattered(np.random.default_rng(s)) for s in range(400)]
    for field in ("coulomb", "viscous"):
        base = getattr(trunnion.truth.axes["Y"].friction, field)
        share = np.array([getattr(t.axes["Y"].friction, field) for t in drawn]) / base
        assert share.std() == pytest.approx(trunnion.truth.scatter, rel=0.12)
        assert share.mean() == pytest.approx(1.0, abs=0.002)


def test_readings_lie_on_the_grids_of_the_sensors(trunnion, run):
    for axis in trunnion.axes:
        spec = trunnion.truth.axes[axis]
        for channel, step in (("q", spec.encoder.resolution), ("u", spec.effort.resolution)):
            steps = run.log[f"{axis}.{channel}"] / step
            np.testing.assert_allclose(steps, np.round(steps), atol=1e-5)
            assert len(np.unique(np.round(steps))) > 50


def test_the_noise_is_what_the_file_says(trunnion):
    r = trunnion.record(standstill(trunnion, 20.0), seed=3)
    spec = trunnion.truth.axes["Y"].effort
    i = r.truth.axes.index("Y")
    noise = r.log["Y.u"] - r.truth.u[:, i]
    expected = np.sqrt(spec.white**2 + spec.coloured**2 + spec.resolution**2 / 12)
    assert noise.std() == pytest.approx(expected, rel=0.05)


def test_the_csv_follows_the_contract(trunnion, run, tmp_path):
    path = tmp_path / "log.csv"
    write_log(path, run.log)
    head = path.read_text().splitlines()[0].split(",")
    assert head[0] == "t"
    assert set(head[1:]) == {f"{a}.{s}" for a in "YAC" for s in ("qr", "q", "u")}
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    for k, name in enumerate(head):
        np.testing.assert_allclose(table[:, k], run.log[name], rtol=1e-11, atol=1e-14)
    write_log(tmp_path / "log.parquet", run.log)
    with pytest.raises(InputError, match="csv or"):
        write_log(tmp_path / "log.txt", run.log)
    assert len(run.to_log()) == len(run.log["t"])


def test_log_and_truth_rates(trunnion):
    r = trunnion.record(random_trajectory(trunnion, 2.0, 1), seed=1, truth_rate=2000.0)
    assert np.allclose(np.diff(r.log["t"]), 1.0 / 500.0)
    assert np.allclose(np.diff(r.truth.t), 1.0 / 2000.0)
    with pytest.raises(MachineError, match="does not divide"):
        trunnion.record(random_trajectory(trunnion, 2.0, 1), seed=1, truth_rate=3000.0)


def test_link_motion_is_what_the_placement_of_the_link_says(trunnion):
    """Rates and acceleration of the table, in its own axes, against differences of its placement."""
    r = trunnion.record(random_trajectory(trunnion, 2.0, 4), seed=1, noise=False, truth_rate=4000.0)
    t, q = r.truth.t, r.truth.q
    motion = link_motion(r.truth, "table")
    shipped = [CubicSpline(t, f(trunnion.model, "table", q)) for f in (frame_rotation, frame_position)]
    turning = np.einsum("nji,njk->nik", motion.R, shipped[0](t, 1))  # R^T dR/dt = [w]
    acceleration = np.einsum("nji,nj->ni", motion.R, shipped[1](t, 2))
    np.testing.assert_allclose(motion.R, shipped[0](t), atol=1e-10)
    np.testing.assert_allclose(motion.w, turning[:, [2, 0, 1], [1, 2, 0]], atol=2e-4)
    off = np.median(np.abs(motion.a - acceleration), axis=0)
    assert np.all(off < 1e-2 * np.abs(acceleration).max(axis=0) + 1e-3)


def frame_position(model: pin.Model, frame: str, q: np.ndarray) -> np.ndarray:
    """Origin of a frame in the world [m], shape (n, 3)."""
    data, index = model.createData(), model.getFrameId(frame, pin.FrameType.BODY)
    places = []
    for row in q:
        pin.framesForwardKinematics(model, data, row)
        places.append(data.oMf[index].translation.copy())
    return np.array(places)


def test_the_flexure_rings_at_its_tap_tested_frequencies(urdf_dir):
    """20 Hz with Y held, 34.6 Hz free (Appendix A): from M and k, and from a ringing free decay."""
    machine = VirtualMachine.load(urdf_dir / "flexure_rig")
    j, y = machine.layout.passive["delta"], machine.layout.drive["Y"]
    M, stiffness = machine.inertia(), machine.tables().springs[0, 0]
    held = np.sqrt(stiffness / M[j, j]) / (2 * np.pi)
    free = np.sqrt(stiffness / (M[j, j] - M[j, y] ** 2 / M[y, y])) / (2 * np.pi)
    assert held == pytest.approx(20.0, rel=0.02)
    assert free == pytest.approx(34.6, rel=0.02)
    released = _released(machine)
    push = Pulse("delta_link", 0.1, 0.02, moment=(60.0, 0.0, 0.0))
    r = released.record(standstill(released, 1.0), seed=0, noise=False, external=[push])
    v = r.truth.joint("delta")[1]
    late = (r.truth.t > 0.14) & (r.truth.t < 0.6)
    crossings = np.flatnonzero(np.diff(np.sign(v[late])) != 0)
    period = 2.0 * np.mean(np.diff(r.truth.t[late][crossings]))
    assert 1.0 / period == pytest.approx(34.6, rel=0.03)


def _released(machine: VirtualMachine) -> VirtualMachine:
    """The rig with Y loose on its guide: no loop, no friction; A and C stay controlled."""
    y = machine.truth.axes["Y"]
    loose = replace(y.controller, kp=0.0, kv=0.0, ki=0.0)
    y = replace(y, controller=loose, friction=Friction("none", 0.0, viscous=0.0), ripple=(), cable=y.cable)
    truth = replace(machine.truth, axes={**machine.truth.axes, "Y": y})
    return replace(machine, truth=truth)


def test_a_logged_pulse_is_in_the_log_and_moves_the_machine(trunnion):
    pulse = Pulse("A_link", 0.5, 0.05, force=(0.0, 40.0, 0.0))
    calm = trunnion.record(standstill(trunnion), seed=0, noise=False)
    hit = trunnion.record(standstill(trunnion), seed=0, noise=False, external=[pulse])
    assert {f"A_link.{x}" for x in ("fx", "fy", "fz", "mx", "my", "mz")} <= set(hit.log)
    assert hit.log["A_link.fy"].max() == pytest.approx(40.0, rel=1e-2)
    # Impulse balance on Y: what the hammer gives, motor and friction take.
    t, u = hit.truth.t, hit.truth.u[:, 0] - calm.truth.u[:, 0]
    taken = np.trapezoid(u - hit.truth.friction[:, 0] + calm.truth.friction[:, 0], t)
    assert -taken == pytest.approx(40.0 * 0.05 * 2 / np.pi, rel=0.03)
    secret = replace(pulse, logged=False)
    assert "A_link.fy" not in trunnion.record(standstill(trunnion), seed=0, external=[secret]).log
    with pytest.raises(MachineError, match="no link 'Alink'"):
        trunnion.record(standstill(trunnion), seed=0, external=[replace(pulse, link="Alink")])


def test_true_poles_of_a_rigid_axis(trunnion):
    """Against the characteristic polynomial, with its filters, written by hand."""
    k = trunnion.truth.axes["Y"].controller
    M = trunnion.inertia()[0, 0]
    b = trunnion.truth.axes["Y"].friction.viscous
    T, left = 1 / 4000.0, np.exp(-2 * np.pi * k.velocity_filter / 4000.0)
    rate = [T * left / (1 - left) + T / 2, 1.0]  # delay of the sampled filter, backward difference
    lag = [1 / (2 * np.pi * k.current_bandwidth) + T / 2, 1.0]  # current loop, hold
    plant = np.polymul(np.polymul([M, b, 0.0], rate), lag)
    control = np.polyadd(np.polymul([k.kp, k.ki], rate), [k.kv, 0.0, 0.0])
    s = np.roots(np.polyadd(np.polymul(plant, [1.0, 0.0]), control))
    expected = s[np.argsort(np.abs(s))][:3]
    found = closed_loop_poles(trunnion, ["Y"])[:3]
    np.testing.assert_allclose(np.abs(found[:2]), np.abs(expected[:2]), rtol=0.01)
    np.testing.assert_allclose(np.abs(found[2]), np.abs(expected[2]), rtol=0.06)
    np.testing.assert_allclose(np.abs(found[:2].real), np.abs(expected[:2].real), rtol=0.01)


def test_saturation_holds_the_effort_and_recovers(urdf_dir):
    machine = VirtualMachine.load(urdf_dir / "trunnion", inject=["saturation:Y=0.4"])
    r = machine.record(random_trajectory(machine, 6.0, 1), seed=0, noise=False)
    limit = machine.truth.axes["Y"].controller.effort_limit
    assert np.abs(r.log["Y.u"]).max() <= limit * (1 + 1e-9)
    assert np.mean(np.abs(r.log["Y.u"]) > 0.999 * limit) > 0.01
    assert abs(r.log["Y.qr"][-1] - r.log["Y.q"][-1]) < 1e-3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("axes: {Y: {frictoin: {}}}", "did you mean 'friction'"),
        ("axes: {Y: {friction: {coulomb: many}}}", "expected a number, found 'many'"),
        ("log_rte: 5", "did you mean 'log_rate'"),
        ("inertial_error: 3", "expected a list"),
        ("axes: [1", "not YAML"),
        ("axes: {Y: 3}", "expected keys and values"),
        ("axes: {Y: {friction: 0}}", "expected keys and values, found 0"),
        ("payload: {joint: Y}", "expected a list, found"),
        ("inertial_error: [0.1]", r"expected a list of 2, found \[0\.1\]"),
    ],
)
def test_a_bad_sealed_file_is_named(tmp_path, text, message):
    path = tmp_path / "virtual.yaml"
    path.write_text(text)
    with pytest.raises(MachineError, match=message) as caught:
        read_truth(path)
    assert str(path) in str(caught.value)


def test_bad_folders_and_axes_are_named(tmp_path, urdf_dir):
    with pytest.raises(MachineError, match=r"no machine\.yaml"):
        VirtualMachine.load(tmp_path)
    for axes in ("{Y: slide}", "[]"):
        (tmp_path / "machine.yaml").write_text(f"name: rig\nurdf: rig.urdf\naxes: {axes}\n")
        with pytest.raises(MachineError, match="axes and passive are given as name"):
            VirtualMachine.load(tmp_path)
    found = read_folder(urdf_dir / "trunnion")
    with pytest.raises(MachineError, match="no axis 'X'"):
        VirtualMachine.build(replace(found, truth=Truth(axes={"X": found.truth.axes["Y"]})))
    with pytest.raises(MachineError, match="no joint 'Yy'; did you mean 'Y'"):
        VirtualMachine.build(replace(found, axes={"Y": "Yy"}))
