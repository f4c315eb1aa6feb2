"""What machine.yaml says of a logged effort is used rightly, or the effort is not used at all."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

import pinotwin as pt
from pinotwin.errors import MachineError
from pinotwin.virtual import VirtualMachine, random_trajectory


@pytest.fixture(scope="module")
def recorded() -> pt.Log:
    machine = VirtualMachine.load(pt.machines()["trunnion"])
    return machine.record(random_trajectory(machine, 12.0, 3), seed=3).to_log()


def _machine(folder, effort, axes=None) -> pt.Machine:
    path = pt.Machine.load("trunnion").save(folder)
    spec = yaml.safe_load(path.read_text())
    if effort is not None:
        spec["effort"] = effort
    for name, one in (axes or {}).items():
        spec["axes"][name]["effort"] = one
    path.write_text(yaml.safe_dump(spec))
    return pt.Machine.load(folder)


def test_a_raw_effort_is_what_it_was(tmp_path, recorded) -> None:
    one, two = pt.Machine.load("trunnion"), _machine(tmp_path, {"kind": "raw"})
    assert two.columns == one.columns
    np.testing.assert_array_equal(two.model.gravity.linear, one.model.gravity.linear)


def test_an_effort_without_its_weight_is_foretold_without_it(tmp_path, recorded) -> None:
    raw = pt.Machine.load("trunnion")
    q = np.column_stack([recorded[f"{a}.q"] for a in raw.axes])
    still = np.zeros_like(q)
    weight = pt.identify(raw, recorded, loop=False).rigid_effort(q, still, still)
    bare = recorded.with_channels(
        {
            **{k: recorded[k] for k in recorded.channels},
            **{f"{a}.u": recorded[f"{a}.u"] - weight[:, j] for j, a in enumerate(raw.axes)},
        }
    )
    machine = _machine(tmp_path, {"kind": "gravity_compensated"})
    assert not machine.model.gravity.linear.any()
    assert not pt.Machine.load(machine.save(tmp_path / "saved")).model.gravity.linear.any()
    told, untold = (pt.identify(m, bare, loop=False) for m in (machine, raw))
    for axis in raw.axes:
        assert told.quality["axes"][axis]["fit"] <= untold.quality["axes"][axis]["fit"] + 1e-3
    codes = [f.code for f in pt.check(machine, bare).findings]
    assert "effort_weightless" not in codes


def test_the_weight_is_in_every_effort_or_in_none(tmp_path) -> None:
    with pytest.raises(
        MachineError, match=r"axes\.A\.effort\.kind: gravity_compensated holds for all axes or"
    ):
        _machine(tmp_path, None, {"A": {"kind": "gravity_compensated"}})


@pytest.mark.parametrize(("kind", "unit"), [("current", "A"), ("percent", "%")])
def test_an_effort_of_no_size_has_one_unknown_factor(tmp_path, recorded, kind, unit) -> None:
    machine = _machine(tmp_path, None, {"A": {"kind": kind}})
    assert machine.columns["A.u"].unit == unit
    log = recorded.with_channels(
        {**{k: recorded[k] for k in recorded.channels}, "A.u": recorded["A.u"] / 8.0}
    )
    found = pt.identify(machine, log, loop=False)
    assert set(found.quality["sizes"]) == {"A"}


@pytest.mark.parametrize("kind", ["magnitude", "external"])
def test_an_effort_that_is_none_of_the_motors_is_not_used(tmp_path, recorded, kind) -> None:
    machine = _machine(tmp_path, None, {"A": {"kind": kind}})
    log = recorded.with_channels(
        {**{k: recorded[k] for k in recorded.channels}, "A.u": np.abs(recorded["A.u"])}
    )
    found = pt.identify(machine, log, loop=False)
    assert set(found.quality["axes"]) == {"Y", "C"}
    assert any(text.startswith("A: no effort in the log") for text in found.quality["warnings"])


def test_a_law_may_be_nested(tmp_path) -> None:
    machine = _machine(tmp_path, None, {"A": {"law": {"pd": {"kp": 40.0, "kd": 1.0}}}})
    assert (machine.columns["A.u"].law, machine.columns["A.u"].kp, machine.columns["A.u"].kd) == (
        "pd",
        40.0,
        1.0,
    )


@pytest.mark.parametrize("kind", ["torque", 3])
def test_another_kind_is_refused_with_its_path(tmp_path, kind) -> None:
    with pytest.raises(MachineError, match=r"axes\.A\.effort\.kind"):
        _machine(tmp_path, None, {"A": {"kind": kind}})


def test_the_kind_holds_for_an_effort_that_is_mapped_too(tmp_path, recorded) -> None:
    path = pt.Machine.load("trunnion").save(tmp_path)
    spec = yaml.safe_load(path.read_text())
    spec["columns"] = {"A.u": {"column": "torque", "unit": "mN"}, "C.u": "current"}
    spec["axes"]["A"]["effort"], spec["axes"]["C"]["effort"] = {"kind": "magnitude"}, {"kind": "current"}
    path.write_text(yaml.safe_dump(spec))
    machine = pt.Machine.load(tmp_path)
    assert (machine.columns["C.u"].column, machine.columns["C.u"].unit) == ("current", "A")
    rest = {k: recorded[k] for k in recorded.channels if k not in ("A.u", "C.u")}
    log = recorded.with_channels({**rest, "torque": np.abs(recorded["A.u"]), "current": recorded["C.u"]})
    bound = pt.columns.bind(log, machine.columns)
    assert "A.u" not in bound.channels
    assert any(text.startswith("A.u: a magnitude has no sign") for text in bound.notes)
    assert pt.Machine.load(machine.save(tmp_path / "again")).columns == machine.columns
