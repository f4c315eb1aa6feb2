"""``pinotwin orientation``: quaternion and inclination from an IMU's log."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import scipy.io

import pinotwin as pt
from pinotwin.cli.main import main
from pinotwin.imu import rotation as rot
from pinotwin.imu.orientation import orientation
from pinotwin.log import Log
from pinotwin.logs.write import write_log
from pinotwin.reconstruction.orientation import orientation_of_log
from pinotwin.report.orientation import roll_pitch_heading
from tests.test_imu_orientation import swing
from tests.test_report import read

NAMES = ("gx", "gy", "gz", "ax", "ay", "az")


def swinging() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    q, gyr, acc = swing()
    t = np.arange(len(q)) / 200.0 + 3.0
    return q, {"t": t, **dict(zip(NAMES, [*gyr.T, *acc.T], strict=True))}


def rms_error(q: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean(rot.inclination_error(q, truth) ** 2)))


def test_the_inclination_of_a_swinging_sensor() -> None:
    truth, channels = swinging()
    found = orientation_of_log(Log(channels))
    np.testing.assert_array_equal(found.t, channels["t"])
    assert rms_error(found.q, truth) < 2e-3
    angle = np.arccos(rot.to_matrix(truth)[:, 2, 2])
    assert np.sqrt(np.mean((found.inclination - angle) ** 2)) < 2e-3


@pytest.mark.parametrize("method", ["offline", "vqf"])
def test_jitter_and_lost_samples_cost_little(method) -> None:
    truth, channels = swinging()
    rng = np.random.default_rng(1)
    keep = rng.random(len(truth)) > 0.03
    keep[3000:3020] = False
    found = orientation_of_log(Log({k: x[keep] for k, x in channels.items()}), method)
    whole = np.clip(np.round((found.t - 3.0) * 200.0).astype(int), 0, len(truth) - 1)
    assert found.missing == pytest.approx(0.00275, rel=0.1)
    assert rms_error(found.q, truth[whole]) < 5e-3


def test_the_command(tmp_path, capsys) -> None:
    truth, channels = swinging()
    write_log(tmp_path / "imu.csv", channels)
    out, facts = tmp_path / "orientation.csv", tmp_path / "facts.json"
    assert main(["orientation", str(tmp_path / "imu.csv"), "--out", str(out), "--json", str(facts)]) == 0
    assert "inclination of the sensor's z axis" in capsys.readouterr().out
    table = np.genfromtxt(out, delimiter=",", names=True)
    assert table.dtype.names == ("t", "qw", "qx", "qy", "qz", "inclination")
    q = np.stack([table[k] for k in ("qw", "qx", "qy", "qz")], axis=1)
    assert rms_error(q, truth) < 2e-3
    assert json.loads(facts.read_text())["rows"] == len(truth)


def test_the_page_tells_the_angles_and_how_far_two_methods_agree(tmp_path) -> None:
    """A sensor rolled by 20 and pitched by -10 deg, then turned by 90 about the vertical."""
    t = np.arange(4000) / 200.0
    rate = np.where((t > 5.0) & (t < 10.0), np.pi / 10.0, 0.0)
    pose = rot.multiply(rot.exp(np.radians([0.0, -10.0, 0.0])), rot.exp(np.radians([20.0, 0.0, 0.0])))
    q = np.stack([rot.multiply(rot.exp(np.array([0.0, 0.0, x])), pose) for x in np.cumsum(rate) / 200.0])
    up = np.tile([0.0, 0.0, 1.0], (len(t), 1))
    readings = np.hstack([rot.rotate(rot.conjugate(q), x) for x in (rate[:, None] * up, 9.81 * up)])
    write_log(tmp_path / "imu.csv", {"t": t, **dict(zip(NAMES, readings.T, strict=True))})
    words = ["orientation", str(tmp_path / "imu.csv"), "--out", str(tmp_path / "o.csv")]
    assert main([*words, "--report", str(tmp_path / "o.pdf")]) == 2
    assert main([*words, "--report", str(tmp_path / "o.html")]) == 0
    page = (tmp_path / "o.html").read_text()
    found = read(page)
    assert all(x.startswith(("#", "data:", "o.csv")) for x in found.loaded)
    assert 'href="o.csv"' in page
    low, high = (float(x) for x in re.search(r"inclined by ([\d.]+) to ([\d.]+)°", page).groups())
    assert low == pytest.approx(22.27, abs=0.05)
    assert high == pytest.approx(22.27, abs=0.05)
    angles = roll_pitch_heading(orientation_of_log(pt.read(tmp_path / "imu.csv")).q)
    np.testing.assert_allclose(angles[-1], [20.0, -10.0, 90.0], atol=0.1)
    rows = {row[0]: row[1] for row in found.rows if len(row) == 3}
    assert float(rows["inclination, against the other method"].split("°")[0]) < 0.2
    assert float(rows["mean horizontal acceleration, as a tilt"].rstrip("°")) < 0.02


def test_a_clock_that_restarts_and_a_long_hole_are_refused_in_one_line(tmp_path) -> None:
    _, channels = swinging()
    t = channels["t"].copy()
    t[4000:] -= 10.0
    with pytest.raises(pt.PinotwinError, match=r"t does not increase after .* cut the log"):
        orientation_of_log(Log({**channels, "t": t}))
    late = np.where(np.arange(len(t)) < 4000, channels["t"], channels["t"] + 2.0)
    with pytest.raises(pt.PinotwinError, match=r"a hole of 2 s after .* cut the log there"):
        orientation_of_log(Log({**channels, "t": late}))


def test_a_broad_trial_by_the_command_is_no_worse_than_vqf(data_dir, tmp_path) -> None:
    m = scipy.io.loadmat(data_dir / "broad_imu/07_undisturbed_fast_rotation_B.mat")
    t = np.arange(len(m["imu_gyr"])) / float(m["sampling_rate"].item())
    log = Log(
        {
            "t": t,
            **dict(zip(NAMES, [*m["imu_gyr"].T.astype(float), *m["imu_acc"].T.astype(float)], strict=True)),
        }
    )
    moving = m["movement"].ravel().astype(bool)
    errors = {}
    for method in ("offline", "vqf"):
        error = rot.inclination_error(orientation_of_log(log, method).q, m["opt_quat"].astype(float))
        errors[method] = float(np.sqrt(np.nanmean(error[moving] ** 2)))
    assert errors["offline"] <= errors["vqf"]


def test_filters_take_instantaneous_rates_for_what_they_are() -> None:
    """Half a sample late is 0.6 deg/s of a vibration at 20 Hz: more than the vibration."""
    t = np.arange(4000) / 400.0
    w = np.stack(
        [0.5 * np.sin(3.0 * t) + 0.01 * np.sin(125.0 * t), 0.4 * np.cos(2.0 * t), 0.3 * np.sin(t)], axis=1
    )
    q = rot.chain(rot.increments(w, 1 / 400.0))
    acc = rot.rotate(rot.conjugate(q), np.tile([0, 0, 9.81], (len(t), 1)))
    for method in ("ekf", "smoother", "vqf", "offline"):
        late, right = (
            _rate_error(orientation(w, acc, 400.0, method, rule=rule), w) for rule in ("mean", "coning")
        )
        assert right < 0.05, method
        assert right < 0.3 * late, method


def _rate_error(q: np.ndarray, w: np.ndarray) -> float:
    """RMS error of the rate that the orientations turn with between samples [deg/s]."""
    turn = 400.0 * rot.log(rot.multiply(rot.conjugate(q[:-1]), q[1:]))
    error = (turn - rot.increments(w, 1 / 400.0) * 400.0)[400:-400]
    return float(np.degrees(np.sqrt(np.mean(error**2))))


def test_vqf_is_the_default_of_the_command_and_of_python(tmp_path) -> None:
    _, channels = swinging()
    write_log(tmp_path / "imu.csv", channels)
    written = []
    for more in ([], ["--method", "vqf"], ["--method", "offline"]):
        out = tmp_path / f"o{len(written)}.csv"
        assert main(["orientation", str(tmp_path / "imu.csv"), "--out", str(out), *more]) == 0
        written.append(out.read_text())
    assert written[0] == written[1] != written[2]
    np.testing.assert_array_equal(
        orientation_of_log(Log(channels)).q, orientation_of_log(Log(channels), "vqf").q
    )
