"""The reconstruction on the virtual flexure rig, against its sealed truth."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks._imu_methods import methods
from pinotwin.cli.main import main
from pinotwin.columns import bind
from pinotwin.errors import DataError, InputError, LogError, MachineError
from pinotwin.imu.filters import high_passed
from pinotwin.log import Log
from pinotwin.logs.channels import usable
from pinotwin.logs.files import read
from pinotwin.machine import Machine
from pinotwin.reconstruction import Settings, Vibration, reconstruct_vibration, with_vibration
from pinotwin.reconstruction.combine import at_stamps, delay
from pinotwin.reconstruction.document import document
from pinotwin.reconstruction.sensor_log import imu_run
from pinotwin.reconstruction.servo import pieces
from pinotwin.trajectories.moves import random_trajectory
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual.imu import channels, link_motion, record_imu, sensor

DEG = np.pi / 180
SECONDS = 11.5
QUICK = Settings()


@cache
def rig() -> tuple[Machine, VirtualMachine]:
    return Machine.load("flexure_rig"), VirtualMachine.load("urdf/flexure_rig")


@cache
def recorded(seed: int, command: int = 3) -> tuple[Log, Log, Log, np.ndarray]:
    _, vm = rig()
    run = vm.record(random_trajectory(vm, SECONDS, command), seed=seed, truth_rate=2000.0)
    imus = [
        record_imu(run.truth, "C_link", vm.truth.seed, seed, k, drop=0.01, holes=((6.0, 6.2),))
        for k in (1, 2)
    ]
    return run.to_log(), *imus, np.stack([x[::5] for x in run.truth.joint("delta")])


@cache
def two_runs_two_imus() -> tuple[Vibration, np.ndarray]:
    runs = [recorded(1), recorded(2)]
    found = reconstruct_vibration(rig()[0], *([r[k] for r in runs] for k in range(3)))
    return found, np.mean([r[3] for r in runs], axis=0)


@cache
def one_run() -> Vibration:
    log, imu, _, _ = recorded(1)
    return reconstruct_vibration(rig()[0], log, imu, settings=QUICK)


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def gaps(found: Vibration, true: np.ndarray) -> tuple[float, float, float, float]:
    """Return RMS errors of dynamic angle, velocity, acceleration and the true angle's RMS [deg]."""
    m = found.motion
    fast = high_passed(m.t, m.q, 0.5), high_passed(m.t, true[0], 0.5)
    errors = (fast[0] - fast[1], m.v - true[1], m.a - true[2], fast[1])
    return tuple(rms(x) / DEG for x in errors)  # type: ignore[return-value]


def test_one_run_beats_the_sources_mean_of_22() -> None:
    angle, velocity, acceleration, size = gaps(one_run(), recorded(1)[3])
    assert velocity < 0.0474
    assert acceleration < 7.33
    assert angle < 0.001
    assert angle < 0.2 * size


def test_clock_scale_and_place_lie_within_their_errors() -> None:
    _, vm = rig()
    part, own = one_run().sensors[0].runs[0].found, sensor(vm.truth.seed, 1, 1)
    s = part.clock.segments[0]
    assert abs(s.at_pivot - own.clock.offset - (1 + own.clock.skew) * s.pivot) < 5e-5
    assert abs(part.clock.skew - own.clock.skew) < max(3e-6, 4 * part.clock.se_skew)
    error = np.abs(part.scale - own.gyro.scale)
    assert error.max() < 3e-4
    assert np.all(error < 4 * part.scale_se)
    batch = one_run().sensors[0].batch
    np.testing.assert_allclose(batch.R_ST, own.mounting.T, atol=0.05 * DEG)
    np.testing.assert_allclose(batch.shared("position")[0], own.position, atol=1e-3)


def test_two_runs_and_two_imus_are_better_than_one() -> None:
    found, true = two_runs_two_imus()
    angle, velocity, acceleration, _ = gaps(found, true)
    assert velocity < 0.02
    assert acceleration < 3.0
    assert angle < 0.0005
    assert found.spread[1] / DEG < 0.03
    assert np.all(found.motion.sd_v[found.motion.known] > 0.0)


def test_an_unused_imu_is_predicted_to_its_noise() -> None:
    found, _ = two_runs_two_imus()
    assert {(u.fitted, u.predicted) for u in found.unused} == {("imu1", "imu2"), ("imu2", "imu1")}
    noise = {"imu1": 0.083 * DEG, "imu2": 0.12 * DEG}  # RMS of Tables 6-3 and B-1
    for u in found.unused:
        assert u.gyro < 1.15 * noise[u.predicted]
        assert u.gyro_rigid > 1.5 * u.gyro
        assert u.accel_rigid > 5 * u.accel
        assert u.gyro_noise == pytest.approx(noise[u.predicted], rel=0.35)


def test_methods_that_integrate_drift() -> None:
    found, _ = two_runs_two_imus()
    rows = {m.method: m for m in methods(found.sensors)}
    assert set(rows) == {"naive", "high-passed", "ekf", "vqf", "batch"}
    for name in ("naive", "ekf", "vqf"):
        assert rows[name].slow > 0.01 * DEG
        assert rows[name].differ[0] > 10 * rows["batch"].differ[0]
    assert rows["batch"].differ[2] < 0.035 * DEG
    assert rows["batch"].differ[3] < 3.0 * DEG


def test_holes_in_the_servo_log_are_bridged_or_left_open() -> None:
    log, imu, _, true = recorded(1)
    rng = np.random.default_rng(0)
    keep = rng.random(len(log)) > 0.01
    keep[2200:2280] = False  # 0.2 s
    thin = log.rows(keep)
    found = reconstruct_vibration(rig()[0], thin, imu, settings=QUICK)
    known = found.motion.known
    assert len(found.motion.t) == keep.sum()
    assert known.mean() > 0.99
    assert rms((found.motion.v - true[1][keep])[known]) < 0.0474 * DEG
    assert {r.run for r in found.sensors[0].runs} == {0}
    assert len(found.sensors[0].runs) == 2


def test_a_restarted_clock_on_a_tilted_foundation() -> None:
    machine, vm = rig()
    run = vm.record(random_trajectory(vm, SECONDS, 3), seed=1, truth_rate=2000.0)
    upright = sensor(vm.truth.seed, 1, 1, restart=5.0, drop=0.01, holes=((6.0, 6.2),))
    tilted = replace(upright, gravity=9.81 * np.array([0.0, np.sin(3 * DEG), -np.cos(3 * DEG)]))
    reading = tilted.measure(link_motion(run.truth, "C_link"), np.random.default_rng(1))
    found = reconstruct_vibration(machine, run.to_log(), Log(channels(reading)), settings=QUICK)
    angle, velocity, acceleration, size = gaps(found, recorded(1)[3])
    assert velocity < 0.0474
    assert acceleration < 7.33
    assert angle < min(0.001, 0.2 * size)
    assert len(found.sensors[0].runs[0].found.clock.segments) == 2
    up = found.sensors[0].batch.R_GM_up
    assert up[1] == pytest.approx(-np.sin(3 * DEG), abs=2e-3)


def test_runs_that_start_late_are_aligned_and_others_refused() -> None:
    machine, _ = rig()
    log, imu, _, true = recorded(1)
    other, imu_b, _, _ = recorded(2)
    late = Log({**other.channels, "t": other.t + 0.7313})
    found = reconstruct_vibration(machine, [log, late], [imu, imu_b], settings=QUICK)
    assert found.delays[1] == pytest.approx(0.7313, abs=1e-5)
    known = found.motion.known
    assert rms((found.motion.v - true[1])[known]) < 0.05 * DEG
    with pytest.raises(DataError, match="is not a repeat of"):
        reconstruct_vibration(machine, [log, recorded(3, 4)[0]], [imu, recorded(3, 4)[1]], settings=QUICK)


def test_a_command_that_differs_by_a_few_percent_is_no_repeat() -> None:
    machine, _ = rig()
    log = recorded(1)[0]
    wave = np.std(log["Y.qr"]) * np.sin(7.0 * log.t)
    alike, apart = (log.with_channels({**log.channels, "Y.qr": log["Y.qr"] + s * wave}) for s in (0.005, 0.1))
    assert delay(machine, log, alike) == pytest.approx(0.0, abs=1e-3)
    with pytest.raises(DataError, match=r"differ by \d% of the motion"):
        delay(machine, log, apart)


def test_a_spline_bridges_short_holes_alone() -> None:
    t = 0.01 * np.arange(100)
    kept = np.delete(np.arange(100), [40, 41, 42, 70])
    found = at_stamps(t, t[kept], np.sin(5.0 * t[kept]), bridged=2.5)
    assert np.flatnonzero(np.isnan(found)).tolist() == [40, 41, 42]
    np.testing.assert_allclose(found[70], np.sin(5.0 * t[70]), atol=1e-6)


def test_a_log_that_does_not_rotate_is_a_clear_failure() -> None:
    machine, _ = rig()
    log, imu, _, _ = recorded(1)
    still = {n: np.full(len(log), x.mean()) for n, x in log.channels.items() if n[:2] in ("A.", "C.")}
    with pytest.raises(DataError, match="nothing rotates"):
        reconstruct_vibration(machine, Log({**log.channels, **still}), imu, settings=QUICK)
    other_run = recorded(3, 4)[1]
    with pytest.raises(DataError, match="no common rotation"):
        reconstruct_vibration(machine, log, other_run, settings=QUICK)


def test_wrong_input_says_what_to_do() -> None:
    machine, _ = rig()
    log, imu, _, _ = recorded(1)
    with pytest.raises(MachineError, match="no passive joint, so there is no deflection"):
        reconstruct_vibration(Machine.load("trunnion"), log, imu)
    with pytest.raises(DataError, match="link 'Y_link' does not move with the passive joint"):
        reconstruct_vibration(machine, log, imu, settings=Settings(links=("Y_link", None)))
    with pytest.raises(DataError, match="1 servo and 2 IMU logs; give them in pairs"):
        reconstruct_vibration(machine, log, [imu, imu])
    with pytest.raises(LogError, match="no channel 'gz'; an IMU log has t"):
        imu_run(Log({k: x for k, x in imu.channels.items() if k != "gz"}))
    with pytest.raises(LogError, match=r"too fast for rad/s.*gx \[deg/s\]"):
        imu_run(Log({**imu.channels, "gx": imu["gx"] / DEG}))
    with pytest.raises(LogError, match="not gravity in m/s²"):
        imu_run(Log({**imu.channels, **{n: imu[n] / 9.81 for n in ("ax", "ay", "az")}}))
    short = usable(machine, bind(log.rows(slice(0, 800)), machine.columns))
    with pytest.raises(DataError, match="at least 5 s are needed"):
        pieces(machine, short, "delta", "C_link", 100.0)


def test_units_in_the_header_are_converted() -> None:
    _, imu, _, _ = recorded(1)
    scaled = {n: imu[n] / DEG if n in ("gx", "gy", "gz") else imu[n] for n in imu.channels}
    log = Log(scaled, units={n: "deg/s" for n in ("gx", "gy", "gz")})
    np.testing.assert_allclose(imu_run(log).gyr, imu_run(imu).gyr, rtol=1e-12)


def test_merge_puts_the_velocity_on_the_logs_clock() -> None:
    log, _, _, true = recorded(1)
    merged = with_vibration(log, one_run())
    assert "delta.v" in merged
    assert "delta.q" not in merged
    whole = with_vibration(log.rows(slice(100, 3000, 2)), one_run(), row=True)
    assert len(whole) == 1450
    np.testing.assert_allclose(whole["delta.a"], one_run().motion.a[100:3000:2], atol=1e-4)
    shifted = Log({**log.channels, "t": log.t + 100.0})
    with pytest.raises(DataError, match="covers 0% of"):
        with_vibration(shifted, one_run())
    with pytest.raises(DataError, match=r"no channel <joint>\.v"):
        with_vibration(log, Log({"t": log.t}))
    del true


def test_document_is_plain_and_complete() -> None:
    from pinotwin.arrays import plain

    found, _ = two_runs_two_imus()
    text = json.dumps(plain(document(found)), allow_nan=False)
    out = json.loads(text)
    run = out["sensors"][0]["runs"][0]
    assert {"offset", "offset_se", "skew", "skew_se"} <= set(run["clock"])
    assert len(run["gyro_scale"]) == len(run["gyro_scale_se"]) == 3
    assert "quasi-static" in run["quasi_static"]["verdict"]


def test_commands_record_and_vibration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    servo, imu = tmp_path / "servo.csv", tmp_path / "imu.csv"
    words = ["record", "flexure_rig", "--out", str(servo), "--imu", str(imu), "--seconds", "10"]
    assert main(words) == 0
    assert list(read(imu).channels) == ["t", "gx", "gy", "gz", "ax", "ay", "az"]
    assert not any("delta" in name for name in read(servo).channels)
    out, report, js = (tmp_path / n for n in ("vib.csv", "vib.html", "vib.json"))
    words = [
        "vibration",
        "flexure_rig",
        "--servo",
        str(servo),
        "--imu",
        str(imu),
        "--out",
        str(out),
    ]
    assert main([*words, "--report", str(report), "--json", str(js)]) == 0
    said = capsys.readouterr().out
    assert "quasi-static" in said
    log = read(out)
    assert list(log.channels) == ["t", "delta.v", "delta.a", "delta.q"]
    np.testing.assert_array_equal(log.t, read(servo).t)
    assert json.loads(js.read_text())["joint"] == "delta"
    page = report.read_text()
    assert "http" not in page.split("plotly-packed")[0].replace("http://www.w3.org", "")


def test_command_errors_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "x.csv")
    assert main(["record", "trunnion", "--out", out, "--imu", str(tmp_path / "i.csv")]) == 2
    assert "say which link carries the sensor with --imu-link" in capsys.readouterr().err
    words = ["vibration", "flexure_rig", "--servo", "no.csv", "--imu", "no.csv", "--out"]
    assert main([*words, str(tmp_path / "x.txt")]) == 2
    assert main([*words, out]) == 2
    assert "no such file" in capsys.readouterr().err


def test_settings_name_the_joint() -> None:
    machine, _ = rig()
    log, imu, _, _ = recorded(1)
    with pytest.raises(InputError, match="no passive joint 'dela'; did you mean 'delta'"):
        reconstruct_vibration(machine, log, imu, settings=replace(QUICK, joint="dela"))
