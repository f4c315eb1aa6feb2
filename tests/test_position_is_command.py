"""Logs whose position is their command: the plant is identified, no closed loop is, and one line says why."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

import pinotwin as pt
from pinotwin.cli.main import main
from pinotwin.logs.write import write_log

STEP = 1e-5
LINK = """<link name="{name}"><inertial><mass value="30"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{joint}" type="prismatic"><parent link="{parent}"/><child link="{name}"/><axis xyz="{axis}"/>
<limit lower="-1" upper="1" effort="1500" velocity="2"/></joint>"""
Kind = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def late(x: np.ndarray, rows: int) -> np.ndarray:
    return np.concatenate([np.full(rows, x[0]), x[:-rows]])


def rounded(x: np.ndarray) -> np.ndarray:
    return np.round(x / STEP) * STEP


def with_hole(x: np.ndarray) -> np.ndarray:
    return np.where(np.arange(len(x)) < 0.7 * len(x), x, np.nan)


SAME: dict[str, Kind] = {
    "the same numbers": lambda x: (x, x),
    "position in encoder steps": lambda x: (x, rounded(x)),
    "command in steps": lambda x: (rounded(x), x),
    "both in steps": lambda x: (rounded(x), rounded(x)),
    "another zero": lambda x: (x, x + 1e-3),
    "command ends early": lambda x: (with_hole(x), x),
    "position ends early": lambda x: (x, with_hole(x)),
}
OTHERWISE: dict[str, Kind] = {
    "one sample late": lambda x: (x, late(x, 1)),
    "the command stands": lambda x: (np.full_like(x, x[0]), x),
    "noise alone": lambda x: (x, x + 1e-7 * np.random.default_rng(1).normal(size=len(x))),
    "another scale": lambda x: (x, 1.0001 * x),
    "the same for half of it": lambda x: (x, np.where(np.arange(len(x)) < len(x) // 2, x, late(x, 6))),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("table")
    links = [LINK.format(name=f"l{j}", joint=j, parent=p, axis=a) for j, p, a in TREE]
    (folder / "table.urdf").write_text(f'<robot name="table"><link name="base"/>{"".join(links)}</robot>')
    axes = {j: {"joint": j, "effects": ["viscous", "coulomb"]} for j, *_ in TREE}
    (folder / "machine.yaml").write_text(
        yaml.safe_dump({"name": "table", "urdf": "table.urdf", "axes": axes})
    )
    return folder


TREE = (("X", "base", "1 0 0"), ("Y", "lX", "0 1 0"))


def channels(kinds: dict[str, Kind]) -> dict[str, np.ndarray]:
    """Two axes at 250 Hz with the efforts of their motion, and what is logged of command and position."""
    t, rng = np.arange(2500) / 250.0, np.random.default_rng(3)
    out = {"t": t}
    for k, (axis, mass) in enumerate({"X": 60.0, "Y": 30.0}.items()):
        w = 2.0 * np.pi * np.array([0.31, 0.53, 0.9]) * (1.0 + 0.07 * k)
        x, v, a = (sum(0.06 * f**n * np.sin(f * t + 0.5 * n * np.pi + k) for f in w) for n in range(3))
        out[f"{axis}.u"] = mass * a + 40.0 * v + 12.0 * np.sign(v) + 0.2 * rng.normal(size=len(t))
        out[f"{axis}.qr"], out[f"{axis}.q"] = kinds[axis](x)
    return out


@pytest.mark.parametrize("name", SAME)
def test_a_position_that_is_its_command_has_a_plant_and_no_loop(folder: Path, name: str) -> None:
    twin = pt.identify(pt.Machine.load(folder), pt.Log(channels({"X": SAME[name], "Y": SAME[name]})))
    assert not twin.loops
    assert not twin.servos
    said = [line for line in twin.quality["warnings"] if "its position is its command" in line]
    assert len(said) == len(twin.quality["warnings"]) == 2
    rows = {row.name: row.value for row in twin.parameters}
    assert rows["X.viscous.b"] == pytest.approx(40.0, rel=0.05)


def test_one_such_axis_leaves_the_others_their_loops(folder: Path) -> None:
    log = pt.Log(channels({"X": SAME["the same numbers"], "Y": lambda x: (x, late(x, 5))}))
    twin = pt.identify(pt.Machine.load(folder), log)
    assert "X" not in {**twin.loops, **twin.servos}
    assert "Y" in twin.loops
    assert sum(line.startswith("no closed loop of X") for line in twin.quality["warnings"]) == 1


@pytest.mark.parametrize("name", OTHERWISE)
def test_errors_of_other_kinds_end_in_no_traceback(folder: Path, name: str) -> None:
    twin = pt.identify(
        pt.Machine.load(folder), pt.Log(channels({"X": OTHERWISE[name], "Y": OTHERWISE[name]}))
    )
    assert not any("its position is its command" in line for line in twin.quality["warnings"])


def test_the_command_says_it_in_one_line(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    same = SAME["the same numbers"]
    write_log(tmp_path / "log.csv", channels({"X": same, "Y": same}))
    assert main(["identify", str(folder), str(tmp_path / "log.csv"), "--out", str(tmp_path / "twin")]) == 0
    printed = capsys.readouterr()
    assert (printed.out + printed.err).count("no closed loop of X") == 1
