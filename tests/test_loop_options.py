"""The source's options of a closed loop in machine.yaml: order, feed-forward poles, numerators, bounds."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import yaml

import pinotwin as pt
from pinotwin.errors import MachineError
from pinotwin.log import Log
from pinotwin.machine.parts import MachineFile
from pinotwin.machine.sections import loops
from pinotwin.system.reading import read
from tests.random_drives import Drive, machine, run


@pytest.fixture(scope="module")
def log() -> Log:
    """Return 6 s of a cascade."""
    drive = Drive(
        "cascade", (45.0, 6000.0, 2e5, 1.0, 0.9, 40.0), (3e-4, 0.0), 0.0, (60.0, 90.0, 20.0, np.inf), 4000.0,
        (1e-7, 1e-3, 0.5),
    )  # fmt: skip
    t = np.arange(3000) / 500.0
    qr = 0.05 * np.sin(2.0 * np.pi * 0.7 * t) + 0.02 * np.sin(2.0 * np.pi * 2.3 * t) * np.minimum(t, 1.0)
    rows = run(drive, qr, 500.0, np.random.default_rng(1))
    assert rows is not None
    return Log(rows, source="cascade.csv")


@pytest.mark.parametrize(
    ("given", "count"),
    [
        ({"real_poles": 2, "pole_pairs": 1, "feedforward_poles": [200.0]}, 1),
        ({"real_poles": 1, "pole_pairs": 1, "feedforward_poles": []}, 0),
        ({"numerators": "source", "bounds": {"wn1": [20.0, 60.0]}}, 2),
    ],
)
def test_a_loop_is_identified_as_its_machine_says(log: Log, given: dict, count: int) -> None:
    shape = loops(read({"loop": {"X": given}}, MachineFile, ""), ("X",))
    twin = pt.identify(dataclasses.replace(machine(), loop=shape), log)
    loop = twin.loops["X"]
    assert loop.structure.feedforward_count == count
    assert loop.structure.numerators == given.get("numerators", "exact")
    assert loop.structure.real_poles == given.get("real_poles", 3)
    for name, (low, high) in given.get("bounds", {}).items():
        (row,) = [r for r in loop.pole_table() if r["name"].startswith(name)]
        assert low <= row["value"] <= high
    said = twin.simulate(Log({k: log[k] for k in ("t", "X.qr")}, source="command"), controller="black")
    e = log["X.qr"] - log["X.q"]
    assert np.sqrt(np.mean((said["X.e"] - e) ** 2) / np.mean(e**2)) < 0.2


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"feedforward_poles": 250}, "loop.X.feedforward_poles: expected search, or a list of frequencies"),
        ({"feedforward_poles": [-1]}, "loop.X.feedforward_poles: expected search, or a list of frequencies"),
        ({"numerators": "theirs"}, "loop.X.numerators: expected exact or source, found 'theirs'"),
        ({"bounds": {"p1": [5, 1]}}, r"loop.X.bounds.p1: expected \[lower, upper\], found \[5, 1\]"),
        ({"bounds": {"p1": 5}}, r"loop.X.bounds.p1: expected \[lower, upper\], found 5"),
        (
            {"real_poles": 2, "pole_pairs": 0},
            "loop.X: 2 real poles, 2 of them of the feed-forward, and 0 pairs",
        ),
        ({"feedforward": []}, "loop.X.feedforward: unknown key; did you mean 'feedforward_poles'"),
    ],
)
def test_wrong_options_are_refused_in_one_line(given: dict, words: str) -> None:
    with pytest.raises(MachineError, match=words):
        loops(read({"loop": {"X": given}}, MachineFile, ""), ("X",))


def test_a_machine_keeps_its_options_in_its_file(tmp_path: Path) -> None:
    given = {"feedforward_poles": [250.0, 250.0], "bounds": {"p1": [1.0, 100.0]}, "closed_on": "load"}
    where = machine().save(tmp_path / "emps")
    file = tmp_path / "emps" / "machine.yaml"
    assert where is None or file.is_file()
    spec = yaml.safe_load(file.read_text(encoding="utf-8")) | {"loop": {"X": given}}
    file.write_text(yaml.safe_dump(spec), encoding="utf-8")
    again = pt.Machine.load(tmp_path / "emps")
    again.save(tmp_path / "copy")
    for found in (again, pt.Machine.load(tmp_path / "copy")):
        shape = found.loop["X"]
        assert shape.feedforward_poles == (250.0, 250.0)
        assert shape.bounds == {"p1": (1.0, 100.0)}
        assert shape.closed_on == "load"
