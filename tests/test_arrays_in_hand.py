"""The library for someone who has arrays and a ``pin.Model``: no file, no folder, SI, shape (n, nv)."""

from __future__ import annotations

import sys

import numpy as np
import pandas
import pinocchio as pin
import pytest

import pinotwin as pt
from pinotwin.errors import InputError, LogError, MachineError, TwinError
from tests.dynamics_models import random_tree

STEP = 0.004


def arrays(model: pin.Model, seconds: float = 16.0, seed: int = 0, noise: float = 0.02):
    """Times, positions and efforts of a model with viscous 5 and Coulomb 3 on every joint."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, STEP)
    w = 2.0 * np.pi * rng.uniform(0.1, 0.6, (4, model.nv))
    phase = rng.uniform(0.0, 6.0, (4, model.nv))
    angle = w[:, None] * t[None, :, None] + phase[:, None]
    q, v = 0.3 * np.sin(angle).sum(0), 0.3 * (w[:, None] * np.cos(angle)).sum(0)
    a = -0.3 * (w[:, None] ** 2 * np.sin(angle)).sum(0)
    data = model.createData()
    u = (
        np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
        + 5.0 * v
        + 3.0 * np.sign(v)
    )
    return t, q, v, a, u + noise * rng.normal(size=u.shape)


@pytest.fixture(scope="module")
def model() -> pin.Model:
    return random_tree(np.random.default_rng(2), joints=3, kinds="R")


@pytest.fixture(scope="module")
def names(model) -> list[str]:
    return list(model.names)[1:]


@pytest.fixture(scope="module")
def log(model, names) -> pt.Log:
    t, q, _, _, u = arrays(model)
    return pt.Log.from_arrays(t, q=q, u=u, axes=names)


@pytest.fixture(scope="module")
def twin(model, log) -> pt.Twin:
    return pt.identify(model, log, loop=False)


def test_arrays_become_the_channels_of_the_contract(model, names, log):
    t, q, v, _, u = arrays(model)
    np.testing.assert_array_equal(log.t, t)
    for k, name in enumerate(names):
        np.testing.assert_array_equal(log[f"{name}.q"], q[:, k])
        np.testing.assert_array_equal(log[f"{name}.u"], u[:, k])
    one = pt.Log.from_arrays(t, q[:, 0], v=v[:, 0], u=None, qr=q[:, :1].tolist(), axes="X")
    assert sorted(one.channels) == ["X.q", "X.qr", "X.v", "t"]
    some = u.copy()
    some[:, 1] = np.nan  # a joint without a measured effort
    assert f"{names[1]}.u" not in pt.Log.from_arrays(t, q=q, u=some, axes=names)


def test_arrays_that_do_not_fit_are_refused_with_what_was_expected(model, names):
    t, q, _, _, u = arrays(model, 2.0)
    holed = u.copy()
    holed[7, 1] = np.nan
    for given, said in [
        ({"q": q.T}, r"q has shape \(3, 500\), expected \(500, 3\): .*transpose it"),
        ({"q": q[:-1]}, r"q has shape \(499, 3\), expected \(500, 3\)"),
        ({"q": q, "u": u[:, :2]}, r"u has shape \(500, 2\), expected \(500, 3\)"),
        ({"q": q, "u": holed}, r"u of 'j2': 1 of 500 values are not finite, the first in row 7"),
        ({"q": q, "tau": u}, r"no channel 'tau'; .*known: a, q, ql, qr, u, v"),
        ({"q": q, "names": names}, r"no channel 'names'; .*names of columns: axes="),
        ({"q": [["a"] * 3] * 500}, "q: expected an array of numbers, not list"),
        ({"q": q + 1j}, "q: expected an array of numbers"),
        ({"q": q, "axes": ["j1", "j1", "j2"]}, "names an axis twice"),
    ]:
        with pytest.raises(LogError, match=said):
            pt.Log.from_arrays(t, **{"axes": names, **given})
    with pytest.raises(LogError, match=r"t has shape \(500, 1\), expected \(n,\)"):
        pt.Log.from_arrays(t[:, None], q, axes=names)


def test_the_constructor_names_the_function_that_takes_arrays(model):
    t, q, _, _, u = arrays(model, 2.0)
    with pytest.raises(
        LogError, match=r"Log: expected channels by name.* not ndarray; arrays: Log.from_arrays"
    ):
        pt.Log(t, q, u)
    with pytest.raises(LogError, match=r"channel 'q' has shape \(500, 3\), expected \(n,\).*from_arrays"):
        pt.Log({"t": t, "q": q})
    with pytest.raises(InputError, match=r"log: expected a Log.* not ndarray; arrays: Log.from_arrays"):
        pt.identify(model, (t, q, u))


def test_a_table_is_a_log_for_read_too(names, log):
    table = log.to_pandas()
    again = pt.read(table)
    assert list(again.channels) == list(log.channels)
    levels = table.drop(columns="t").set_axis(
        pandas.MultiIndex.from_tuples([tuple(c.split(".")) for c in table.columns if c != "t"]), axis=1
    )
    levels.index = pandas.Index(log.t, name="t")
    np.testing.assert_array_equal(pt.read(levels)[f"{names[2]}.u"], log[f"{names[2]}.u"])
    joined = pt.read(table[["t", "j1.q"]], table[["t", "j1.u"]])
    assert sorted(joined.channels) == ["j1.q", "j1.u", "t"]
    table.columns = ["t", *["x"] * 6]
    with pytest.raises(LogError, match="two columns are called 'x'"):
        pt.read(table)


def test_a_model_is_a_machine(model, names, log, twin):
    assert twin.machine.names == tuple(names)
    assert pt.prepare(model, log).names == tuple(names)
    assert pt.check(model, log).ok
    found = pt.diagnose(model, log, quick=True, closed_loop=False)
    assert not found.effects
    with pytest.raises(MachineError, match=r"Machine\(Model\): use Machine.from_model"):
        pt.Machine(model)
    with pytest.raises(MachineError, match=r"Machine\(str\): use Machine.load"):
        pt.Machine("trunnion")


def test_parameters_go_by_name_and_in_order(twin, monkeypatch):
    found = twin.parameters["j2.viscous.b"]
    assert found.unit == "N·m·s/rad"
    assert found.standard_error == found.error
    assert abs(found.value - 5.0) < 5.0 * found.standard_error
    low, high = found.interval(0.9)
    assert (high - low) / 2.0 == pytest.approx(1.6449 * found.standard_error, rel=1e-4)
    assert found.interval() == pytest.approx(found.value + 1.96 * found.error * np.array([-1, 1]), rel=1e-4)
    with pytest.raises(InputError, match="level: 90 is not between 0 and 1"):
        found.interval(90)
    assert list(twin.parameters) == [twin.parameters[k] for k in range(len(twin.parameters))]
    assert dict(twin.parameters) == {row.name: row for row in twin.parameters}
    assert "j2.viscous.b" in twin.parameters
    assert "j2.viscous.x" not in twin.parameters
    with pytest.raises(TwinError, match=r"no parameter 'j2.viscus.b'; did you mean 'j2.viscous.b'"):
        twin.parameters["j2.viscus.b"]
    frame = twin.parameters.to_frame()
    assert list(frame.index) == list(twin.parameters.keys())
    assert frame.loc["j2.viscous.b", "value"] == found.value
    assert frame.loc["j2.viscous.b", "high95"] == found.interval()[1]
    assert frame["value"].dtype == float
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match="pandas is not installed; `pip install pandas`"):
        twin.parameters.to_frame()
