"""The page of a simulation: errors as they were put in, graded by what the twin left of its own logs."""

from __future__ import annotations

import dataclasses
import importlib.util
from pathlib import Path

import numpy as np
import pytest

from pinotwin.cli.main import main
from pinotwin.diagnosis.grade import printed
from pinotwin.log import Log
from pinotwin.report.simulation import expected_error, grade_of, simulation_report
from pinotwin.system.phrases import SIMULATED_GRADES
from pinotwin.viewer.rerun import write_recording
from tests.simulated import known_twin, plain_machine, smooth_command
from tests.test_report import read

QUALITY = {
    "servos": {"Y": {"held_out": {"e": 0.01, "u": 0.03}}},
    "simulation": {"held_out": {"coupled": 0.02, "black": None}},
}


@pytest.fixture(scope="module")
def twin():
    return dataclasses.replace(known_twin(plain_machine("trunnion")), quality=QUALITY)


@pytest.fixture(scope="module")
def predicted(twin) -> Log:
    return twin.simulate(smooth_command(twin.machine, 1.0, 500.0), controller="black")


def measured(twin, predicted: Log, share: float) -> Log:
    """Return a log of what was predicted, with errors of a known share of its RMS on every signal."""
    command = smooth_command(twin.machine, 1.0, 500.0)
    channels = dict(command.channels)
    wave = np.where(np.arange(len(command.t)) % 2, 1.0, -1.0)
    for axis in twin.machine.axes:
        for signal in "eu":
            x = predicted[f"{axis}.{signal}"]
            x = x + share * np.sqrt(np.mean(x**2)) * wave
            channels[f"{axis}.{'q' if signal == 'e' else 'u'}"] = (
                command[f"{axis}.qr"] - x if signal == "e" else x
            )
    return Log(channels, source="known.csv")


def test_the_reference_is_the_larger_of_loop_and_whole_simulation(twin) -> None:
    assert expected_error(twin, "Y", "e", "coupled") == 0.02
    assert expected_error(twin, "Y", "u", "coupled") == 0.03
    assert expected_error(twin, "Y", "u", "black") is None


@pytest.mark.parametrize(
    ("share", "word"), [(0.025, "within misfit"), (0.033, "above misfit"), (0.2, "far above misfit")]
)
def test_a_known_error_is_stated_and_graded(twin, predicted, share: float, word: str) -> None:
    log = measured(twin, predicted, share)
    known = dataclasses.replace(predicted, command=log, controller="coupled")
    page = read(simulation_report(known))
    rows = {(r[0], r[1]): r for r in page.rows if len(r) == 8}
    row = rows["A", "tracking error"]
    assert float(row[3].split()[0]) == pytest.approx(100 * share, rel=0.03)
    assert row[6] == "2.0 %"
    assert row[7] == printed(word)
    assert grade_of(share, 0.02) == word


def test_a_log_of_the_command_alone_is_predicted_and_not_judged(predicted) -> None:
    text = simulation_report(predicted)
    assert "nothing to hold the prediction against" in text
    assert not any(f">{word}</span>" in text for word in SIMULATED_GRADES)


def test_names_of_files_are_checked_before_anything_is_simulated(tmp_path: Path, capfd) -> None:
    words = ["simulate", "no_twin", "no.csv", "--out", str(tmp_path / "p.csv")]
    assert main([*words, "--report", str(tmp_path / "p.pdf")]) == 2
    assert "--report: p.pdf: a page is written as .html" in capfd.readouterr().err
    assert main([*words, "--rrd", str(tmp_path / "p.mcap")]) == 2
    assert "a recording for Rerun is written as .rrd" in capfd.readouterr().err


@pytest.mark.skipif(importlib.util.find_spec("rerun") is not None, reason="Rerun is installed")
def test_without_rerun_one_line_says_so(tmp_path: Path, capfd) -> None:
    table, recording = (str(tmp_path / name) for name in ("p.csv", "p.rrd"))
    assert main(["simulate", "no_twin", "no.csv", "--out", table, "--rrd", recording]) == 2
    said = capfd.readouterr().err
    assert said.count("\n") == 1
    assert "pip install rerun-sdk" in said
    assert not list(tmp_path.iterdir())


def test_view_records_logs_alone(tmp_path: Path, capfd) -> None:
    recording = str(tmp_path / "p.rrd")
    for words, said in (
        (["view", "emps", "--rrd", recording], "records the motion of a log"),
        (["view", "emps", "no.csv", "--rrd", str(tmp_path / "p.mcap")], "is written as .rrd"),
        (["view", "emps", "no.csv", "--rrd", recording, "--html", "p.html"], "leave out --html"),
    ):
        assert main(words) == 2
        assert said in capfd.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_recording_for_rerun_is_written(twin, predicted, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="Rerun is not installed")
    log = measured(twin, predicted, 0.02)
    for name, moves in (("p.rrd", predicted), ("log.rrd", None)):
        write_recording(tmp_path / name, twin.machine, log, moves)
        assert (tmp_path / name).read_bytes()[:3] == b"RRF"
