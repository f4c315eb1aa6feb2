"""Joints that share a topic or a table: each on its own clock, named as the file names them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.cli.main import main
from pinotwin.errors import LogError
from tests.ros_bags import write_bag

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases"
ARM = ["pan", "elbow", "lift"]


def case(name: str) -> Path:
    if not (CASES / name).exists():
        pytest.skip(f"{name} is not at hand")
    return CASES / name


def states(rate: float, names: list[str], seconds: float = 4.0, late: float = 0.0) -> list[dict]:
    out = []
    for t in np.arange(0, seconds, 1 / rate) + late:
        stamp = {"sec": int(1e9 + t), "nanosec": round((t % 1) * 1e9)}
        position = [round(float(np.sin(t + k)), 6) for k in range(len(names))]
        effort = [round(float(np.cos(t + k)), 6) for k in range(len(names))]
        out.append({"header": {"stamp": stamp}, "name": names, "position": position, "effort": effort})
    return out


def written(path: Path, messages: list[dict]) -> pt.Log:
    def when(message: dict) -> float:
        return message["header"]["stamp"]["sec"] + 1e-9 * message["header"]["stamp"]["nanosec"]

    lines = [json.dumps(message) for message in sorted(messages, key=when)]
    path.write_text("\n".join(lines))
    return pt.read(path)


@pytest.mark.parametrize("rate", [5.0, 20.0, 50.0])
def test_a_gripper_that_publishes_slower_costs_the_arm_nothing(tmp_path, rate):
    log = written(tmp_path / "a.jsonl", states(100, ARM) + states(rate, ["finger"], late=0.003))
    assert {f"{joint}.{s}" for joint in ARM for s in "qu"} == set(log.channels) - {"t"}
    assert len(log) == 400
    assert all(np.isfinite(x).all() for x in log.channels.values())
    assert any("finger.q" in note for note in log.notes)


def test_joints_of_one_rate_in_messages_of_their_own_are_put_on_one_clock(tmp_path):
    log = written(tmp_path / "a.jsonl", states(100, ARM[:2]) + states(100, ARM[2:], late=0.004))
    assert {f"{joint}.q" for joint in ARM} <= set(log.channels)
    np.testing.assert_allclose(np.diff(log.t), 0.01, atol=1e-6)
    np.testing.assert_allclose(log["lift.q"][1:], np.sin(log.t[1:]), atol=1e-3)


def test_messages_that_come_twice_are_taken_once(tmp_path):
    once = states(100, ARM)
    log = written(tmp_path / "a.jsonl", once + once)
    assert len(log) == len(once)
    assert any("repeated messages were dropped" in note for note in log.notes)


def test_names_may_change_their_order_from_message_to_message(tmp_path):
    mixed = [
        {**m, **{key: m[key][::-1] for key in ("name", "position", "effort")}} if i % 2 else m
        for i, m in enumerate(states(100, ARM))
    ]
    log = written(tmp_path / "a.jsonl", mixed)
    plain = written(tmp_path / "b.jsonl", states(100, ARM))
    for joint in ARM:
        np.testing.assert_array_equal(log[f"{joint}.q"], plain[f"{joint}.q"])


def table(path: Path, header: bool, speeds: bool) -> pt.Log:
    t = np.arange(0, 4, 0.01)
    groups = [[np.sin(t + k) for k in range(3)], [np.cos(t + k) for k in range(3)]]
    groups = [*groups, [3 + 0 * t + np.sin(5 * t + k) for k in range(3)]]
    kinds = ["position", "velocity", "effort"]
    if not speeds:
        del groups[1], kinds[1]
    stamps = [f"{1000000000 + int(x)},{round((x % 1) * 1e9)}" for x in t]
    lines = []
    if header:
        names = [f"field.name{k}" for k in range(3)] + [
            f"field.{kind}{k}" for kind in kinds for k in range(3)
        ]
        lines.append(",".join(["%time", "field.header.seq", *names]))
        stamps = [f"{round(1e18 + 1e9 * x)},{i}" for i, x in enumerate(t)]
    frame = [] if header else ["base_link"]
    for i, stamp in enumerate(stamps):
        numbers = [f"{x[i]:.6f}" for group in groups for x in group]
        lines.append(",".join([stamp, *frame, *ARM, *numbers]))
    path.write_text("\n".join(lines))
    return pt.read(path)


@pytest.mark.parametrize("header", [True, False])
@pytest.mark.parametrize("speeds", [True, False])
def test_the_names_in_the_cells_name_the_columns(tmp_path, header, speeds):
    log = table(tmp_path / "a.csv", header, speeds)
    signals = "qvu" if speeds else "qu"
    assert {f"{joint}.{s}" for joint in ARM for s in signals} <= set(log.channels)
    t = np.arange(0, 4, 0.01)
    np.testing.assert_allclose(log["elbow.q"], np.sin(t + 1), atol=1e-5)
    if not header:
        np.testing.assert_allclose(log.t, t, atol=1e-8)


def test_the_order_of_the_file_is_not_the_order_of_the_machine(tmp_path):
    log, urdf = case("robots/l04_rostopic.csv"), case("robots/arm2.urdf")
    assert main(["new", str(urdf), str(log), "--out", str(tmp_path / "arm")]) == 0
    bound = pt.read(log)
    first = log.read_text().splitlines()[1].split(",")
    assert float(bound["shoulder.q"][0]) == float(first[7])
    assert "columns: " not in (tmp_path / "arm" / "machine.yaml").read_text().replace("columns:  #", "")


def test_two_publishers_of_the_recorded_case(capsys):
    log = pt.read(case("robots/l05_two_publishers.jsonl"))
    assert all(np.isfinite(x).all() for x in log.channels.values())
    assert main(["check", str(case("robots/arm2.yaml")), str(case("robots/l05_two_publishers.jsonl"))]) == 0


@pytest.mark.parametrize("name", ["robust/ros2_mcap_folder", "robust/mcap_crc_wrong.mcap"])
def test_damaged_bags_are_one_line(name):
    with pytest.raises(LogError, match="is damaged or cut off") as raised:
        pt.read(case(name))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_without_its_metadata_is_read(tmp_path, storage):
    t = np.arange(0, 2, 0.01)
    bag = write_bag(tmp_path / "bag", {"t": t, "X.q": np.sin(t), "X.u": np.cos(t)}, storage=storage)
    whole = pt.read(bag)
    (bag / "metadata.yaml").unlink()
    shutil.copytree(bag, tmp_path / "copy")
    np.testing.assert_array_equal(pt.read(tmp_path / "copy")["X.q"], whole["X.q"])


def test_joints_that_cannot_name_an_axis_get_a_name(tmp_path, capsys):
    urdf = case("robots/c14_name_dots.urdf")
    assert main(["check", str(urdf)]) == 0
    assert main(["new", str(urdf), "--out", str(tmp_path / "arm")]) == 0
    assert "arm_j_1 is the joint 'arm/j 1'" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "arm")]) == 0
    assert pt.Machine.load(tmp_path / "arm").axis("arm_j_1").joint == "arm/j 1"


@pytest.mark.parametrize("joint", ["a/jx", "j 1", "a:b", "x;y", " j", "=1+1", "Achse,1"])
def test_every_name_of_a_joint_gives_an_axis(tmp_path, joint):
    link = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    (tmp_path / "one.urdf").write_text(
        f'<robot name="one"><link name="base"/><link name="arm">{link}</link><joint name="{joint}" type="continuous">'
        '<parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint></robot>'
    )
    machine = pt.Machine.load(tmp_path / "one.urdf")
    (name,) = machine.axes
    assert not set(',;:=+\n"/\\') & set(name)
    assert machine.axes[name].joint == joint
    machine.save(tmp_path / "saved")
    assert list(pt.Machine.load(tmp_path / "saved").axes) == [name]


def test_factors_of_efforts_are_written_and_asked_no_more(tmp_path, capsys):
    t = np.arange(0, 8, 0.004)
    rows = np.column_stack([1e3 * t, 90 * np.sin(t), 90 * np.sin(t) + 1e-3, np.cos(t)])
    (tmp_path / "a.csv").write_text(
        "t [ms];X soll [mm];X ist [mm];X I [A]\n"
        + "\n".join(";".join(f"{x:.6f}" for x in row) for row in rows)
    )
    out = tmp_path / "slide"
    assert main(["new", "X", str(tmp_path / "a.csv"), "--factor", "X=35", "--out", str(out)]) == 0
    assert "open: X.u" not in capsys.readouterr().out
    assert pt.Machine.load(out).columns["X.u"].factor == 35
    wrong = ["new", "X", str(tmp_path / "a.csv"), "--factor", "Y=35", "--out", str(tmp_path / "other")]
    assert main(wrong) == 2
    assert "no effort 'Y.u' among the columns; did you mean 'X.u'?" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()
