"""Real recordings load through a mapping alone, and what is wrong with them is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from pinotwin.columns import bind
from pinotwin.log import Log
from pinotwin.logs.files import read, read_argument
from pinotwin.logs.quality import Quality, inspect, resample
from pinotwin.machine.sections import parse_columns
from pinotwin.signals import decimate_zero_phase, derivatives

EMPS = """
t: t
X.q: {column: qm, unit: m}
X.qr: {column: qg, unit: m}
X.u: {column: vir, unit: V, factor: gtau}
"""

KR300 = "t: rec.time_cont\n" + "".join(
    f"""
A{i + 1}.q: {{column: "rec.act_pos_mot_deg[{i}]", unit: deg}}
A{i + 1}.qr: {{column: "rec.ref_pos_deg[{i}]", unit: deg}}
A{i + 1}.u: {{column: "rec.act_torque_abs_nm[{i}]", unit: N·m, factor: "para.u[{i}]"}}
"""
    for i in range(6)
)

_MILL = "".join(
    f"""
{axis}.q: {{column: {axis}1_ActualPosition, unit: {unit}}}
{axis}.qr: {{column: {axis}1_CommandPosition, unit: {unit}}}
{axis}.v: {{column: {axis}1_ActualVelocity, unit: {unit}/s}}
{axis}.u: {{column: {axis}1_CurrentFeedback, unit: A}}
"""
    for axis, unit in (("X", "mm"), ("Y", "mm"), ("Z", "mm"), ("S", "rev"))
)
MILL = "t: {rate: 10}\nfeedrate: M1_CURRENT_FEEDRATE\nprogram: M1_CURRENT_PROGRAM_NUMBER\n" + _MILL

TX40 = "t: {rate: 5000}\n" + "".join(
    f"""
J{i}.q: {{column: pos_read_data.Joint_{i}, unit: rad}}
J{i}.u: {{column: curr_data.Joint_{i}, unit: N·m}}
"""
    for i in range(1, 7)
)

ODRIVE = """
t: "[0]"
M.q: {column: "[1]", unit: rev, factor: 0.0001220703125}
M.u: {column: "[2]", unit: A}
"""

BROAD = "t: {rate: 285.7142857142857}\n" + "".join(
    f'{kind}{axis}: {{column: "imu_{name}[{i}]"}}\n'
    for kind, name in (("g", "gyr"), ("a", "acc"))
    for i, axis in enumerate("xyz")
)


def load(text: str, argument: Path | str) -> Log:
    return bind(read_argument(str(argument)), parse_columns(yaml.safe_load(text)))


def warnings(quality: Quality) -> str:
    return "\n".join(str(f) for f in quality.findings if f.severity == "warning")


def _emps_columns(q: np.ndarray) -> np.ndarray:
    _, v, a = derivatives(q, 1000.0, 100.0)
    return np.column_stack([a, v, np.sign(v), np.ones(len(v))])


def test_emps_published_figures(data_dir: Path) -> None:
    # Janot, Gautier & Brunot 2019, EMPS_Description.pdf, Sections 3.4 and 4.
    log = load(EMPS, data_dir / "emps" / "DATA_EMPS.mat")
    w = decimate_zero_phase(_emps_columns(log["X.q"])[49:], 10)
    y = decimate_zero_phase(log["X.u"][49:], 10)
    theta = np.linalg.lstsq(w, y, rcond=None)[0]
    assert theta.round(4).tolist() == [95.1089, 203.5034, 20.3935, -3.1648]
    e = y - w @ theta
    assert round(100 * np.linalg.norm(e) / np.linalg.norm(y), 4) == 4.0834
    assert round(float(np.linalg.norm(e)), 4) == 108.7569
    assert round(float(np.linalg.cond(w)), 4) == 25.9883
    # The authors divide by n - 1, not by n - 4.
    variance = np.var(e, ddof=1)
    error = np.sqrt(np.diag(np.linalg.inv(w.T @ w)) * variance)
    assert error.round(4).tolist() == [0.1085, 1.1460, 0.1012, 0.0444]


def test_emps_asymmetric_friction(data_dir: Path) -> None:
    log = load(EMPS, data_dir / "emps" / "DATA_EMPS.mat")
    w = _emps_columns(log["X.q"])
    a, v = w[:, 0], w[:, 1]
    up, down = (v > 0).astype(float), (v < 0).astype(float)
    split = np.column_stack([a, v * up, up, v * down, -down])
    w = decimate_zero_phase(split[49:], 10)
    y = decimate_zero_phase(log["X.u"][49:], 10)
    theta = np.linalg.lstsq(w, y, rcond=None)[0]
    assert theta.round(4).tolist() == [95.1540, 166.7061, 20.1440, 240.4236, 20.6277]
    assert round(100 * np.linalg.norm(y - w @ theta) / np.linalg.norm(y), 4) == 3.1117


def test_emps_quality(data_dir: Path) -> None:
    quality = inspect(load(EMPS, data_dir / "emps" / "DATA_EMPS.mat"), {"X": False})
    assert warnings(quality) == ""
    assert quality.channels["X.q"].step == pytest.approx(5e-8, rel=1e-6)
    assert quality.cutoff == pytest.approx(129.5, rel=0.05)  # the authors took 100 Hz
    assert quality.axes["X"].speed == pytest.approx(0.128, abs=0.002)


def test_kr300(data_dir: Path) -> None:
    log = load(KR300, data_dir / "kuka_kr300" / "FF_A_08ms.mat")
    assert len(log) == 2501
    raw = read(data_dir / "kuka_kr300" / "FF_A_08ms.mat")
    np.testing.assert_allclose(log["A2.u"], 267.429 * raw["rec.act_torque_abs_nm[1]"], rtol=1e-5)
    # The readme: error = ref - secondary encoder on axis 1, ref - motor encoder on axis 6.
    error = raw["rec.error_pos_deg[5]"]
    np.testing.assert_allclose(np.degrees(log["A6.qr"] - log["A6.q"]), error, atol=2e-3)
    quality = inspect(log, {f"A{i}": True for i in range(1, 7)})
    assert quality.ok
    assert quality.clock is not None
    assert quality.clock.rate == pytest.approx(250.0, rel=1e-4)
    assert all(axis.moves for axis in quality.axes.values())


def test_mill(data_dir: Path) -> None:
    axes = {"X": False, "Y": False, "Z": False, "S": True}
    quality = inspect(load(MILL, data_dir / "cnc_mill_smart" / "experiment_02.csv"), axes)
    text = warnings(quality)
    assert "t: 10 Hz is too slow to identify inertia" in text
    assert "numbers have 3 significant digits" in text
    assert "Z.u: is always zero: not wired, or not recorded?" in text
    assert "X.q: jumps to 198 (as in the file) and back" in text
    assert "rows are exact copies of other rows" in text
    assert "rows have feedrate = 50; leave all 1292 rows with that value out" in text
    notes = "\n".join(f.message for f in quality.findings if f.severity == "info")
    assert "left out, not numbers: Machining_Process, tool_condition" in notes


@pytest.mark.parametrize("number", range(1, 13))
def test_every_mill_experiment_loads_through_one_mapping(data_dir: Path, number: int) -> None:
    log = load(MILL, data_dir / "cnc_mill_smart" / f"experiment_{number:02d}.csv")
    assert {"t", "X.q", "X.u", "S.v", "feedrate"} <= set(log.channels)
    assert np.abs(log["X.q"]).max() < 0.3


def test_tx40_effort_leads(data_dir: Path) -> None:
    folder = data_dir / "staubli_tx40"
    log = load(TX40, f"{folder}/pos_read_data.csv+{folder}/curr_data.csv")
    assert len(log) == 45000
    quality = inspect(log, {f"J{i}": True for i in range(1, 7)})
    leads = [axis.lead for axis in quality.axes.values() if axis.lead is not None]
    assert len(leads) == 6
    assert 0.0018 < np.median(leads) < 0.004
    assert min(leads) > 0.001
    assert "effort leads the position by about 2." in warnings(quality)
    assert quality.channels["J1.q"].digits == 5


def test_odrive_slow_run_and_its_irregular_clock(data_dir: Path) -> None:
    log = load(ODRIVE, data_dir / "odrive_cogging" / "slow2_nocomp_0.npy")
    assert log["M.q"][-1] == pytest.approx(2 * np.pi, rel=0.02)
    text = warnings(inspect(log, {"M": True}))
    assert "irregular sampling: interval 2.296 ms" in text
    even = resample(log, 440.0)
    assert "irregular" not in warnings(inspect(even, {"M": True}))
    assert any("resampled from about" in note for note in even.notes)


def test_odrive_maps_load_with_one_name_for_every_file(data_dir: Path) -> None:
    columns = parse_columns({"M.u": {"column": "[0]", "unit": "A"}})
    maps = [
        bind(read(path), columns)["M.u"]
        for path in sorted((data_dir / "odrive_cogging").glob("coggingmap_*.npy"))
    ]
    measured = (maps[0] != 0) & (maps[1] != 0)
    assert np.corrcoef(maps[0][measured], maps[1][measured])[0, 1] > 0.99  # the readme: 0.999


def test_broad(data_dir: Path) -> None:
    paths = sorted((data_dir / "broad_imu").glob("*.mat"))
    assert paths
    for path in paths:
        log = load(BROAD, path)
        still = np.linalg.norm(np.stack([log[f"a{k}"][:500] for k in "xyz"]), axis=0)
        assert np.median(still) == pytest.approx(9.81, abs=0.1)
        assert read(path).scalars["sampling_rate"] == pytest.approx(285.714, abs=1e-3)
