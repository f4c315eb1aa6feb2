"""``pinotwin study``: the source's studies as one page and tables."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import get_args

import pytest

from pinotwin.cli import study as command
from pinotwin.cli.main import main
from pinotwin.report.study import KINDS


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("study") / "log.csv"
    assert main(["record", "emps", "--seconds", "8", "--out", str(path)]) == 0
    return path


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_all_studies_of_a_drive(tmp_path: Path, log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    arguments = ["study", "emps", str(log), "--out", str(out), "--json", str(tmp_path / "x.json")]
    assert main([*arguments, "--window", "2,4"]) == 0
    page = (out / "study.html").read_text(encoding="utf-8")
    for title in (
        "How much data is enough",
        "The effort with and without each effect",
        "<h3>X</h3>",
        "The tracking error by cause",
    ):
        assert title in page
    without = {row["effect"]: row for row in rows(out / "without_X.csv")}
    coulomb = without["coulomb"]
    assert float(coulomb["without"]) > 3.0 * float(coulomb["RMS error with it [N, N·m]"])
    amount = rows(out / "amount.csv")
    assert float(amount[-1]["held out"]) <= float(amount[0]["held out"])
    shares = [float(row["share"]) for row in rows(out / "errors_X.csv")]
    assert sum(shares) == pytest.approx(1.0)
    assert set(json.loads((tmp_path / "x.json").read_text())["tables"]) == {p.name for p in out.glob("*.csv")}
    said = capsys.readouterr().out
    assert "without_X.csv: without dry friction the RMS error grows from " in said
    assert "of the tracking error comes from " in said
    assert "studies written to" in said


def test_the_command_knows_every_study() -> None:
    (kinds,) = get_args(get_args(command.Kinds)[0])
    assert get_args(kinds) == tuple(KINDS)


def test_the_window_is_what_the_errors_are_taken_from(tmp_path: Path, log: Path) -> None:
    found = []
    for window in ("1,3", "4,7"):
        out = tmp_path / window.replace(",", "_")
        assert (
            main(["study", "emps", str(log), "--only", "errors", "--window", window, "--out", str(out)]) == 0
        )
        found.append(rows(out / "errors_X.csv"))
    assert found[0] != found[1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--window", "3"], "--window: '3' is not LOW,HIGH in seconds"),
        (["--window", "3,1"], "--window: 3 is not before 1"),
        (["--axis", "Q", "--only", "amount"], "no axis 'Q'"),
        (["--only", "errors", "--window", "100,200"], "errors: "),
    ],
)
def test_mistakes_are_one_line(
    tmp_path: Path, log: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main(["study", "emps", str(log), *arguments, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
