"""The docs tell the truth: their code runs, their links lead somewhere, the effects' page is current."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest
import yaml

import pinotwin as pt
from pinotwin.cli.main import COMMANDS, main

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A folder in which the paths of the README exist."""
    folder = tmp_path_factory.mktemp("readme")
    (folder / "out" / "demo").mkdir(parents=True)
    for name, seed in {"log": 1, "unseen": 2}.items():
        path = str(folder / "out" / "demo" / f"{name}.csv")
        assert main(["record", "trunnion", "--seconds", "8", "--seed", str(seed), "--out", path]) == 0
    return folder


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "python")], ids=lambda p: p.name)
def test_python_code_runs(page, workspace, monkeypatch, capsys):
    monkeypatch.chdir(workspace)
    names: dict[str, object] = {}
    for code in blocks(page, "python"):
        exec(compile(code, str(page), "exec"), names)  # our own documentation
    capsys.readouterr()


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_and_pictures_exist(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        assert "://" not in target, f"{page.name}: {target} needs the network"
        assert (page.parent / target).exists(), f"{page.name}: {target} does not exist"


def test_yaml_examples_have_known_keys():
    from pinotwin.machine.loading import AXIS_KEYS, KEYS

    for page in PAGES:
        for text in blocks(page, "yaml"):
            spec = yaml.safe_load(text)
            if "axes" in spec:
                assert set(spec) <= set(KEYS), page.name
                for axis in spec["axes"].values():
                    assert set(axis) <= set(AXIS_KEYS), page.name


def test_effects_page_is_what_the_effects_say():
    path = ROOT / "docs" / "generate_effects.py"
    spec = importlib.util.spec_from_file_location("generate_effects", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    written = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
    assert written == module.page(), "run `make docs`"


def test_readme_lists_every_command_and_machine():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for command in COMMANDS:
        assert f"pinotwin {command}" in readme
    machine_page = (ROOT / "docs" / "machine.md").read_text(encoding="utf-8")
    for name in pt.machines():
        assert f"`{name}`" in machine_page
