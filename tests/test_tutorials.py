"""The tutorials are true word by word: their commands run in order, and print the lines that the page shows.

A block with ``pinotwin`` lines holds commands. The ``text`` block behind it holds lines of what the last of
them prints, in their order; a line ``...`` stands for any number of lines, a number may differ by 2 %.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from pinotwin.cli.main import main

ROOT = Path(__file__).resolve().parents[1]
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
BLOCK = re.compile(r"```(\w*)\n(.*?)```", re.DOTALL)


def commands(text: str) -> list[list[str]]:
    """Return the arguments of every ``pinotwin`` line, continued lines joined, comments dropped."""
    lines = re.sub(r"\\\n\s*", " ", text).splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("pinotwin ")]


def same(shown: str, printed: str) -> bool:
    """Return whether the two lines have the same words, and numbers within 2 % of each other."""
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split():
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    return all(float(a) == pytest.approx(float(b), rel=0.02, abs=1e-12) for a, b in pairs)


def missing(shown: str, printed: str) -> list[str]:
    """Return the shown lines that were not printed in their order."""
    rest, out = iter(printed.splitlines()), []
    for line in (x for x in shown.splitlines() if x.strip() not in ("", "...")):
        seen = list(rest)
        at = next((k for k, other in enumerate(seen) if same(line.strip(), other.strip())), None)
        if at is None:
            out.append(line)
        rest = iter(seen if at is None else seen[at + 1 :])
    return out


@pytest.mark.parametrize("page", ["cnc", "robot", "research", "vibration"])
def test_tutorial_runs_and_prints_what_it_shows(page, tmp_path, monkeypatch, capsys):
    (tmp_path / "examples").mkdir()
    (tmp_path / "examples" / "data").symlink_to(ROOT / "examples" / "data")
    monkeypatch.chdir(tmp_path)
    printed = ""
    checked = 0
    for language, text in BLOCK.findall((ROOT / "docs" / f"tutorial_{page}.md").read_text(encoding="utf-8")):
        for arguments in commands(text) if language == "" else []:
            assert main(arguments) == 0, arguments
            printed = capsys.readouterr().out
        if language == "text":
            assert not missing(text, printed), printed
            checked += 1
    assert checked


@pytest.mark.parametrize(
    ("shown", "printed", "lost"),
    [
        ("b 56.8 -> 183 N", "b 57.1 -> 182.6 N", []),
        ("b 56.8 -> 183 N", "b 60.0 -> 182.6 N", ["b 56.8 -> 183 N"]),
        ("first\n...\nthird", "first\nsecond\nthird", []),
        ("third\nfirst", "first\nsecond\nthird", ["first"]),
        ("Y rises", "Y falls", ["Y rises"]),
    ],
)
def test_lines_are_compared_by_words_order_and_numbers(shown, printed, lost):
    assert missing(shown, printed) == lost
