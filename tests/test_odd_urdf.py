"""Bodies that no machine has, and a base that is free: named, and a machine is identified all the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinotwin as pt

ROBOTS = Path(__file__).resolve().parents[2] / "shared" / "cases" / "robots"
pytestmark = pytest.mark.skipif(not ROBOTS.exists(), reason="no shared cases here")


@pytest.mark.parametrize(
    ("file", "code", "joints"),
    [
        ("c06_mm_inertia", "body_oversized", ["j1", "j2"]),
        ("c09_floating_base", "joint_free", ["root"]),
        ("c10_negative_inertia", "body_impossible", ["j1"]),
    ],
)
def test_it_is_named(file: str, code: str, joints: list[str]) -> None:
    found = pt.check(ROBOTS / f"{file}.urdf").findings
    assert [f.channel for f in found if f.code == code] == joints
    assert {f.code for f in found if f.severity != "info"} == {code}


def test_names_that_can_name_no_axis_get_one() -> None:
    axes = pt.Machine.load(ROBOTS / "c14_name_dots.urdf").axes
    assert {name: axis.joint for name, axis in axes.items()} == {
        "arm_j_1": "arm/j 1",
        "panda.joint.2": "panda.joint.2",
    }


@pytest.mark.parametrize("file", ["c06_mm_inertia", "c10_negative_inertia"])
def test_a_machine_with_such_bodies_is_identified(file: str) -> None:
    machine, t = pt.Machine.load(ROBOTS / f"{file}.urdf"), np.arange(6000) / 300.0
    waves = ((0.23, 0.6), (0.61, 0.3), (1.3, 0.08))
    q = np.stack([sum(a * np.sin(2 * np.pi * f * t + k + a) for f, a in waves) for k in (0.0, 1.5)], axis=1)
    v = np.gradient(q, t, axis=0)
    motion, model = (q, v, np.gradient(v, t, axis=0)), machine.model.copy()
    for j, mass in enumerate((2.0, 1.0), 1):
        model.inertias[j] = pin.Inertia(mass, np.array([0.0, 0.0, 0.1]), 0.01 * mass * np.eye(3))
    data = model.createData()
    u = np.array([pin.rnea(model, data, *x) for x in zip(*motion, strict=True)]) + v + 0.5 * np.sign(v)
    u += 0.02 * np.random.default_rng(0).standard_normal(u.shape)
    twin = pt.identify(machine, pt.Log.from_arrays(t, q=q, u=u, axes=list(machine.axes)), loop=False)
    assert twin.quality["relative_error"] < 0.02
    assert [body.mass for body in twin.model.inertias][1:] == pytest.approx([2.0, 1.0], rel=0.2)
