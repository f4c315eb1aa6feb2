"""What the commands print fits 80 columns, words and numbers with their units."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
from pathlib import Path

import pytest

from pinotwin.cli.main import main
from pinotwin.cli.output import columns, say

LONG = "next: Y.viscous: " + "check the lubricant and its temperature; " * 6


def test_long_lines_are_wrapped_below_their_text(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    say(LONG.strip())
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    assert max(map(len, lines)) <= 80
    assert all(line.startswith("      ") for line in lines[1:])
    assert " ".join(" ".join(lines).split()) == LONG.strip()


def test_a_pipe_gets_whole_lines(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    say(LONG)
    assert capsys.readouterr().out == LONG + "\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a log of the bundled trunnion, its open-loop twin and what `identify` said in 80 columns."""
    folder = tmp_path_factory.mktemp("made")
    log, twin, said = str(folder / "log.csv"), str(folder / "twin"), io.StringIO()
    assert main(["record", "trunnion", "--seconds", "4", "--out", log]) == 0
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(said):
        patch.setenv("COLUMNS", "80")
        assert main(["identify", "trunnion", log, "--no-loop", "--out", twin]) == 0
    (folder / "identified.txt").write_text(said.getvalue(), encoding="utf-8")
    return folder


COMMANDS = (
    ("check", "trunnion", "log.csv"),
    ("record", "trunnion", "--seconds", "1", "--out", "second.csv"),
    ("force", "twin", "log.csv", "--out", "force.csv"),
    ("compare", "twin", "twin2", "--out", "moved"),
    ("view", "twin", "log.csv", "--html", "page.html"),
    ("export", "twin", "--format", "numpy", "--out", "effort.py"),
    ("new", "XYZAC", "log.csv", "--out", "fresh"),
    ("check", "ur5"),
    ("study", "--help"),
    (),
)


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: " ".join(words[:2]) or "pinotwin")
def test_output_fits_80_columns(
    made: Path, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(made)
    if "twin2" in words:
        (made / "twin2").mkdir(exist_ok=True)
        for path in (made / "twin").iterdir():
            (made / "twin2" / path.name).write_bytes(path.read_bytes())
    try:
        code = main(list(words))
    except SystemExit as ended:  # argparse's help
        code = int(ended.code or 0)
    assert code in (0, 1)
    fits(capsys.readouterr().out)


def fits(said: str) -> None:
    assert said
    assert [line for line in said.splitlines() if len(line) > 80] == []


def test_what_identify_says_fits_80_columns(made: Path) -> None:
    fits((made / "identified.txt").read_text(encoding="utf-8"))


def test_the_program_itself_fits_80_columns_and_says_its_numbers_with_units(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    words = [
        sys.executable,
        "-m",
        "pinotwin.cli.main",
        "diagnose",
        "twin",
        "log.csv",
        "--quick",
        "--out",
        "d",
    ]
    done = subprocess.run(words, cwd=made, capture_output=True, text=True, check=True)
    fits(done.stdout)
    rows = [line for line in done.stdout.splitlines() if line[:4] in ("Y.u ", "A.u ", "C.u ")]
    assert len(rows) == 3
    assert all(row.split()[2] in ("N", "N·m", "mN", "mN·m") for row in rows)


ROBOT = ["shoulder_pan_joint", "a", "wrist_1_joint"]


def test_long_names_and_long_numbers_stay_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [[f"{name}.u", "-1.23e+03 N·m", "3.16 N·m", "3.5 N·m", "0.000173 N·m", "agrees"] for name in ROBOT]
    head = ("RMS", "gap", "after", "misfit", "noise", "grade")
    for wide in (60, 80, 120):
        monkeypatch.setenv("COLUMNS", str(wide))
        lines = columns(head, rows, left=(0, 5))
        assert max(map(len, lines)) <= max(wide, 75)
        cells = " ".join(lines).split("  ")
        assert sum("N·m" in cell for cell in cells) == 12  # each number is a cell of its own
        assert lines[0].index("grade") == lines[-1].index("agrees")
        assert all(any(f"{name}.u" in line.split() for line in lines) for name in ROBOT)


def test_the_largest_number_stands_under_its_head() -> None:
    lines = columns(("axis", "largest"), [["Y", "13.3 N·m"], ["shoulder_pan_joint", "1 N"]])
    assert [len(line) for line in lines] == [len(lines[0])] * 3
