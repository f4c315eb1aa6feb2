"""A factor on the effort of one axis of an arm, told by what its axes share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.diagnosis.days.account import alike
from pinotwin.diagnosis.days.structure import Lacking, lacking
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.report.diagnosis_verdict import headline

NAMES = ("A1", "A2", "A3")
SIZE = np.array([60.0, 25.0, 8.0])  # Of the efforts, about [N·m]
LINK = """<link name="{name}"><inertial><origin xyz="{centre} 0.01 0"/><mass value="{mass}"/>
<inertia ixx="0.02" iyy="{wide}" izz="{wide}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{name}"/><origin xyz="{at} 0 0"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="500" velocity="20"/></joint>"""


def urdf(axes: int, heavier: float = 1.0) -> str:
    """Return an arm that moves in a vertical plane."""
    links = "".join(
        LINK.format(
            name=f"L{k}",
            joint=NAMES[k],
            parent=f"L{k - 1}" if k else "base",
            at=0.4 if k else 0.0,
            centre=0.2 * heavier,
            mass=heavier * 8.0 / (k + 1),
            wide=0.12 / (k + 1),
        )
        for k in range(axes)
    )
    return f'<robot name="arm"><link name="base"/>{links}</robot>'


def moved(factors: np.ndarray, seed: int, drag: np.ndarray, offset: np.ndarray) -> Log:
    """Return a log of an arm heavier than its URDF says; its friction has no kink, its efforts have 14 bits."""
    rng, n, t = np.random.default_rng(seed), len(factors), np.arange(0.0, 16.0, 0.004)
    model = pin.buildModelFromXML(urdf(n, heavier=1.2))
    data = model.createData()
    pace, phase = 2.0 * np.pi * rng.uniform(0.25, 1.4, (4, n)), rng.uniform(0.0, 2.0 * np.pi, (4, n))
    angle = pace * t[:, None, None] + phase
    q, v, a = (
        np.sum(x, axis=1)
        for x in (0.5 / pace * np.sin(angle), 0.5 * np.cos(angle), -0.5 * pace * np.sin(angle))
    )
    u = np.array([pin.rnea(model, data, *x) for x in zip(q, v, a, strict=True)])
    u += SIZE[:n] * (0.08 * np.tanh(v / 0.01) + 0.04 * v + drag * v * np.abs(v) + offset)
    step = 4.0 * SIZE[:n] / 2**14
    u = np.round((u + 0.003 * SIZE[:n] * rng.standard_normal(u.shape)) * factors / step) * step
    q += 1e-6 * rng.standard_normal(q.shape)
    return Log.from_arrays(t, q=q, u=u, axes=NAMES[:n])


def arm(folder: Path, axes: int) -> Machine:
    (folder / "arm.urdf").write_text(urdf(axes))
    rows = "".join(f"  {n}: {{joint: {n}, effects: [viscous, coulomb]}}\n" for n in NAMES[:axes])
    (folder / "machine.yaml").write_text(f"name: arm\nurdf: arm.urdf\naxes:\n{rows}")
    return Machine.load(folder)


def asked(folder: Path, factors: list[float], drag: float = 0.0, offset: float = 0.0) -> Lacking:
    """Return what the model of an arm lacks: a ``drag`` of its second axis, an ``offset`` of its third."""
    n = len(factors)
    more = drag * np.eye(3)[1, :n], offset * np.eye(3)[2, :n]
    logs = [moved(np.array(factors), seed, *more) for seed in (1, 2)]
    return lacking(compare(arm(folder, len(factors)), logs, []))


def said(found: Lacking) -> list[tuple[str, str]]:
    return [(x.name, x.axis) for x in found.causes]


@pytest.mark.parametrize(("axis", "factor"), [(0, 0.8), (1, 1.3), (2, 0.52)])
def test_a_factor_on_the_effort_of_one_axis_is_named_with_its_size(
    tmp_path: Path, axis: int, factor: float
) -> None:
    found = asked(tmp_path, np.where(np.arange(3) == axis, factor, 1.0).tolist())
    assert said(found) == [("effort_scale", NAMES[axis])]
    assert alike(found.named[0]) == []
    assert 1.0 + found.causes[0].theta[0] == pytest.approx(factor, rel=0.02)


@pytest.mark.parametrize(("drag", "names"), [(0.0, []), (0.1, [("quadratic_drag", "A2")])])
def test_an_arm_whose_efforts_are_of_one_unit_has_none(
    tmp_path: Path, drag: float, names: list[tuple[str, str]]
) -> None:
    assert said(asked(tmp_path, [1.0, 1.0, 1.0], drag)) == names


def test_an_offset_that_disagrees_with_other_axes_is_no_factor(tmp_path: Path) -> None:
    found = asked(tmp_path, [1.0, 1.0, 1.0], offset=0.5)
    first, *others = found.first
    assert (first.name, first.axis) == ("offset", "A3")
    factor = next(x for x in others if (x.name, x.axis) == ("effort_scale", "A3"))
    assert first.total > 2.0 * factor.total
    assert said(found) == [("offset", "A3")]


def test_of_two_axes_the_ratio_alone_is_known(tmp_path: Path) -> None:
    found = asked(tmp_path, [1.0, 0.7])
    assert [x.name for x in found.causes] == ["effort_scale"]
    assert [set(x) for x in alike(found.named[0])] == [{"A1.effort_scale", "A2.effort_scale"}]


def test_one_axis_alone_says_nothing_of_a_factor(tmp_path: Path) -> None:
    assert said(asked(tmp_path, [0.7])) == []


def test_the_answer_says_what_the_log_has_of_the_effort(tmp_path: Path) -> None:
    logs = [moved(np.array([1.0, 1.0, 0.52]), seed, np.zeros(3), np.zeros(3)) for seed in (1, 2)]
    found = diagnose(arm(tmp_path, 3), logs, closed_loop=False)
    assert "A3: scale of the effort amounts to 0.52 times its value" in headline(found)[0]
