"""Effects of users: named as objects, classes, dotted paths, files and entry points, without a table to change."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
import yaml

import pinotwin as pt
from pinotwin.cli.main import main
from pinotwin.effects import EFFECTS, AxisEffect, Coefficient, Family, Shape, check_effect, given, known
from pinotwin.effects.family import FRICTION
from pinotwin.effects.known import _installed
from pinotwin.virtual import VirtualMachine, random_trajectory

PLAIN = ["viscous", "coulomb"]


@dataclass(frozen=True)
class RootDrag(AxisEffect):
    """Friction that grows with a power of the speed: tau = g |v|^k sign(v)."""

    name: ClassVar[str] = "root_drag"
    family: ClassVar[Family] = FRICTION
    depends = "velocity"
    axis: str
    rotary: bool = False
    power: float = 0.5

    def coefficients(self):
        return (Coefficient("g", "N·√(s/m)"),)

    def axis_columns(self, motion):
        return (np.sign(motion.v) * np.abs(motion.v) ** self.power)[:, None]


@dataclass(frozen=True)
class Bent(RootDrag):
    """The same with a power that is searched."""

    name: ClassVar[str] = "bent_drag"

    def shapes(self):
        return (Shape("power", "1", 0.2, 0.8, log=False),)


FILE = """
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from pinotwin.effects import AxisEffect, Coefficient

@dataclass(frozen=True)
class FileDrag(AxisEffect):
    "Friction with the root of speed."
    name: ClassVar[str] = "file_drag"
    axis: str
    rotary: bool = False

    def coefficients(self):
        return (Coefficient("g", "N"),)

    def axis_columns(self, motion):
        return (np.sign(motion.v) * np.sqrt(np.abs(motion.v)))[:, None]
"""


def dragged(log: pt.Log, size: float = 12.0) -> pt.Log:
    """The log of a machine with more root drag."""
    v = np.convolve(np.gradient(log["X.q"], log.t), np.ones(15) / 15, "same")
    more = size * np.sign(v) * np.sqrt(np.abs(v)) * (np.abs(v) > 0.002)
    return pt.Log({**log.channels, "X.u": log["X.u"] + more})


@pytest.fixture(scope="module")
def drive() -> pt.Machine:
    return pt.Machine.load("emps")


@pytest.fixture(scope="module")
def logs() -> list[pt.Log]:
    virtual = VirtualMachine.load(pt.machines()["emps"])
    moves = ((1, 1), (1, 2), (5, 3))
    return [virtual.record(random_trajectory(virtual, 8.0, k), seed=s).to_log() for k, s in moves]


@pytest.fixture
def machine_folder(tmp_path, drive) -> Path:
    drive.save(tmp_path / "machine")
    return tmp_path / "machine"


def listed(folder: Path, effects: list[object]) -> Path:
    """The machine in a folder with other effects on its axis."""
    path = folder / "machine.yaml"
    spec = yaml.safe_load(path.read_text())
    spec["axes"]["X"]["effects"] = effects
    path.write_text(yaml.safe_dump(spec))
    return folder


@pytest.mark.parametrize(
    "axes",
    [{"X": [*PLAIN, RootDrag("X")]}, {"X": [*PLAIN, RootDrag]}, {"X": [*PLAIN, f"{__name__}:RootDrag"]}],
)
def test_a_machine_lists_an_object_a_class_or_a_path(drive, axes):
    machine = pt.Machine.from_model(drive.model, axes, name="emps")
    assert machine.axes["X"].effects[-1] == RootDrag("X")


def test_all_axes_list_what_is_given_for_all(drive):
    machine = pt.Machine.from_model(drive.model, effects=["viscous", RootDrag], name="emps")
    assert [e.name for e in machine.axes["X"].effects] == ["viscous", "root_drag"]


def test_settings_of_an_own_effect_pass_through_a_saved_machine(drive, tmp_path):
    machine = drive.listing({"X": [RootDrag("X", power=0.4)]})
    text = machine.save(tmp_path / "m").read_text()
    assert f"{__name__}:RootDrag" in text
    assert pt.Machine.load(tmp_path / "m").axes["X"].effects[-1] == RootDrag("X", power=0.4)


def test_a_twin_with_own_effects_is_identified_saved_and_loaded(drive, logs, tmp_path):
    twin = pt.identify(drive, dragged(logs[0], 40.0), loop=False, effects=[Bent])
    row = twin.parameter("X.bent_drag.g")
    assert abs(row.value - 40.0) < 4.0 * row.error
    twin.save(tmp_path / "twin")
    again = pt.Twin.load(tmp_path / "twin")
    assert again.effects[-1] == twin.effects[-1]
    np.testing.assert_array_equal(again.theta, twin.theta)


def test_a_twin_whose_module_is_gone_says_which(drive, logs, tmp_path):
    pt.identify(drive, logs[0], loop=False, effects=[RootDrag]).save(tmp_path / "twin")
    code = "import pinotwin as pt, sys; sys.modules['tests'] = None\ntry:\n    pt.Twin.load(sys.argv[1])\n"
    code += "except pt.InputError as error:\n    print(error)"
    said = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "twin"], capture_output=True, text=True, check=True
    ).stdout
    assert "axes.X.effects[3]" in said
    assert f"effect {__name__}:RootDrag" in said
    assert f"--effects {__name__}.py" in said


def test_an_own_cause_is_named_where_it_is_given(drive, logs):
    twin = pt.identify(drive, logs[0], loop=False)
    day = [dragged(log) for log in logs]
    found = pt.diagnose(twin, day[:2], validate=day[2], quick=True, effects=[RootDrag], random_state=1)
    assert [(e.effect, e.axis) for e in found.effects] == [("root_drag", "X")]
    assert found.provenance["options"]["seed"] == 1
    assert "root_drag" not in known()
    assert list(found.causes) == list(found.effects)
    assert found.repaired().axes["X"].effects[-1] == RootDrag("X")
    again = pt.identify(found.repaired(), day[0], loop=False)
    assert again.parameter("X.root_drag.g").determined


def test_seed_has_one_value(drive, logs):
    with pytest.raises(pt.InputError, match="give one of them"):
        pt.diagnose(drive, logs[0], seed=2, random_state=1)


@dataclass(frozen=True)
class Taken(RootDrag):
    """An effect with a built-in name."""

    name: ClassVar[str] = "viscous"


class Nameless(AxisEffect):
    """An effect without a name or fields."""

    def coefficients(self):
        return ()

    def axis_columns(self, motion):
        return np.empty((len(motion.v), 0))


class Abstract(AxisEffect):
    """An effect without an equation."""


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (Taken, "viscous is a built-in effect"),
        (Nameless, "@dataclass"),
        (Abstract, "axis_columns, coefficients"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(drive, kind, said):
    with pytest.raises(pt.InputError, match=said) as raised:
        check_effect(kind)
    assert f"{__name__}:{kind.__qualname__}" in str(raised.value)
    with pytest.raises(pt.InputError, match=said):
        drive.listing([kind])


@dataclass(frozen=True)
class Flat(RootDrag):
    """An effect whose columns have no second axis."""

    name: ClassVar[str] = "flat"

    def axis_columns(self, motion):
        return motion.v


def test_columns_of_another_shape_are_refused(drive, logs):
    with pytest.raises(pt.DataError, match=r"X.flat: axis_columns returned shape .*, expected .*, 1\)"):
        pt.identify(drive, logs[0], loop=False, effects=[Flat])


def test_a_class_inside_a_function_is_not_saved(drive, tmp_path):
    @dataclass(frozen=True)
    class Inside(RootDrag):
        """An effect that nothing finds again."""

        name: ClassVar[str] = "inside"

    with pytest.raises(pt.MachineError, match="top of a module"):
        drive.listing([Inside]).save(tmp_path / "m")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("no_such_module:Drag", "--effects no_such_module.py"),
        ("pinotwin.effects:Drag", "holds no effect 'Drag'"),
        ("pinotwin:Twin", "holds no effect 'Twin'"),
        ("viscos", "did you mean 'viscous'"),
    ],
)
def test_a_wrong_path_is_one_line(machine_folder, text, said, capsys):
    assert main(["check", str(listed(machine_folder, [text]))]) == 2
    heard = capsys.readouterr().err
    assert "axes.X.effects[0]" in heard
    assert said in heard
    assert heard.count("\n") == 1


def test_commands_know_the_effects_of_a_file(machine_folder, logs, tmp_path, capsys):
    drag = tmp_path / "file_drag.py"
    drag.write_text(FILE)
    log = tmp_path / "log.csv"
    channels = dragged(logs[0], 40.0).channels
    table = np.column_stack(list(channels.values()))
    np.savetxt(log, table, delimiter=",", header=",".join(channels), comments="")
    folder = listed(machine_folder, [*PLAIN, "file_drag"])
    spec = yaml.safe_load((folder / "machine.yaml").read_text())
    spec.pop("columns", None)
    (folder / "machine.yaml").write_text(yaml.safe_dump(spec))
    assert main(["check", str(folder)]) == 2
    assert "unknown effect 'file_drag'" in capsys.readouterr().err
    words = ["identify", str(folder), str(log), "--no-loop", "--out", str(tmp_path / "twin")]
    assert main([*words, "--effects", str(drag)]) == 0
    assert "file_drag" not in known()
    assert "file_drag:FileDrag" in (tmp_path / "twin" / "machine.yaml").read_text()
    del sys.modules["file_drag"]
    force = ["force", str(tmp_path / "twin"), str(log), "--out", str(tmp_path / "force.csv")]
    assert main(force) == 2
    assert "--effects file_drag.py" in capsys.readouterr().err
    assert main([*force, "--effects", str(drag)]) == 0


@pytest.mark.parametrize(
    ("text", "said"),
    [("x = (", "SyntaxError"), ("import no_such_thing", "no_such_thing"), ("x = 1", "defines no effect")],
)
def test_a_file_with_a_mistake_is_one_line(tmp_path, text, said, capsys):
    path = tmp_path / "mistaken_effects.py"
    path.write_text(text)
    assert main(["check", "emps", "--effects", str(path)]) == 2
    assert said in capsys.readouterr().err
    sys.modules.pop("mistaken_effects", None)


def test_installed_effects_are_known(monkeypatch):
    point = SimpleNamespace(value=f"{__name__}:RootDrag")
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: [point])
    _installed.cache_clear()
    try:
        assert known()["root_drag"] is RootDrag
    finally:
        monkeypatch.undo()
        _installed.cache_clear()
    assert set(known()) == set(EFFECTS)


def test_given_effects_are_forgotten_with_the_block():
    with given([RootDrag]):
        assert known()["root_drag"] is RootDrag
    assert "root_drag" not in known()
