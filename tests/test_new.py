"""``pinotwin new``: from a name, axes or a URDF and a raw log to a machine folder that loads."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinotwin as pt
from pinotwin.cli.main import main
from pinotwin.columns import bind
from pinotwin.errors import InputError, MachineError
from pinotwin.log import Log
from pinotwin.machine.bundled import robots
from pinotwin.scaffold import guess_columns, new
from pinotwin.scaffold.chain import Sizes, parse_chain
from tests.ros_bags import write_bag
from tests.servo_log import FRICTION, INERTIA, MASS, MOMENT, servo_log
from tests.vendor_formats import CURRENT, FORMATS

AXES = {"Y": ("Y", False), "A": ("A", True)}


@pytest.fixture(scope="module")
def servo() -> dict[str, np.ndarray]:
    return servo_log()


@pytest.fixture(scope="module")
def exports(tmp_path_factory: pytest.TempPathFactory, servo: dict[str, np.ndarray]) -> dict[str, Path]:
    """The same log in every vendor's look, and as ROS 2 bags."""
    folder = tmp_path_factory.mktemp("exports")
    out = {}
    for kind, (ending, make) in FORMATS.items():
        out[kind] = folder / f"{kind}{ending}"
        out[kind].write_bytes(make({k: x for k, x in servo.items() if not k.endswith(".v")}, {"A"}))
    for storage in ("mcap", "sqlite3"):
        out[f"ros2_{storage}"] = write_bag(folder / storage, servo, storage=storage, command=True)
    out["ros1"] = write_bag(folder / "run.bag", servo, storage="ros1", command=True)
    return out


NEWTON = ("halscope", "mr_configurator", "opcua", "mtconnect", "plotjuggler")
"""Formats whose effort is written in N, without its unit."""

KINDS = [*FORMATS, "ros2_mcap", "ros2_sqlite3", "ros1"]


MASSLESS = """<robot name="tool"><link name="base"/><link name="arm"><inertial><mass value="2"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><link name="flange"/>
<joint name="j1" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
<joint name="j2" type="continuous"><parent link="arm"/><child link="flange"/><axis xyz="0 1 0"/></joint></robot>"""


def test_a_flange_without_mass_is_a_machine_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "tool.urdf").write_text(MASSLESS)
    start = new(tmp_path / "tool.urdf", out=tmp_path / "m")
    assert "j2 moves no mass in the URDF: rotor_inertia 0.01 kg·m² (assumed)" in start.said
    assert [start.machine.axis(name).rotor_inertia for name in ("j1", "j2")] == [0.0, 0.01]


def test_a_mill_whose_speeds_state_no_unit_is_usable(tmp_path, data_dir, capsys):
    """The speed of a column without a unit is that of its position by a time that fits the numbers."""
    log = str(data_dir / "cnc_mill_smart" / "experiment_01.csv")
    assert main(["new", "XYZ", log, "--rate", "10", "--out", str(tmp_path / "mill")]) == 0
    assert "not used: experiment_01[0], X1_ActualAcceleration" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "mill"), log]) == 0


@pytest.mark.parametrize(("unit", "factor"), [("mm/s", 1.0), ("mm/min", 60.0)])
def test_the_unit_of_a_speed_is_found_by_its_size(unit, factor):
    t = np.arange(0, 8, 0.004)
    x = 90 * np.sin(t)
    log = Log({"t": t, "X pos": x, "X speed": factor * 90 * np.cos(t), "X current": np.cos(t)}, "x.csv")
    found = {g.channel: g.unit for g in guess_columns(log, {"X": ("X", False)}).found}
    assert found["X.q"] == "mm"
    assert found["X.v"] == unit


@pytest.mark.parametrize("late", [1, 3, 12])
def test_the_command_is_the_column_that_leads(late):
    """Three columns of one axis without names: motor, scale, and the command in front of both."""
    rng, t = np.random.default_rng(late), np.arange(0, 20, 0.004)
    x = 0.2 * np.sin(0.7 * t) + 0.05 * np.sin(2.3 * t)
    command, motor = x, np.interp(t - 0.004 * late, t, x) + 1e-7 * rng.normal(size=len(t))
    v, a = np.gradient(motor, t), np.gradient(np.gradient(motor, t), t)
    log = Log({"time": t, "f1": motor, "f2": motor + 2e-6, "f3": 50 * a + 30 * v, "f4": command}, "x.csv")
    found = {g.channel: g.column for g in guess_columns(log, {"Y": ("Y", False)}).found}
    assert found["Y.qr"] == "f4"
    assert found["Y.q"] in ("f1", "f2")
    assert found["Y.u"] == "f3"


@pytest.mark.parametrize("asked", ["target", "desired", "command", "setpoint", "ref"])
def test_what_a_controller_asks_for_is_not_what_was_measured(asked):
    t = np.arange(0, 4, 0.01)
    channels = {"t": t}
    for kind in (asked, "actual"):
        for k in range(3):
            channels |= {f"{kind}_q_{k}": np.sin(t + k), f"{kind}_current_{k}": np.cos(t + k)}
    axes = {f"J{k}": (f"J{k}", True) for k in range(3)}
    found = {g.channel: g.column for g in guess_columns(Log(channels, "x.csv"), axes).found}
    assert [found[f"J{k}.u"] for k in range(3)] == [f"actual_current_{k}" for k in range(3)]
    assert [found[f"J{k}.qr"] for k in range(3)] == [f"{asked}_q_{k}" for k in range(3)]


@pytest.mark.parametrize("kind", KINDS)
def test_two_commands_from_a_raw_file_to_a_check(
    tmp_path: Path,
    exports: dict[str, Path],
    servo: dict[str, np.ndarray],
    kind: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rate = ["--rate", "250"] if kind == "halsampler" else []  # the one format that holds no time at all
    out = tmp_path / "mill"
    assert main(["new", "0-YA", str(exports[kind]), "--out", str(out), *rate]) == 0
    assert "open: t:" not in capsys.readouterr().out
    assert main(["check", str(out), str(exports[kind]), "--json", str(tmp_path / "check.json")]) == 0
    checked = json.loads((tmp_path / "check.json").read_text())
    assert checked["ok"]
    machine = pt.Machine.load(out)
    log = bind(pt.read(exports[kind]), machine.columns)
    electric = (
        kind not in (*NEWTON, "lerobot", "json_rows", "json_columns", "json_lines") and "ros" not in kind
    )
    stated = electric and kind != "halsampler"  # which states no unit of anything
    amperes = [f["channel"] for f in checked["findings"] if f["code"] == "effort_unit"]
    assert amperes == (["Y.u, A.u"] if stated else [])
    for axis in "YA":
        unit = CURRENT[axis] if electric else 1.0  # the torque constant is nowhere in the file
        np.testing.assert_allclose(log[f"{axis}.u"] / unit, servo[f"{axis}.u"], rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(log[f"{axis}.q"], servo[f"{axis}.q"], atol=1e-6)
    # PlotJuggler writes seconds since 1970, of which a float keeps the microseconds
    np.testing.assert_allclose(log.t - log.t[0], servo["t"] - servo["t"][0], atol=1e-6)


def test_what_is_identified_from_a_raw_bag_is_the_truth(tmp_path: Path, exports: dict[str, Path]) -> None:
    log = pt.read(exports["ros2_mcap"])
    start = new("0-YA", log, out=tmp_path / "mill")
    twin = pt.identify(start.machine, log, loop=False)
    found = {row.name: row.value for row in twin.parameters}
    assert found["rigid_body.m_Y*"] == pytest.approx(MASS, rel=0.005)
    assert found["rigid_body.Ixx_A*"] == pytest.approx(INERTIA, rel=0.005)
    assert found["rigid_body.mz_A"] == pytest.approx(-MOMENT, rel=0.005)
    viscous, dry = FRICTION["Y"]
    assert found["Y.viscous.b"] == pytest.approx(viscous, rel=0.01)
    assert found["Y.coulomb.c"] == pytest.approx(dry, rel=0.03)
    assert start.machine.urdf.name == "mill.urdf"


def test_every_guess_is_said_with_its_reason(tmp_path: Path, exports: dict[str, Path], capsys) -> None:
    path = tmp_path / "new.json"
    assert (
        main(["new", "0-YA", str(exports["tnc_scope"]), "--out", str(tmp_path / "m"), "--json", str(path)])
        == 0
    )
    said = capsys.readouterr().out
    assert "guess: Y.qr = s soll Y: named 'soll'" in said
    assert "guess: Y.u = I ist Y: its unit is A" in said
    assert "open: Y.u: is in A; give columns.Y.u a `factor` to N or N·m" in said
    assert "Y: travel" in said
    assert "mass 100 kg (assumed)" in said
    yaml = (tmp_path / "m" / "machine.yaml").read_text(encoding="utf-8")
    assert "Y.q: {column: s ist Y}  # named 'ist'; follows Y.qr within" in yaml
    assert json.loads(path.read_text())["columns"][0]["channel"] == "t"


def test_an_effort_of_the_wrong_sign_is_turned(servo: dict[str, np.ndarray]) -> None:
    def factor(sign: float) -> float:
        channels = {
            "Time": servo["t"],
            "Y pos": servo["Y.q"],
            "Y cur": sign * servo["Y.u"],
            "Y torque": sign * servo["Y.u"],
        }
        found = guess_columns(Log(channels, "x.csv", units={"Time": "s"}), {"Y": ("Y", False)}).found
        return next(g.factor for g in found if g.channel == "Y.u")

    assert factor(1.0) == 1.0
    assert factor(-1.0) == -1.0


def test_numbered_columns_go_to_the_axes_in_order_and_say_so(servo: dict[str, np.ndarray]) -> None:
    channels = {"time": servo["t"]}
    for i, axis in enumerate("YA"):
        channels[f"position[{i}]"] = servo[f"{axis}.q"]
        channels[f"effort[{i}]"] = servo[f"{axis}.u"]
    found = {g.channel: g for g in guess_columns(Log(channels, "x.csv"), AXES).found}
    assert found["A.q"].column == "position[1]"
    assert found["A.u"].column == "effort[1]"
    assert "order guessed" in found["A.q"].reason


def test_nameless_columns_in_another_order_are_told_apart_by_what_they_do(
    servo: dict[str, np.ndarray],
) -> None:
    order = ["A.u", "Y.q", "Y.qr", "A.q", "Y.u", "A.qr"]
    log = Log({f"x[{i}]": servo[name] for i, name in enumerate(order)}, "x.txt")
    found = {g.channel: g.column for g in guess_columns(log, AXES, rate=250.0).found}
    assert {found["Y.q"], found["Y.qr"]} == {"x[1]", "x[2]"}
    assert {found["A.q"], found["A.qr"]} == {"x[3]", "x[5]"}
    assert found["Y.u"] == "x[4]"
    assert found["A.u"] == "x[0]"


def test_noise_is_no_axis() -> None:
    rng = np.random.default_rng(0)
    log = Log({f"x[{i}]": rng.normal(size=400) for i in range(6)}, "x.txt")
    guesses = guess_columns(log, AXES, rate=250.0)
    assert [g.channel for g in guesses.found] == ["t"]
    assert any("no column found; add them under `columns`" in q for q in guesses.open)
    assert guesses.unused == tuple(log.channels)


def test_rate_and_factor_may_be_numbers_of_numpy(servo: dict[str, np.ndarray], tmp_path: Path) -> None:
    log = Log({"Y pos": servo["Y.q"], "Y cur": servo["Y.u"]}, "x.csv")
    sizes = Sizes(factor={"Y": np.float64(2.5)})
    columns = new("Y", log=log, rate=np.int64(250), sizes=sizes, out=tmp_path / "m").machine.columns
    assert (columns["t"].rate, columns["Y.u"].factor) == (250.0, 2.5)


def test_a_log_without_a_clock_asks_for_the_rate(servo: dict[str, np.ndarray]) -> None:
    log = Log({"Y pos": servo["Y.q"], "Y cur": servo["Y.u"]}, "x.csv")
    assert guess_columns(log, AXES).open[0].startswith("t: no time column; give the sampling rate")


@pytest.mark.parametrize(
    ("text", "rotary", "tool", "work"),
    [
        ("XYZAC", "table", "XYZ", "AC"),
        ("XYZAC", "head", "XYZAC", ""),
        ("XYZ-BC", "table", "XYZ", "BC"),
        ("Z-XYB", "head", "Z", "XYB"),
        ("0-YAC", "table", "", "YAC"),
    ],
)
def test_sides_of_a_chain(text: str, rotary: str, tool: str, work: str) -> None:
    chain = parse_chain(text, rotary)
    assert (chain.tool, chain.work) == (tuple(tool), tuple(work))


def test_the_urdf_is_a_machine_whose_axes_point_as_iso_841_says(tmp_path: Path) -> None:
    sizes = Sizes({"Z": 55.0}, {"X": (-0.4, 0.6)}, {"A": (0.0, 0.0, 0.3)})
    machine = new("XYZ-AC", out=tmp_path / "mill", sizes=sizes).machine
    model = machine.model
    assert machine.axes.keys() == {"X", "Y", "Z", "A", "C"}
    data = model.createData()
    q = np.zeros(model.nq)
    pin.forwardKinematics(model, data, q)
    pin.computeJointJacobians(model, data, q)
    for axis, sign in (("X", 1.0), ("Z", 1.0), ("A", -1.0), ("C", -1.0)):  # under the table: the other way
        joint = model.getJointId(axis)
        moved = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[
            :, model.idx_vs[joint]
        ]
        row = "XYZ".find(axis) if axis in "XYZ" else 3 + "ABC".find(axis)
        assert moved[row] == pytest.approx(sign)
    gravity = pin.rnea(model, data, q, np.zeros(model.nv), np.zeros(model.nv))
    assert gravity[machine.axes["Z"].index] == pytest.approx(55.0 * 9.81)
    i = machine.axes["X"].index
    assert (model.lowerPositionLimit[i], model.upperPositionLimit[i]) == (-0.4, 0.6)


def test_a_bundled_machine_is_copied_and_its_columns_rewritten(
    tmp_path: Path, exports: dict[str, Path]
) -> None:
    start = new("trunnion", out=tmp_path / "mine")
    assert (tmp_path / "mine" / "trunnion.urdf").is_file()
    assert start.machine.axes["Y"].effects == pt.Machine.load("trunnion").axes["Y"].effects
    log = pt.read(exports["tnc_scope"])
    again = new("emps", log, out=tmp_path / "other")
    assert (tmp_path / "other" / "machine.yaml").read_text(encoding="utf-8").count("columns:") <= 1
    assert again.machine.name == "emps"


def test_a_robot_by_name_with_its_bag(tmp_path: Path, data_dir: Path) -> None:
    if "ur10" not in robots():
        pytest.skip("example-robot-data is not installed")
    bag = data_dir / "ur10_rosbag" / "ur10_exciting_trajectory.db3"
    assert main(["new", "ur10", str(bag), "--out", str(tmp_path / "ur10")]) == 0
    assert main(["check", str(tmp_path / "ur10"), str(bag)]) == 0
    assert len(pt.Machine.load(tmp_path / "ur10").axes) == 6


def test_joints_that_the_log_does_not_hold_are_no_axes(tmp_path: Path, servo: dict[str, np.ndarray]) -> None:
    urdf = new("XYZ-AC", out=tmp_path / "full").machine.urdf
    log = Log({k: x for k, x in servo.items() if k[0] in "tYA"}, "x.csv")
    start = new(urdf, log, out=tmp_path / "part")
    assert set(start.machine.axes) == {"Y", "A"}
    assert "not in the log, held at zero: X, Z, C" in start.said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["XXY"], "axis X is there twice"),
        (["nonsense"], "neither axes"),
        (["XY", "--mass", "Q=3"], "--mass Q: no such axis; axes: X, Y"),
        (["XY", "--mass", "X=-3"], "-3 kg must be positive"),
        (["XY", "--mass", "X"], "'X' is not AXIS=NUMBER"),
        (["XY", "--travel", "X=1,0"], "1 is not below 0"),
        (["XY", "--rate", "0"], "--rate: 0 Hz must be positive"),
        (["no.urdf"], "no.urdf"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main(["new", *arguments, "--out", str(tmp_path / "m")]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "m").exists()


def test_an_existing_machine_is_not_overwritten(tmp_path: Path) -> None:
    new("XY", out=tmp_path / "m")
    with pytest.raises(InputError, match=r"holds a machine\.yaml already"):
        new("XY", out=tmp_path / "m")
    with pytest.raises(MachineError, match="twice"):
        new("XX", out=tmp_path / "n")


@pytest.mark.parametrize("kind", ["sinumerik", "halsampler"])
def test_two_commands_from_a_raw_file_to_a_diagnosis(
    tmp_path: Path, exports: dict[str, Path], kind: str
) -> None:
    # neither file has a time column: one states a sample time, of the other the rate is given
    rate = ["--rate", "250"] if kind == "halsampler" else []
    assert main(["new", "0-YA", str(exports[kind]), "--out", str(tmp_path / "mill"), *rate]) == 0
    out = tmp_path / "result"
    assert main(["diagnose", str(tmp_path / "mill"), str(exports[kind]), "--quick", "--out", str(out)]) == 0
    assert {"diagnosis.json", "report.html"} <= {path.name for path in out.iterdir()}
    assert set(json.loads((out / "diagnosis.json").read_text())["gap"]) == {"Y", "A"}
