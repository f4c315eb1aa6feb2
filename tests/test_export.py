"""A twin leaves the tool: the exported files give its effort, computed by MuJoCo, the C compiler and NumPy."""

from __future__ import annotations

import ctypes
import dataclasses
import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

import pinotwin as pt
from pinotwin.cli.main import main
from pinotwin.dynamics.batch import inverse
from pinotwin.effects import LISTED, total_effort
from pinotwin.errors import InputError
from pinotwin.export import export_twin
from pinotwin.export.inverse import curve, default_speed, default_travel, inverse_of, sweep
from pinotwin.machine.effect_list import make_effects
from tests.simulated import known_twin, plain_machine

PERCENT = 0.01


def made(name: str) -> pt.Twin:
    """A twin of the bundled machine as it comes, every coefficient of its effects at random."""
    machine = pt.Machine.load(name)
    motion = sweep(machine, default_travel(machine), default_speed(machine))
    for axis, part in machine.axes.items():
        machine = machine.with_effects(axis, tuple(e.fitted_to(motion) for e in part.effects))
    twin = known_twin(machine)
    rng = np.random.default_rng(7)
    theta = twin.theta.copy()
    for effect, s in zip(twin.effects, twin.slices, strict=True):
        if effect.axis is not None and effect.name != "wrist_coupling":
            small = 0.02 if effect.name == "presliding" else 1.0
            theta[s] = small * rng.uniform(0.5, 2.0, s.stop - s.start) * (1.0 if effect.rotary else 20.0)
    wrist = [s for e, s in zip(twin.effects, twin.slices, strict=True) if e.name == "wrist_coupling"]
    for s in wrist:
        theta[s] = 1e-4, 0.5, 2.0
    return dataclasses.replace(twin, theta=theta)


@pytest.fixture(scope="module", params=["trunnion", "flexure_rig", "tx40"])
def twin(request) -> pt.Twin:
    """Two machine tools, one with a passive joint, and a robot whose wrist motor turns two joints."""
    return made(request.param)


def nrmse(found, wanted):
    return np.sqrt(np.mean((found - wanted) ** 2, axis=0) / np.mean(wanted**2, axis=0))


def motion_of(twin):
    found = inverse_of(twin)
    return sweep(twin.machine, found.travel, found.speed, seconds=4.0)


def imported(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.dont_write_bytecode, old = True, sys.dont_write_bytecode
    spec.loader.exec_module(module)
    sys.dont_write_bytecode = old
    return module


def by_numpy(path: Path, motion):
    return imported(path).MODEL.run(motion.q, motion.v, motion.a, motion.step)


def by_c(path: Path, motion):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler (cc) at hand")
    library = path.with_suffix(".so")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O2", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, str(path), "-o", str(library), "-lm"], check=True)
    lib = ctypes.CDLL(str(library))
    array = np.ctypeslib.ndpointer(dtype=float, flags="C_CONTIGUOUS")
    reset, effort, size = (getattr(lib, f"{path.stem}_{x}") for x in ("reset", "effort", "state_size"))
    reset.argtypes = [ctypes.c_void_p, array, array, ctypes.c_double]
    effort.argtypes = [ctypes.c_void_p, array, array, array, array]
    state = ctypes.create_string_buffer(size())
    out = np.zeros(motion.q.shape)
    reset(state, motion.q[0], motion.v[0], motion.step)
    for k in range(len(motion)):
        effort(state, motion.q[k], motion.v[k], motion.a[k], out[k])
    return out


def by_mujoco(path: Path, motion, twin, *, memory: bool):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT  # the sweep is not the machine's travel
    data, out = mujoco.MjData(model), np.zeros(motion.q.shape)
    dofs = np.zeros(twin.machine.nv, dtype=int)
    for part in twin.machine.parts:
        dofs[part.index] = model.joint(part.joint).dofadr[0]
    imported(path.parent / f"{path.stem}_passive.py").install(model, memory=memory)
    try:
        for k in range(len(motion)):
            data.time = motion.t[k]
            data.qpos[dofs], data.qvel[dofs], data.qacc[dofs] = motion.q[k], motion.v[k], motion.a[k]
            mujoco.mj_inverse(model, data)
            out[k] = data.qfrc_inverse[dofs]
    finally:
        mujoco.set_mjcb_passive(None)
    return out


def test_numpy_file_gives_the_twins_effort(twin, tmp_path):
    motion = motion_of(twin)
    export_twin(twin, "numpy", tmp_path / "model.py")
    assert np.all(nrmse(by_numpy(tmp_path / "model.py", motion), twin.effort(motion)) < PERCENT)


def test_numpy_file_imports_nothing_of_ours(twin, tmp_path):
    export_twin(twin, "numpy", tmp_path / "model.py")
    lines = (tmp_path / "model.py").read_text().splitlines()
    modules = {line.split()[1] for line in lines if line.startswith(("import ", "from "))}
    assert modules == {"__future__", "typing", "numpy"}


def test_compiled_c_file_gives_the_twins_effort(twin, tmp_path):
    motion = motion_of(twin)
    export_twin(twin, "c", tmp_path / "model.c")
    assert np.all(nrmse(by_c(tmp_path / "model.c", motion), twin.effort(motion)) < PERCENT)


def test_mujoco_gives_the_twins_effort(twin, tmp_path):
    motion = motion_of(twin)
    export_twin(twin, "mjcf", tmp_path / "model.xml")
    found = by_mujoco(tmp_path / "model.xml", motion, twin, memory=True)
    assert np.all(nrmse(found, twin.effort(motion)) < PERCENT)


def test_mujocos_own_dry_friction_differs_at_reversals_only(tmp_path):
    """`frictionloss` turns round at once, the twin's friction over a small speed: nowhere else do they differ."""
    twin = made("tx40")
    motion = motion_of(twin)
    export_twin(twin, "mjcf", tmp_path / "model.xml")
    found = by_mujoco(tmp_path / "model.xml", motion, twin, memory=False)
    moving = np.all(np.abs(motion.v) > 0.05, axis=1) & (np.abs(motion.v[:, 4] + motion.v[:, 5]) > 0.05)
    assert moving.mean() > 0.5
    assert np.all(nrmse(found[moving], twin.effort(motion)[moving]) < PERCENT)


WITH = {"wrist_coupling": {"with": "A"}, "inertial_coupling": {"with": "A"}}


@pytest.mark.parametrize("name", LISTED)
def test_every_effect_is_exported_or_named_as_left_out(name, tmp_path):
    machine = pt.Machine.load("trunnion")
    for axis in "YAC":
        machine = machine.with_effects(axis, ())
    travel, speed = default_travel(machine), default_speed(machine)
    motion = sweep(machine, travel, speed, seconds=4.0)
    spec = {name: WITH[name]} if name in WITH else name
    effects = make_effects([spec], "Y", False, "effects")
    twin = known_twin(machine.with_effects("Y", tuple(e.fitted_to(motion) for e in effects)))
    size = 0.3 if name == "presliding" else 30.0
    s = twin.slices[1]
    theta = twin.theta.copy()
    theta[s] = size * np.linspace(0.8, 1.2, s.stop - s.start)
    twin = dataclasses.replace(twin, theta=theta)
    made = export_twin(twin, "numpy", tmp_path / "model.py", travel=travel, speed=speed)
    found = by_numpy(tmp_path / "model.py", motion)
    left_out = any(f"Y.{name}" in note for note in made.notes)
    assert left_out or np.all(nrmse(found, total_effort(motion, twin.effects, twin.theta)) < PERCENT)


def test_urdf_has_dynamics_inertials_and_says_what_it_misses(tmp_path):
    twin = known_twin(plain_machine("trunnion"))
    made = export_twin(twin, "urdf", tmp_path / "model.urdf")
    root = etree.parse(str(tmp_path / "model.urdf")).getroot()
    for axis, part in twin.machine.axes.items():
        dynamics = root.find(f"joint[@name='{part.joint}']/dynamics")
        assert float(dynamics.get("damping")) == pytest.approx(twin.coefficients(f"{axis}.viscous")[0])
        assert float(dynamics.get("friction")) == pytest.approx(
            twin.coefficients(f"{axis}.coulomb")[0], rel=0.02
        )
    again = pt.Machine.load(tmp_path / "model.urdf")
    motion = motion_of(twin)
    model = twin.model.copy()
    model.armature[:] = 0.0
    wanted = inverse(model, motion.q, motion.v, motion.a)
    np.testing.assert_allclose(inverse(again.model, motion.q, motion.v, motion.a), wanted, atol=1e-6)
    assert "Y.ripple" in made.notes[0]
    assert "Y.stribeck" in made.notes[0]
    assert "Y.coulomb" not in made.notes[0]
    assert "misses" in made.notes[1]


def test_urdf_and_mjcf_find_meshes_from_elsewhere(tmp_path):
    """`package://` paths mean nothing beside the copy: they are replaced by the files."""
    home = tmp_path / "arm"
    (home / "meshes").mkdir(parents=True)
    stl = b"\0" * 80 + (1).to_bytes(4, "little") + b"\0" * 50
    (home / "meshes" / "link.stl").write_bytes(stl)
    (home / "arm.urdf").write_text(
        """<robot name="arm"><link name="base"/>
        <link name="link"><visual><geometry><mesh filename="package://arm/meshes/link.stl"/></geometry></visual>
        <visual><geometry><mesh filename="package://arm/meshes/absent.dae"/></geometry></visual>
        <inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="link"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    )
    twin = known_twin(pt.Machine.load(home / "arm.urdf"))
    export_twin(twin, "urdf", tmp_path / "out.urdf")
    assert str(home / "meshes" / "link.stl") in (tmp_path / "out.urdf").read_text()
    made = export_twin(twin, "mjcf", tmp_path / "out.xml")
    assert str(home / "meshes" / "link.stl") in (tmp_path / "out.xml").read_text()
    assert any("1 shapes are not drawn" in note for note in made.notes)


def test_command_writes_files_and_json(tmp_path, capsys):
    known_twin(plain_machine("trunnion")).save(tmp_path / "twin")
    out, result = tmp_path / "trunnion.xml", tmp_path / "export.json"
    words = ["export", str(tmp_path / "twin"), "--format", "mjcf", "--out", str(out), "--json", str(result)]
    assert main(words) == 0
    content = json.loads(result.read_text())
    assert {Path(f).name for f in content["files"]} == {"trunnion.xml", "trunnion_passive.py"}
    assert all(Path(f).is_file() for f in content["files"])
    assert content["axes"]["Y"]["unit"] == "N"
    assert content["axes"]["Y"]["error"] < PERCENT
    assert "written" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--format", "sdf", "--out", "x.sdf"], "known: c, mjcf, numpy, urdf"),
        (["--format", "c", "--out", "x.txt"], "is named *.c"),
        (["--format", "c", "--out", "x.c", "--speed", "Q=1"], "no axis 'Q'"),
    ],
)
def test_bad_arguments_are_one_line(words, text, tmp_path, monkeypatch, capsys):
    known_twin(plain_machine("emps")).save(tmp_path / "twin")
    monkeypatch.chdir(tmp_path)
    assert main(["export", "twin", *words]) == 2
    assert text in capsys.readouterr().err
    with pytest.raises(InputError):
        export_twin(pt.Twin.load("twin"), words[1], words[3] if words[1] != "c" else "x.txt")


def test_curve_keeps_its_tolerance_with_few_knots():
    x = np.linspace(0.0, 1.0, 5001)
    y = np.sin(20.0 * x) + 0.2 * x
    made = curve(x, y, 1e-3)
    assert np.abs(np.interp(x, *made) - y).max() <= 1e-3 * (1.0 + 1e-9)
    assert len(made.x) < 200
    assert len(curve(x, np.full_like(x, 3.0), 1e-3).x) == 1


def test_real_robot_by_mujoco_and_c(data_dir, tmp_path):
    """The TX40's twin on its own log: 1 % of the twin's effort, the remainder of the wrist's rotor included.

    A file gives the effort of an instant. The twin's effort of a filtered log has dry friction behind the
    same low-pass, so it is asked without one; the corner's own share is 1 to 3 % where the wrist turns round.
    """
    folder = data_dir / "staubli_tx40"
    log = pt.read(folder / "pos_read_data.csv", folder / "curr_data.csv")
    twin = pt.identify(pt.Machine.load("tx40"), log)
    motion = twin.motion(log).cut(1000, 9000)
    wanted = twin.effort(dataclasses.replace(motion, passband=np.inf))
    export_twin(twin, "mjcf", tmp_path / "tx40.xml")
    assert np.all(nrmse(by_mujoco(tmp_path / "tx40.xml", motion, twin, memory=True), wanted) < PERCENT)
    export_twin(twin, "c", tmp_path / "tx40.c")
    assert np.all(nrmse(by_c(tmp_path / "tx40.c", motion), wanted) < PERCENT)
