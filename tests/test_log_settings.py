"""What machine.yaml says of logs: their clock, rows left out, measured speeds, the second encoder, repeats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.cli.main import main
from pinotwin.errors import DataError, LogError, MachineError
from pinotwin.log import Log
from pinotwin.logs.check import check
from pinotwin.logs.prepare import prepare
from pinotwin.logs.repeats import labels, same_motion
from pinotwin.machine import Machine
from tests.rig import YAML, write_machine

RATE = 500.0


def rig(folder: Path, more: str = "") -> Machine:
    return Machine.load(write_machine(folder / "rig", yaml=YAML + more))


def wave(t: np.ndarray, order: int = 0) -> np.ndarray:
    size, w = np.array([0.1, 0.03, 0.004]), 2 * np.pi * np.array([0.5, 2.1, 6.0])
    return np.sin(np.outer(t, w) + [0.3, 1.0, 2.0] + order * np.pi / 2) @ (size * w**order)


def log(rate: float = RATE, seconds: float = 12.0, source: str = "here.csv", **more: np.ndarray) -> Log:
    t = np.arange(int(seconds * rate)) / rate
    q = wave(t)
    channels = {"t": t, "X.q": q, "B.q": 2.0 * q, "X.u": 30.0 * wave(t, 2), "B.u": -4.0 * q}
    return Log(channels | {name.replace("_", "."): x for name, x in more.items()}, source)


def test_logs_of_unequal_rates_are_put_on_the_slowest(tmp_path: Path) -> None:
    machine = rig(tmp_path)
    motion = prepare(machine, [log(), log(200.0, source="slow.csv")], cutoff=30.0)
    assert motion.step == pytest.approx(1 / 200.0)
    assert len(motion.segments) == 2
    assert any("here.csv: resampled from about 500 Hz" in note for note in motion.notes)
    rows = np.concatenate([np.arange(s.start, s.stop) for s in motion.segments])
    assert np.abs(motion.a[rows, 0] - wave(motion.t[rows], 2)).max() < 0.03 * np.abs(motion.a).max()


@pytest.mark.parametrize("spelling", ["data: {resample: 100}\n", ""])
def test_a_log_is_resampled_when_asked_for(tmp_path: Path, spelling: str) -> None:
    machine = rig(tmp_path, spelling)
    motion = prepare(machine, log(), resample=None if spelling else 100.0)
    assert motion.step == pytest.approx(0.01)
    assert "low-passed at 40 Hz before" in " ".join(motion.notes)


def test_the_commands_take_a_rate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig(tmp_path)
    file = tmp_path / "log.csv"
    made = log()
    np.savetxt(
        file,
        np.column_stack(list(made.channels.values())),
        delimiter=",",
        header=",".join(made.channels),
        comments="",
    )
    folder, out = str(tmp_path / "rig"), str(tmp_path / "twin")
    assert main(["identify", folder, str(file), "--no-loop", "--resample", "100", "--out", out]) == 0
    assert "resampled from about 500 Hz" in capsys.readouterr().out
    twin = pt.Twin.load(out)
    assert twin.motion(pt.read(file)).step == pytest.approx(0.01)
    assert main(["check", folder, str(file), "--resample", "0"]) == 2
    assert "--resample: 0 Hz must be above 0" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("key", "left"),
    [("[[2, 3], [5, 5.5]]", True), ("{here.csv: [[2, 3], [5, 5.5]]}", True), ("{b.csv: [[2, 3]]}", False)],
)
def test_rows_are_left_out(tmp_path: Path, key: str, left: bool) -> None:
    motion = prepare(rig(tmp_path, f"data: {{leave_out: {key}}}\n"), log(), cutoff=30.0)
    t = np.concatenate([motion.t[s] for s in motion.segments])
    bad = ((t >= 2) & (t <= 3)) | ((t >= 5) & (t <= 5.5))
    assert bad.any() != left
    assert len(motion.segments) == (3 if left else 1)
    assert any("rows left out" in note for note in motion.notes) == left


@pytest.mark.parametrize(
    ("key", "said"),
    [
        (
            "leave_out: [2, 3]",
            r"data.leave_out: expected a list such as .*\{feedrate: 50\}\], found \[2, 3\]",
        ),
        ("leave_out: [{feed: fast}]", "data.leave_out: expected a list such as"),
        ("leave_out: [[3, 2]]", r"data.leave_out\[0\]: 3 to 2 s runs backward"),
        ("leave_out: soon", "data.leave_out: expected a list"),
        ("resample: 0", "data.resample: expected a positive number"),
    ],
)
def test_bad_settings_are_refused_with_their_path(tmp_path: Path, key: str, said: str) -> None:
    with pytest.raises(MachineError, match=said):
        rig(tmp_path, f"data: {{{key}}}\n")


def test_leaving_everything_out_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="excludes every row"):
        prepare(rig(tmp_path, "data: {leave_out: [[0, 100]]}\n"), log())


@pytest.mark.parametrize("value", ["7", "[7, 9]"])
def test_rows_are_left_out_by_the_value_of_a_channel(tmp_path: Path, value: str) -> None:
    key = f"data: {{leave_out: [{{feed: {value}}}]}}\n"
    machine = rig(tmp_path, f"{key}columns: {{feed: feed}}\n")
    t = log().t
    feed = np.where((t >= 2) & (t <= 3), 7.0, 1.0)
    motion = prepare(machine, log(feed=feed), cutoff=30.0)
    kept = np.concatenate([motion.t[s] for s in motion.segments])
    assert len(motion.segments) == 2
    assert not ((kept >= 2) & (kept <= 3)).any()
    assert any("rows left out" in note for note in motion.notes)


def test_leaving_out_by_a_channel_that_a_log_lacks_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="names the channel 'feed', which this log lacks"):
        prepare(rig(tmp_path, "data: {leave_out: [{feed: 7}]}\n"), log())


def test_check_names_the_state_that_bad_rows_share_as_a_key(tmp_path: Path) -> None:
    made = log()
    q, feed = made["X.q"].copy(), np.ones(len(made))
    for row in range(300, 3300, 300):
        q[row : row + 20] = 9.0
        feed[row : row + 20] = 50.0
    said = " ".join(
        f.message for f in check(rig(tmp_path, "columns: {feed: feed}\n"), log(X_q=q, feed=feed)).findings
    )
    assert "(data: {leave_out: [{feed: 50}]})" in said


def test_check_says_every_thing_once(tmp_path: Path) -> None:
    """What a reader noticed stays one note when rows are left out; a hole is told by its finding alone."""
    made = log()
    table = np.column_stack([1e3 * made["X.q"], *(made[k] for k in ("t", "X.u", "B.q", "B.u"))])
    table[500:520, 0] = np.nan
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="xact [mm],t,X.u,B.q,B.u", comments="")
    machine = rig(tmp_path, "columns: {X.q: {column: xact}}\ndata: {leave_out: [[2, 3]]}\n")
    messages = [f.message for f in check(machine, tmp_path / "a.csv").findings]
    holes = ["20 values missing, first in row 500; the log is cut there"]
    assert [m for m in messages if "values missing" in m] == holes
    assert "501 rows left out as data.leave_out says" in messages
    assert sorted(set(messages)) == sorted(messages)


def test_settings_survive_a_save(tmp_path: Path) -> None:
    more = "data: {resample: 100, leave_out: {b.csv: [[1, 2], {feed: 50}]}, order: 2}\nloop: {X: {closed_on: load}}\n"
    machine = rig(tmp_path, more)
    again = Machine.load(machine.save(tmp_path / "copy"))
    assert again.data == machine.data
    assert again.loop["X"].closed_on == "load"


def test_check_names_the_key_that_leaves_bad_rows_out(tmp_path: Path) -> None:
    made = log()
    q = made["X.q"].copy()
    for row in (700, 1500, 2200, 3000):
        q[row : row + 5] = 9.0
    said = " ".join(f.message for f in check(rig(tmp_path), log(X_q=q)).findings)
    assert "(data: {leave_out: [[1.4, 1.408], [3, 3.008], [4.4, 4.408], [6, 6.008]]})" in said


def test_measured_speed_and_acceleration_are_used(tmp_path: Path) -> None:
    machine = rig(tmp_path)
    t = log().t
    v, a = wave(t, 1), wave(t, 2)
    coarse = np.round(wave(t), 3)  # a position that cannot be differentiated twice
    motion = prepare(machine, log(X_q=coarse, B_q=2.0 * wave(t), X_v=v, X_a=a, B_v=2.0 * v), cutoff=30.0)
    rows = np.concatenate([np.arange(s.start, s.stop) for s in motion.segments])
    for k, gain in ((0, 1.0), (1, 2.0)):
        np.testing.assert_allclose(motion.v[rows, k], gain * v[rows], atol=0.02 * v.max())
        np.testing.assert_allclose(motion.a[rows, k], gain * a[rows], atol=0.03 * a.max())
    assert any("X.v, X.a, B.v as measured" in note for note in motion.notes)


@pytest.mark.parametrize("factor", [-1.0, 60.0])
def test_a_speed_that_is_not_the_positions_is_refused(tmp_path: Path, factor: float) -> None:
    with pytest.raises(LogError, match=r"here.csv: X.v: is not the position's derivative \(differs by"):
        prepare(rig(tmp_path), log(X_v=factor * wave(log().t, 1)), cutoff=30.0)


def test_a_second_encoder_is_a_channel_and_compared_in_one_line(tmp_path: Path) -> None:
    machine = rig(tmp_path, "loop: {X: {closed_on: load}}\ncolumns: {X.ql: {column: scale, unit: mm}}\n")
    assert machine.loop["X"].closed_on == "load"
    assert "B" not in machine.loop
    t = log().t
    lost = 20e-6 * np.sign(wave(t, 1))  # play: the load follows the motor 20 um late in either direction
    made = log(scale=1e3 * (wave(t) - lost + 1e-3))
    motion = prepare(machine, made, cutoff=30.0)
    assert motion.ql is not None
    rows = np.concatenate([np.arange(s.start, s.stop) for s in motion.segments])
    np.testing.assert_allclose(motion.ql[rows, 0], (wave(t) + 1e-3)[rows], atol=1e-3)
    assert np.isnan(motion.ql[:, 1]).all()
    assert motion.cut(10, 20).ql.shape == (10, 2)
    line = [f.message for f in check(machine, made).findings if f.channel == "X.ql"]
    assert len(line) == 1
    assert "offset 999.8 µm" in line[0]  # 1 mm, less the mean of the play over its way
    assert "lost motion between the directions 40" in line[0]


def test_a_second_encoder_in_another_unit_is_said(tmp_path: Path) -> None:
    found = check(rig(tmp_path), log(X_ql=1e3 * wave(log().t))).findings
    assert any(
        f.channel == "X.ql" and f.severity == "warning" and "1000 times as far" in f.message for f in found
    )


def test_a_motor_that_turns_two_joints_is_said_with_its_transmission(tmp_path: Path) -> None:
    t = log().t
    turn = 0.3 * np.sin(2.9 * t + 0.7)
    found = check(rig(tmp_path), log(B_q=turn, X_ql=2.0 * wave(t) - 0.5 * turn)).findings
    line = next(f.message for f in found if f.channel == "X.ql")
    assert line.endswith(
        "its motor turns several joints; write transmission: {X: {X: 0.5, B: 0.25}} in machine.yaml"
    )


def test_where_the_loop_is_closed_is_one_of_two(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"loop\.X\.closed_on: expected motor or load, found 'both'"):
        rig(tmp_path, "loop: {X: {closed_on: both}}\n")


def test_runs_without_a_command_are_repeats_when_their_motion_agrees(tmp_path: Path) -> None:
    machine = rig(tmp_path)
    t = log().t
    rng = np.random.default_rng(5)
    late = log(X_q=wave(t - 0.06) + 1e-4 * rng.normal(size=len(t)), B_q=2.0 * wave(t - 0.06))
    other = log(X_q=wave(1.1 * t), B_q=2.0 * wave(1.1 * t))
    motions = [prepare(machine, item, cutoff=30.0) for item in (log(), late, other)]
    assert same_motion(motions[0], motions[1])
    assert not same_motion(motions[0], motions[2])
    assert labels(motions) == (0, 0, 2)
    commanded = [replace(m, qr=m.q) for m in motions]
    assert labels(commanded) == (0, 0, 2)
    assert not same_motion(motions[0], motions[0].cut(0, 3000))


def test_real_repeats_without_a_command(data_dir: Path) -> None:
    """KUKA LWR4: runs 1 and 2 are one command, run 3 is another."""
    folder = data_dir / "kuka_lwr4"
    machine = Machine.load(folder / "machine.yaml")
    motions = [prepare(machine, pt.read(folder / f"measurements_{k}.csv"), cutoff=8.0) for k in (1, 2, 3)]
    assert labels([replace(m, qr=None, vr=None, ar=None) for m in motions]) == (0, 0, 2)
