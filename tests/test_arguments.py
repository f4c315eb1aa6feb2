"""The arguments of a command are those of its function: kinds, defaults, help, files that it writes."""

from __future__ import annotations

import argparse
import inspect
from pathlib import Path
from typing import Literal

import pytest

from pinotwin.cli.arguments import (
    SHARED,
    Answer,
    AnyNumber,
    File,
    Folder,
    LogFile,
    PageFile,
    Repeated,
    Several,
    Share,
    add_arguments,
    check_outputs,
)
from pinotwin.cli.main import COMMANDS, command_of
from pinotwin.errors import InputError, OutputError
from pinotwin.virtual.amounts import INJECT, INJECT_MACHINE


def sample(
    machine: str,
    logs: Several,
    *,
    rate: float = 2.5,
    part: Share = 0.02,
    rows: int | None = None,
    mode: Literal["fast", "safe"] = "safe",
    quick: bool = False,
    mass: Several = (),
    free: AnyNumber | None = None,
    validate: Repeated = (),
    cutoff: float | None = None,
    old_name: bool = False,
    page: File | None = None,
    out: Folder,
) -> Answer:
    """Do it.

    Args:
        machine: a machine
        logs (LOG): its logs, of which there
            may be several
        rate (HZ): 50 % of it
        part (P): of the whole
        rows (N): how many
        mode: how
        quick: in a hurry
        mass (AXIS=KG): of an axis
        free (AXIS): axes
        validate (LOG): others
        page (FILE): to write
        out (PATH): folder
    """
    return Answer([machine, *logs], {"rate": rate})


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(prog="sample")
    add_arguments(made, sample)
    return made


def test_words_become_values() -> None:
    values = vars(parser().parse_args(["m", "a.csv", "b.csv", "--out", "o"]))
    written = values.pop("written")
    assert values == {
        **{
            "machine": "m",
            "logs": ["a.csv", "b.csv"],
            "rate": 2.5,
            "part": 0.02,
            "rows": None,
            "mode": "safe",
        },
        **{"quick": False, "mass": [], "free": None, "validate": [], "cutoff": None, "old_name": False},
        **{"page": None, "effects": [], "json": None, "out": "o"},
    }
    assert (written["json"], written["page"], written["out"]) == (("file",), ("file",), ("folder",))


def test_options_stand_anywhere_and_take_one_several_or_none() -> None:
    words = (
        "--rate=1e2 --mass X=1 Y=2 --out o --validate c --validate d m a --free --rows 3 --mode fast --quick"
    )
    values = vars(parser().parse_args(words.split()))
    assert (values["machine"], values["logs"], values["rate"], values["rows"]) == ("m", ["a"], 100.0, 3)
    assert (values["mass"], values["validate"], values["free"]) == (["X=1", "Y=2"], ["c", "d"], [])
    assert (values["mode"], values["quick"]) == ("fast", True)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("m a", "the following arguments are required: --out"),
        ("--out o", "the following arguments are required: machine, LOG"),
        ("m a --out o --rate x", "argument --rate: invalid float value: 'x'"),
        (
            "m a --out o --part 150%",
            "argument --part: 150%: give a share between 0 and 1, such as 0.02 or 2%",
        ),
        ("m a --out o --part few", "argument --part: few: give a share"),
        ("m a --out o --mode slow", "argument --mode: invalid choice: 'slow'"),
    ],
)
def test_wrong_words_are_told(words: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parser().parse_args(words.split())
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(("word", "share"), [("2%", 0.02), ("0.02", 0.02), ("12.5%", 0.125)])
def test_a_share_is_written_in_per_cent_or_as_a_number(word: str, share: float) -> None:
    assert parser().parse_args(["m", "a", "--out", "o", "--part", word]).part == pytest.approx(share)


def test_help_is_that_of_the_docstring_with_defaults() -> None:
    text = " ".join(parser().format_help().split())
    assert "LOG its logs, of which there may be several" in text
    assert "--rate HZ 50 % of it (2.5)" in text
    assert "--mode {fast,safe} how (safe)" in text
    assert f"--cutoff HZ {SHARED['cutoff'][1]}" in text
    assert "--effects FILE" in text  # its first argument is a machine
    assert "old-name" not in text


def test_files_are_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    page, log = PageFile.__metadata__, LogFile.__metadata__  # type: ignore[attr-defined]
    for path, tags, kind, said in (
        ("p.pdf", page, InputError, "--x: p.pdf: a page is written as .html or .htm"),
        ("l.txt", log, InputError, "--x: l.txt: a log is written as .csv or .parquet"),
        (str(tmp_path), ("file",), OutputError, "is a folder; give a file name"),
        (str(tmp_path / "file"), ("folder",), OutputError, "is a file; give a folder"),
    ):
        with pytest.raises(kind, match=said):
            check_outputs({"x": path}, {"x": tags})
    check_outputs({"x": None, "y": str(tmp_path / "l.csv")}, {"x": page, "y": log})


@pytest.mark.parametrize("command", COMMANDS)
def test_every_argument_of_a_command_has_its_help(command: str) -> None:
    made = argparse.ArgumentParser()
    add_arguments(made, command_of(command))
    silent = {action.dest for action in made._actions if action.help == argparse.SUPPRESS}
    assert silent == ({"no_methods"} if command == "vibration" else set())


def test_record_names_every_effect_that_can_be_injected() -> None:
    text = inspect.getdoc(command_of("record")) or ""
    names = text.partition("Of an axis: ")[2].partition("\n    axis:")[0]
    axis, _, machine = " ".join(names.split()).partition("; of the machine: ")
    assert axis.split(", ") == list(INJECT)
    assert machine.split(", ") == list(INJECT_MACHINE)
