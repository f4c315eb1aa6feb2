"""docs/own_effect.md, word by word: its code runs, prints what it shows, and its commands end well."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import yaml

from pinotwin.cli.main import main
from pinotwin.effects import known
from tests.conftest import ROOT

PAGE = (ROOT / "docs" / "own_effect.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r'```(\w+)(?: title="(.*?)")?\n(.*?)```', PAGE, re.DOTALL)


def test_the_page_is_true(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    names: dict[str, object] = {}
    for kind, title, text in BLOCKS:
        if title:
            Path(title).write_text(text, encoding="utf-8")
        elif kind == "python":
            exec(compile(text, "own_effect.md", "exec"), names)  # our own page
        elif kind == "yaml":
            listed = yaml.safe_load(Path("machine/machine.yaml").read_text())["axes"]["X"]["effects"]
            assert listed == yaml.safe_load(text)["axes"]["X"]["effects"]
        elif kind == "console":
            capsys.readouterr()
            for line in text.splitlines():
                assert main(shlex.split(line)[1:]) == 0, line
            capsys.readouterr()
        elif kind == "text" and not text.startswith("pinotwin: "):
            assert capsys.readouterr().out == text
    (said,) = (text for kind, _, text in BLOCKS if text.startswith("pinotwin: "))
    words = [sys.executable, "-m", "pinotwin.cli.main", "check", "machine"]
    alone = subprocess.run(
        words, capture_output=True, text=True, check=False, cwd=tmp_path, env=_path(tmp_path)
    )
    assert alone.returncode == 2
    assert alone.stderr == said
    assert "root_drag" not in known()
    del sys.modules["drag"]


def _path(folder: Path) -> dict[str, str]:
    """An environment in which the package is found and the folder is not on Python's path."""
    return {"PYTHONPATH": str(ROOT), "PYTHONSAFEPATH": "1", "PATH": "/usr/bin:/bin", "HOME": str(folder)}


def test_it_is_20_lines():
    (code,) = (text for _, title, text in BLOCKS if title == "drag.py")
    assert sum(bool(line.strip()) for line in code.splitlines()) <= 20
