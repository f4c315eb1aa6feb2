"""The library for someone who has arrays and a ``pin.Model``: no file, no folder, SI, shape (n, nv)."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pandas
import pinocchio as pin
import pyarrow
import pytest
import scipy

import pinotwin as pt
from pinotwin.errors import DataError, InputError, LogError, MachineError, TwinError
from pinotwin.machine.from_model import urdf_of_model
from tests.dynamics_models import random_tree
from tests.simulated import known_twin

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
        ({"q": q, "u": holed}, r"j2.u: 1 of 500 values are not finite, the first in row 7"),
        ({"q": q, "tau": u}, r"no channel 'tau'; .*known: a, q, ql, qr, u, v"),
        ({"q": q, "names": names}, r"no channel 'names'; .*names of columns: axes="),
        ({"q": [["a"] * 3] * 500}, "q: expected an array of numbers, not list"),
        ({"q": q + 1j}, "q: expected an array of numbers"),
        ({"q": q, "axes": ["j1", "j1", "j2"]}, "names an axis twice"),
    ]:
        with pytest.raises(LogError, match=said):
            pt.Log.from_arrays(t, **{"axes": names, **given})
    with pytest.raises(LogError, match=r"no channel 'names'; .*names of columns: axes="):
        pt.Log.from_arrays(t, q=q, names=names)
    with pytest.raises(LogError, match=r"give the names of the columns, axes="):
        pt.Log.from_arrays(t, q=q)
    with pytest.raises(LogError, match=r"t has shape \(500, 1\), expected \(n,\)"):
        pt.Log.from_arrays(t[:, None], q, axes=names)


def test_a_lost_position_text_and_a_clock_that_stands_are_refused(model, names):
    t, q, _, _, _ = arrays(model, 2.0)
    lost = q.copy()
    lost[:, 1] = np.nan
    for clock, given, said in [
        (t, lost, r"j2.q: all values are NaN; record its position, or leave the axis out of axes"),
        (t, q.astype(str), r"q: expected an array of numbers, not ndarray"),
        (t.astype(str), q, r"t: expected an array of numbers, not ndarray"),
        (0.0 * t, q, r"t: no time is later than the one before; give the time of every row in s"),
    ]:
        with pytest.raises(LogError, match=said):
            pt.Log.from_arrays(clock, q=given, axes=names)


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


def test_a_table_is_a_log_for_read_too(model, names, log):
    table = log.to_pandas()
    again = pt.read(table)
    assert list(again.channels) == list(log.channels)
    levels = table.drop(columns="t").set_axis(
        pandas.MultiIndex.from_tuples([tuple(c.split(".")) for c in table.columns if c != "t"]), axis=1
    )
    levels.index = pandas.Index(log.t, name="t")
    np.testing.assert_array_equal(pt.read(levels)[f"{names[2]}.u"], log[f"{names[2]}.u"])
    arrow = pyarrow.Table.from_pandas(table, preserve_index=False)
    np.testing.assert_array_equal(pt.read(arrow)["j2.u"], log["j2.u"])
    np.testing.assert_array_equal(
        pt.prepare(pt.Machine.from_model(model), arrow).u, pt.prepare(model, table).u
    )
    joined = pt.read(table[["t", "j1.q"]], table[["t", "j1.u"]])
    assert sorted(joined.channels) == ["j1.q", "j1.u", "t"]
    table.columns = ["t", *["x"] * 6]
    with pytest.raises(LogError, match="two columns are called 'x'"):
        pt.read(table)


def test_a_model_is_a_machine(model, names, log, twin, tmp_path):
    assert twin.machine.names == tuple(names)
    assert pt.prepare(model, log).names == tuple(names)
    assert pt.check(model, log).ok
    found = pt.diagnose(model, log, quick=True, closed_loop=False)
    assert not found.effects
    made = pt.new(model, log, out=tmp_path / "made").machine
    assert {name: a.rotor_inertia for name, a in made.axes.items()} == dict(
        zip(names, model.armature, strict=True)
    )
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
    student = scipy.stats.t(found.dof)  # of as many seconds as tell the number
    assert 2.0 < found.dof < 60.0
    assert (high - low) / 2.0 == pytest.approx(student.ppf(0.95) * found.standard_error, rel=1e-4)
    wide = student.ppf(0.975) * found.error * np.array([-1, 1])
    assert found.interval() == pytest.approx(found.value + wide, rel=1e-4)
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


def exported(twin: pt.Twin, folder):
    """The module that ``export --format numpy`` writes."""
    pt.export(twin, "numpy", folder / "exported.py")
    spec = importlib.util.spec_from_file_location("exported", folder / "exported.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.MODEL


def test_the_effort_of_arrays_is_the_exported_inverse_model(model, twin, tmp_path):
    t, q, v, a, u = arrays(model, 4.0, seed=5)
    found = twin.effort(q, v, a)
    assert found.shape == q.shape
    np.testing.assert_array_equal(twin.predict(q, v, a), found)
    wanted = exported(twin, tmp_path).run(q, v, a, STEP)
    np.testing.assert_allclose(found, wanted, atol=1e-9 * np.abs(wanted).max())
    np.testing.assert_array_equal(twin.effort(q, v, a, t=t), found)
    for k in (0, 77):  # one sample, as a controller asks for it
        np.testing.assert_allclose(
            twin.predict(q[k], v[k], a[k]), twin.predict(q[k:], v[k:], a[k:])[0], atol=1e-9
        )
    assert np.sqrt(np.mean((found - u) ** 2)) < 0.3  # u: noise of 0.02, friction that turns round at once


def test_arrays_that_are_no_motion_are_refused(model, twin):
    t, q, v, a, _ = arrays(model, 1.0)
    with pytest.raises(DataError, match=r"v has shape \(250, 2\), expected \(n, 3\)"):
        twin.effort(q, v[:, :2], a)
    with pytest.raises(DataError, match="a has 249 rows but q has 250"):
        twin.effort(q, v, a[:-1])
    with pytest.raises(DataError, match=r"t has shape \(9,\), expected \(250,\)"):
        twin.effort(q, v, a, t=t[:9])
    with pytest.raises(InputError, match=r"give effort\(q, v, a\), a Motion or a log"):
        twin.effort(q)


@pytest.mark.parametrize("effect", ["viscous_thermal", "drive_flexibility"])
def test_an_effect_of_time_asks_for_it(model, effect):
    t, q, v, a, _ = arrays(model, 2.0)
    twin = known_twin(pt.Machine.from_model(model, {"j1": [effect], "j2": ["viscous"], "j3": ["viscous"]}))
    with pytest.raises(DataError, match=rf"j1.{effect} depends on time; give t="):
        twin.predict(q, v, a)
    assert np.isfinite(twin.predict(q, v, a, t=t)).all()
    q[3, 0] = np.nan
    if effect == "drive_flexibility":
        with pytest.raises(DataError, match=rf"j1.{effect} depends on time"):
            twin.predict(q, v, a)
    else:
        assert np.isnan(twin.predict(q, v, a)[3, 0])


def test_what_a_sensor_adds_is_no_effort_of_the_machine(model):
    _, q, v, a, _ = arrays(model, 2.0)
    plain = known_twin(pt.Machine.from_model(model))
    late = known_twin(
        pt.Machine.from_model(model, {"j1": ["viscous", "coulomb", "delay"], "j2": [], "j3": []})
    )
    assert "j1.delay" in late.keys
    np.testing.assert_allclose(late.predict(q, v, a)[:, 0], plain.predict(q, v, a)[:, 0], atol=1e-9)


def test_a_log_is_a_motion_and_its_residual_is_measured_minus_predicted(log, twin):
    motion = twin.motion(log)
    np.testing.assert_array_equal(twin.effort(log), twin.effort(motion))
    np.testing.assert_array_equal(twin.residual(log), motion.u - twin.effort(motion))
    np.testing.assert_array_equal(twin.residual(motion), twin.residual(log))
    table = log.to_pandas().drop(columns="j2.u")
    assert np.isnan(twin.residual(table)[:, 1]).all()
    np.testing.assert_array_equal(twin.effort(table), twin.effort(log))


def test_the_effort_of_a_log_is_low_passed_and_that_of_arrays_is_not(model, log, tmp_path):
    """What docs/export.md says of a log with a low corner, on a robot that reverses."""
    twin = pt.identify(model, log, loop=False, cutoff=4.0)
    motion = twin.motion(log).cut(500, 3500)
    u = exported(twin, tmp_path).run(motion.q, motion.v, motion.a, motion.step)
    size = np.abs(u).max()
    assert np.abs(u - twin.effort(motion.q, motion.v, motion.a)).max() < 1e-9 * size
    assert np.abs(u - twin.effort(motion)).max() > 0.02 * size
    inner = slice(200, -200)  # the filter of a cut motion starts at its ends
    assert np.abs(motion.passed(u) - twin.effort(motion))[inner].max() < 0.01 * size


def test_the_text_of_a_file_is_no_name_of_one(model):
    urdf = urdf_of_model(model, "arm").decode()
    for call in (pt.Machine.load, pt.Twin.load, pt.read, lambda text: pt.check("emps", text)):
        with pytest.raises(
            InputError, match=r"expected the name of a file or folder, not its text \('<.xml version"
        ):
            call(urdf)
        with pytest.raises(InputError, match="cannot name a file"):
            call("a\0b")
    with pytest.raises(LogError, match=r"^long.*: no such file"):  # many files joined are no long name
        pt.check("emps", "+".join(f"long_name_{k}.csv" for k in range(40)))


def test_an_axis_without_effort_is_said(model, log):
    table = log.to_pandas().drop(columns="j2.u")
    said = pt.identify(model, table, loop=False).quality["warnings"]
    assert [line for line in said if line.startswith("j2: no effort in the log (channel j2.u is missing")]
    assert not [line for line in said if line.startswith(("j1: no effort", "j3: no effort"))]


def test_a_column_t_with_a_unit_goes_before_a_time_index():
    pandas = pytest.importorskip("pandas")
    times = pandas.date_range("2026-01-01", periods=4, freq="10ms")
    log = pt.Log.from_pandas(pandas.DataFrame({"t [s]": np.arange(4.0), "X.q": np.arange(4.0)}, index=times))
    np.testing.assert_array_equal(log["t"], np.arange(4.0))


def test_an_index_t_of_words_is_one_line():
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"X.q": np.arange(2.0)}, index=pandas.Index(["a", "b"], name="t"))
    with pytest.raises(LogError, match="DataFrame: t"):
        pt.Log.from_pandas(table)
