"""Machine files spoiled at random: a machine, or one line that says why not; never anything else."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree

from pinotwin.errors import InputError
from pinotwin.machine import Machine, machines
from pinotwin.virtual import VirtualMachine
from tests.rig import URDF

EXAMPLES = int(os.environ.get("PINOTWIN_FUZZ", "150"))

SPEC: dict[str, Any] = {
    "name": "rig",
    "urdf": "rig.urdf",
    "axes": {
        "X": {
            "joint": "jx",
            "rotor_inertia": 2.0,
            "effort_limit": 300,
            "zero": 0.1,
            "min_speed": 0.01,
            "effects": [
                "viscous",
                {"stribeck": {"v_s": 0.02, "exponent": 2}},
                {"ripple": {"period": 0.03, "harmonics": [1, 2]}},
                {"position_table": {"spacing": 0.01, "start": -0.1, "stop": 0.1}},
            ],
        }
    },
    "passive": {"d": {"joint": "jb", "stiffness": 5e4, "damping": 40}},
    "imus": {"i": {"link": "arm"}},
    "loop": {"X": {"real_poles": 3, "pole_pairs": 2}},
    "transmission": {"X": {"X": 50.0}},
    "data": {"cutoff": 50, "order": 4, "decimate": 5, "filter_effort": True, "drop": [10, 20]},
    "columns": {
        "t": {"rate": 500},
        "X.q": {"column": "pos", "unit": "mm", "factor": 2.0, "offset": 0.1},
        "arm.fx": "force",
    },
}

JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 3),
    st.sampled_from([1e300, -1e300, 10**30, float("nan"), float("inf"), 0.0, -0.0, 2.5]),
    st.text(max_size=8),
    st.sampled_from(["X", "jx", "jb", "arm", "d", "q", "viscous", "spring", "presliding", "../x", "1e9"]),
    st.lists(st.one_of(st.integers(-2, 2), st.text(max_size=3), st.none()), max_size=3),
    st.dictionaries(st.text(max_size=4), st.one_of(st.integers(-2, 2), st.none()), max_size=2),
)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every node below the top."""
    if path:
        yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield from places(inner, (*path, key))


PLACES = list(places(SPEC))


def spoiled(
    path: tuple[Any, ...], how: str, junk: Any, sound: dict[str, Any] | None = None
) -> dict[str, Any]:
    spec = copy.deepcopy(sound or SPEC)
    at: Any = spec
    for key in path[:-1]:
        at = at[key]
    if how == "replace" or isinstance(at, list):
        at[path[-1]] = junk
    elif how == "drop":
        del at[path[-1]]
    elif how == "rename":
        at[junk if isinstance(junk, str | int | float | None) else str(junk)] = at.pop(path[-1])
    else:
        at[str(junk)] = junk
    return spec


def load_or_one_line(folder: Path) -> Machine | None:
    try:
        machine = Machine.load(folder)
    except InputError as error:
        message = str(error)
        assert message
        assert "\n" not in message.strip()
        assert str(folder) in message
        return None
    assert machine.nv == len(machine.axes) + len(machine.passive)
    assert all(machine.names)
    assert len(machine.effects) >= 1
    return machine


def folder_with(tmp_path: Path, spec: str, urdf: bytes) -> Path:
    (tmp_path / "machine.yaml").write_text(spec)
    (tmp_path / "rig.urdf").write_bytes(urdf)
    return tmp_path


def test_the_whole_specification_loads(tmp_path: Path) -> None:
    machine = load_or_one_line(folder_with(tmp_path, yaml.safe_dump(SPEC), URDF.encode()))
    assert machine is not None
    assert list(machine.axes) == list(SPEC["axes"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


quick = settings(
    max_examples=EXAMPLES,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@quick
@given(
    path=st.sampled_from(PLACES),
    how=st.sampled_from(["replace", "replace", "drop", "rename", "add"]),
    junk=JUNK,
)
def test_a_spoiled_yaml(folder: Path, path: tuple[Any, ...], how: str, junk: Any) -> None:
    text = yaml.safe_dump(spoiled(path, how, junk), allow_unicode=True)
    machine = load_or_one_line(folder_with(folder, text, URDF.encode()))
    if machine is not None:  # what loads can be saved and loads again
        machine.save(folder / "copy")
        assert Machine.load(folder / "copy").names == machine.names


TRUTHS = {n: yaml.safe_load((p / "virtual.yaml").read_text()) for n, p in machines().items() if n != "tx40"}


@settings(quick, max_examples=EXAMPLES // 3)
@given(name=st.sampled_from(sorted(TRUTHS)), data=st.data(), junk=JUNK)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of a size that no machine has
def test_a_spoiled_truth(tmp_path_factory: Any, name: str, data: st.DataObject, junk: Any) -> None:
    path = data.draw(st.sampled_from(list(places(TRUTHS[name]))))
    folder = tmp_path_factory.mktemp("truth")
    for file in machines()[name].iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    (folder / "virtual.yaml").write_text(yaml.safe_dump(spoiled(path, "replace", junk, TRUTHS[name])))
    said = str(folder)
    try:
        VirtualMachine.load(folder)
    except InputError as error:
        said = str(error)
    assert str(folder) in said


@quick
@given(st.data())
def test_a_yaml_with_a_few_characters_changed(folder: Path, data: st.DataObject) -> None:
    text = list(yaml.safe_dump(SPEC))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text) - 1))
        text[at] = data.draw(st.sampled_from(list("{}[]:,-&*!|>'\"%@`#?\t\n 0aé\u2028")))
    load_or_one_line(folder_with(folder, "".join(text), URDF.encode()))


ATTRIBUTES = [
    "",
    "0",
    "-1",
    "nan",
    "inf",
    "1e400",
    "1e300",
    "a",
    "1 2",
    "0 0 0",
    "1 2 3 4",
    "slide",
    "jx",
    "é",
]


@quick
@given(st.data())
def test_a_spoiled_urdf(folder: Path, data: st.DataObject) -> None:
    root = etree.fromstring(URDF.encode())
    for _ in range(data.draw(st.integers(1, 2))):
        elements = list(root.iter())
        element = elements[data.draw(st.integers(1, len(elements) - 1))]
        how = data.draw(st.sampled_from(["attribute", "attribute", "drop", "remove", "twice", "rename"]))
        names = sorted(element.attrib)
        if how == "attribute" and names:
            element.set(data.draw(st.sampled_from(names)), data.draw(st.sampled_from(ATTRIBUTES)))
        elif how == "drop" and names:
            del element.attrib[data.draw(st.sampled_from(names))]
        elif how == "remove":
            element.getparent().remove(element)
        elif how == "twice":
            element.addnext(copy.deepcopy(element))
        elif how == "rename":
            element.tag = data.draw(st.sampled_from(["link", "joint", "origin", "mimic", "limit", "x"]))
    spec = yaml.safe_dump(
        {"name": "rig", "urdf": "rig.urdf", "axes": {"X": {"joint": "jx"}, "B": {"joint": "jb"}}}
    )
    machine = load_or_one_line(folder_with(folder, spec, etree.tostring(root)))
    if machine is not None:
        assert len(machine.base) >= 1
