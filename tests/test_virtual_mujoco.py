"""MuJoCo as second engine: the same machine, command and controllers agree to 0.1 %."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual import columns as c
from pinotwin.virtual.control import N_STATE, control_step
from pinotwin.virtual.folder import read_folder
from pinotwin.virtual.friction import friction_force
from pinotwin.virtual.tree import gravity_at, tree_of
from tests.true_poles import smooth
from tests.virtual_motion import forward_dynamics

PERIOD, SUBSTEPS = 1 / 4000.0, 16


def machine_as_shipped(folder, law: str) -> VirtualMachine:
    """A machine whose truth is its URDF; friction ``none`` (viscous only) or ``lugre``."""
    found = read_folder(folder)
    axes = {
        name: replace(axis, bend=None, friction=replace(axis.friction, kind=law), ripple=(), tilt=(0, 0, 0))
        for name, axis in found.truth.axes.items()
    }
    truth = replace(found.truth, axes=axes, inertial_error=(0.0, 0.0), substeps=16)
    return VirtualMachine.build(replace(found, truth=truth), withhold=["position_table"])


def mujoco_model(folder, machine: VirtualMachine):
    """The same URDF in MuJoCo, its joints found by name, friction and limits left to us."""
    name = folder.name
    text = (folder / f"{name}.urdf").read_text()
    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", text, flags=re.DOTALL)
    options = '<mujoco><compiler fusestatic="false" balanceinertia="false"/></mujoco>'
    text = re.sub(r"(<robot [^>]*>)", r"\1" + options, text, count=1)
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = PERIOD / SUBSTEPS
    model.opt.gravity[:] = (0.0, 0.0, -9.81)
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.jnt_limited[:] = 0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, n) for n in machine.joints]
    model.dof_armature[ids] = machine.true.armature
    return model, np.array(ids)


def run_in_mujoco(folder, machine: VirtualMachine, trajectory, seconds: float):
    """Step MuJoCo under the machine's own controllers and friction; returns q and u at 4 kHz."""
    model, ids = mujoco_model(folder, machine)
    data = mujoco.MjData(model)
    P = machine.tables().P
    P[:, c.RESOLUTION] = 0.0
    n, na, dt = int(seconds / PERIOD), len(machine.axes), PERIOD / SUBSTEPS
    qr, vr, ar = trajectory.at(np.arange(n) * PERIOD, machine.axes)
    at = ids[machine.tables().joint]
    data.qpos[at] = qr[0]
    hold = gravity_at(machine.true, data.qpos[ids].copy())[machine.tables().joint]
    control, z, extra = np.zeros((na, N_STATE)), np.zeros((na, c.N_STATES)), np.zeros((2, na))
    control[:, 0] = hold
    control[:, 2] = np.where(P[:, c.PID] > 0.5, 0.0, qr[0])
    u = hold.copy()
    q, effort = np.zeros((n, na)), np.zeros((n, na))
    bandwidth = [machine.truth.axes[a].controller.current_bandwidth for a in machine.axes]
    keep = np.exp(-2.0 * np.pi * np.array(bandwidth) * dt)
    mean = (1.0 - keep) / (2.0 * np.pi * np.array(bandwidth) * dt)
    target, f = np.zeros(na), np.zeros(na)
    for k in range(n):
        q[k], effort[k] = data.qpos[at], u
        for i in range(na):
            command = (qr[k, i], vr[k, i], ar[k, i])
            target[i] = control_step(P, i, control, command, q[k, i], PERIOD)
        for _ in range(SUBSTEPS):
            push = target + mean * (u - target)
            u = target + keep * (u - target)
            for i, j in enumerate(at):
                load = push[i] - f[i]
                f[i] = friction_force(P, i, data.qpos[j], data.qvel[j], z, load, extra, dt)
            data.qfrc_applied[at] = push - f
            mujoco.mj_step(model, data)
    return q, effort


@pytest.mark.parametrize(("name", "law"), [("trunnion", "none"), ("laser_driller", "lugre")])
def test_both_engines_agree(urdf_dir, name, law):
    machine = machine_as_shipped(urdf_dir / name, law)
    machine = replace(machine, truth=replace(machine.truth, log_rate=4000.0))
    seconds = 1.5
    trajectory = random_trajectory(machine, seconds, 5, dwell=(0.01, 0.05))
    ours = machine.record(trajectory, seed=0, noise=False)
    q, u = run_in_mujoco(urdf_dir / name, machine, trajectory, seconds)
    moved = 0
    for i, axis in enumerate(machine.axes):
        reference = ours.log[f"{axis}.q"]
        moved += np.ptp(reference) > 0.01
        error = ours.log[f"{axis}.qr"] - reference
        assert np.std(q[:, i] - reference) <= 1e-3 * max(np.std(reference), 1e-5)
        assert np.std(q[:, i] - reference) <= 1e-2 * np.std(error)
        scale = np.sqrt(np.mean(ours.log[f"{axis}.u"] ** 2))
        assert np.std(u[:, i] - ours.log[f"{axis}.u"]) <= 1e-3 * scale, axis
    assert moved >= 2


def test_free_motion_without_friction_is_mujocos(urdf_dir):
    """No controller at all: the driller falls and swings the same in both engines."""
    folder = urdf_dir / "laser_driller"
    machine = machine_as_shipped(folder, "none")
    model, ids = mujoco_model(folder, machine)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, v, tau = rng.standard_normal((3, len(ids)))
        data.qpos[ids], data.qvel[ids], data.qfrc_applied[ids] = q, v, tau
        mujoco.mj_forward(model, data)
        expected = forward_dynamics(tree_of(machine.true), q, v, tau)
        np.testing.assert_allclose(data.qacc[ids], expected, rtol=1e-8, atol=1e-8)


def test_smooth_tables_have_no_friction(urdf_dir):
    machine = VirtualMachine.load(urdf_dir / "trunnion")
    tables = smooth(machine.tables())
    assert np.all(tables.P[:, c.LAW] == c.NONE)
    assert not tables.ripple.any()
