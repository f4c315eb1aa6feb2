"""The command line: exit codes, JSON, files whole or not at all, bars on a terminal only."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pinotwin.arrays import plain
from pinotwin.cli import inputs
from pinotwin.cli import progress as bars
from pinotwin.cli.main import COMMANDS, main
from pinotwin.errors import InputError
from pinotwin.system.writing import whole_folder, write_json, write_text
from pinotwin.twin import Twin
from tests.rig import TRUTH, good_log, run, write_log, write_machine

PINOTWIN = [sys.executable, "-m", "pinotwin.cli.main"]


@pytest.fixture
def rig(tmp_path: Path) -> tuple[Path, Path]:
    return write_machine(tmp_path / "rig"), write_log(tmp_path / "log.csv", good_log())


@pytest.mark.parametrize("words", [["--help"], ["--version"], *([c, "--help"] for c in COMMANDS)])
def test_help_of_every_command(words: list[str], capfd: pytest.CaptureFixture[str]) -> None:
    assert run(*words) == 0
    said = capfd.readouterr()
    assert said.out.strip()
    assert said.err == ""


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_takes_json_and_out(command: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(command, "--help") == 0
    said = capfd.readouterr().out
    assert "--json FILE" in said
    assert "--out PATH" in said


@pytest.mark.parametrize("words", [["no_such"], ["check"], ["identify", "trunnion"]])
def test_wrong_words_are_one_line(words: list[str], capfd: pytest.CaptureFixture[str]) -> None:
    assert run(*words) == 2
    said = capfd.readouterr()
    assert said.err.count("\n") == 1
    assert "--help" in said.err
    assert said.out == ""


def test_check_of_a_machine_alone(
    rig: tuple[Path, Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run("check", rig[0], "--json", tmp_path / "r.json") == 0
    said = capfd.readouterr().out
    assert "rig: 2 axes, 4 base parameters" in said
    assert said.endswith("ok\n")
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["ok"] is True
    assert result["log"] is None
    assert list(result["axes"]) == ["X", "B"]
    assert result["axes"]["B"] == {"joint": "jb", "rotary": True, "effects": ["viscous", "coulomb"]}
    assert [row["excited"] for row in result["base_parameters"]] == [None] * 4


def test_check_of_a_log(rig: tuple[Path, Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run("check", *rig, "--json", tmp_path / "r.json") == 0
    assert "2000 rows, 3.998 s, 500 Hz" in capfd.readouterr().out
    result = json.loads((tmp_path / "r.json").read_text())
    assert all(row["excited"] for row in result["base_parameters"])
    assert result["condition"] > 1.0


def test_check_of_a_log_that_cannot_be_used_fails_with_1(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    still = {k: 0 * x if ".q" in k else x for k, x in good_log().items()}
    machine, log = write_machine(tmp_path / "rig"), write_log(tmp_path / "log.csv", still)
    assert run("check", machine, log, "--json", tmp_path / "r.json") == 1
    said = capfd.readouterr()
    assert "no axis moves; record a motion" in said.out
    assert said.out.endswith("not usable as it is: see the errors above\n")
    assert said.err == ""
    assert json.loads((tmp_path / "r.json").read_text())["ok"] is False


def test_identify_writes_a_twin_that_loads(
    rig: tuple[Path, Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "twin"
    words = ("--no-loop", "--out", out, "--json", out / "result.json")
    assert run("identify", *rig, *words) == 0
    said = capfd.readouterr()
    assert f"twin and report written to {out}" in said.out
    assert said.err == ""  # a pipe: no progress bar
    assert {p.name for p in out.iterdir()} == {
        "twin.json",
        "misfit.npz",
        "covariance.npz",
        "machine.yaml",
        "rig.urdf",
        "report.html",
        "result.json",
    }
    assert json.loads((out / "result.json").read_text()) == json.loads((out / "twin.json").read_text())
    twin = Twin.load(out)
    for name, value in TRUTH.items():
        assert twin.parameter(name).value == pytest.approx(value, rel=0.05, abs=0.005), name
    assert run("check", out) == 0  # a twin is a machine too


def test_a_twin_is_not_written_over_its_machine(
    rig: tuple[Path, Path], capfd: pytest.CaptureFixture[str]
) -> None:
    before = (rig[0] / "machine.yaml").read_bytes()
    assert run("identify", *rig, "--no-loop", "--out", rig[0]) == 2
    assert "holds the machine itself; give another folder" in capfd.readouterr().err
    assert (rig[0] / "machine.yaml").read_bytes() == before
    assert {p.name for p in rig[0].iterdir()} == {"rig.urdf", "machine.yaml"}


def test_check_writes_what_it_says(
    rig: tuple[Path, Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run("check", *rig, "--out", out) == 0
    assert (out / "check.txt").read_text() == capfd.readouterr().out
    assert json.loads((out / "check.json").read_text())["ok"] is True


def test_view_of_a_posture(rig: tuple[Path, Path], tmp_path: Path) -> None:
    words = ("--posture", "X=100mm,B=30deg", "--json", tmp_path / "r.json")
    assert run("view", *rig[:1], *words, "--out", tmp_path / "page") == 0
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["posture"] == pytest.approx({"X": 0.1, "B": np.pi / 6})
    assert Path(result["html"]).read_text().startswith("<!")


def test_validation_is_told_apart_from_the_fit(
    rig: tuple[Path, Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    other = good_log()
    other["X.u"] = other["X.u"] + 100.0 * np.sin(np.arange(2000) / 10)
    bad = write_log(tmp_path / "other.csv", other)
    out = tmp_path / "twin"
    assert run("identify", *rig, "--validate", bad, "--no-loop", "--out", out) == 0
    axis = json.loads((out / "twin.json").read_text())["quality"]["axes"]["X"]
    assert axis["fit"] < 0.02
    assert axis["validation"]["nrmse"] > 0.2


def test_two_joined_files_are_one_log(rig: tuple[Path, Path], tmp_path: Path) -> None:
    parts = {"x": {}, "b": {}}
    for name, values in good_log().items():
        parts["b" if name[0] == "B" else "x"][name] = values
    files = [write_log(tmp_path / f"{name}.csv", part) for name, part in parts.items()]
    joined = "+".join(map(str, files))
    assert run("check", rig[0], joined) == 0


def test_results_are_json_all_the_way(tmp_path: Path) -> None:
    value = {
        "array": np.arange(3),
        "scalar": np.float64(0.5),
        "whole": np.int64(3),
        "flag": np.True_,
        "nan": float("nan"),
        "inf": [np.inf, -np.inf],
        "path": Path("a/b"),
        3: {"set": {1}},
    }
    write_json(tmp_path / "r.json", value)
    assert json.loads((tmp_path / "r.json").read_text()) == {
        "array": [0, 1, 2],
        "scalar": 0.5,
        "whole": 3,
        "flag": True,
        "nan": None,
        "inf": [None, None],
        "path": "a/b",
        "3": {"set": [1]},
    }
    assert plain(np.array([1.0, np.nan])) == [1.0, None]


def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "r.json"
    write_text(target, "old")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match=r"No space left on device; the earlier one is kept"):
        write_text(target, "new")
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["r.json"]


def test_a_folder_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    out = tmp_path / "out"

    def half() -> None:
        with whole_folder(out) as folder:
            (folder / "a.txt").write_text("a")
            raise InputError("no")

    with pytest.raises(InputError):
        half()
    assert list(tmp_path.iterdir()) == []
    out.mkdir()
    (out / "mine.txt").write_text("keep")
    with whole_folder(out) as folder:
        (folder / "a.txt").write_text("a")
    assert {p.name for p in out.iterdir()} == {"mine.txt", "a.txt"}
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_trouble_of_the_system_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    for error, said in (
        (OSError(errno.ENOSPC, "No space left on device"), "the system says: No space left"),
        (PermissionError(errno.EACCES, "Permission denied", "/x"), "/x: Permission denied"),
    ):

        def fail(*_: object, error: OSError = error) -> int:
            raise error

        monkeypatch.setattr("pinotwin.logs.check.check", fail)
        assert main(["check", "trunnion"]) == 2
        text = capfd.readouterr().err
        assert text.startswith("pinotwin: " + said)
        assert text.count("\n") == 1


def test_a_message_of_several_lines_becomes_one(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> int:
        raise InputError("one\n  two\n")

    monkeypatch.setattr("pinotwin.logs.check.check", fail)
    assert main(["check", "trunnion"]) == 2
    assert capfd.readouterr().err == "pinotwin: one two\n"


def test_a_bug_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> int:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("pinotwin.logs.check.check", fail)
    with pytest.raises(ZeroDivisionError):
        main(["check", "trunnion"])


def test_stopping_by_hand(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    def stop(*_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr("pinotwin.logs.check.check", stop)
    assert main(["check", "trunnion"]) == 130
    assert capfd.readouterr().err == "pinotwin: stopped\n"


def test_a_reader_that_hangs_up_is_no_error() -> None:
    # `pinotwin check ... | head -1`, with a reader that is gone before the first line.
    with subprocess.Popen(
        [*PINOTWIN, "check", "emps"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as tool:
        assert tool.stdout is not None
        assert tool.stderr is not None
        tool.stdout.close()
        error = tool.stderr.read()
        assert tool.wait(timeout=60) == 0, error
    assert error == b""


def test_a_bar_on_a_terminal_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with bars.progress() as report:
        assert report is bars.silent
        report("working", 0.5)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with bars.progress() as report:
        assert report is not bars.silent
        report("working", 0.5)


def test_reading_a_long_log_is_shown_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "night.csv"
    file.write_text("t,X.q,X.u\n" + "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(100)))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert len(inputs.read_logs([str(file)])[0]) == 100
    assert capsys.readouterr().err == ""  # a short one is not
    inputs.read_logs([str(file)], large=100)
    said = capsys.readouterr().err
    assert "reading night.csv" in said
    assert "100 %" in said
