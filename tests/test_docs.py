"""The docs tell the truth: their code runs, their links lead somewhere, the effects' page is current."""

from __future__ import annotations

import importlib
import importlib.util
import re
import types
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import wavfile

import pinotwin as pt
from pinotwin.cli.main import COMMANDS, main

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A folder in which the paths of the README exist."""
    folder = tmp_path_factory.mktemp("readme")
    (folder / "out" / "demo").mkdir(parents=True)
    for name, seed in {"log": 1, "unseen": 2}.items():
        path = str(folder / "out" / "demo" / f"{name}.csv")
        assert main(["record", "trunnion", "--seconds", "6", "--seed", str(seed), "--out", path]) == 0
    log, worn = (str(folder / "out" / "demo" / f"{name}.csv") for name in ("log", "worn"))
    fault = ["--command", log, "--seed", "9", "--inject", "viscous:Y=0.5"]
    assert main(["record", "trunnion", *fault, "--out", worn]) == 0
    return folder


@pytest.fixture(scope="module")
def identified() -> dict[tuple[object, ...], pt.Twin]:
    """What was identified already: pages that ask the same of the same log share the twin."""
    return {}


RUN = [p for p in PAGES if blocks(p, "python") and p.name != "own_effect.md"]  # its own test runs it


@pytest.mark.parametrize("page", RUN, ids=lambda p: p.name)
def test_python_code_runs(page, workspace, identified, monkeypatch, capsys):
    really = pt.identify

    def once(machine: pt.Machine, log: pt.Log, **options: object) -> pt.Twin:
        if options.get("loop", True) and str(getattr(log, "source", log)).endswith("log.csv"):
            options.setdefault(
                "validate", pt.read("out/demo/unseen.csv")
            )  # no page minds being validated too
        key = (
            machine.name,
            str(getattr(machine, "path", id(machine))),  # a pin.Model has none
            getattr(log, "source", str(log)),
            repr(sorted((k, getattr(v, "source", v)) for k, v in options.items())),
        )
        if key not in identified:
            identified[key] = really(machine, log, **options)
        return identified[key]

    monkeypatch.setattr(pt, "identify", once)
    monkeypatch.chdir(workspace)
    names: dict[str, object] = {}
    for code in blocks(page, "python"):
        exec(compile(code, str(page), "exec"), names)  # our own documentation
    capsys.readouterr()


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_and_pictures_exist(page):
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
        assert "://" not in target, f"{page.name}: {target} needs the network"
        assert (page.parent / target).exists(), f"{page.name}: {target} does not exist"


def test_yaml_examples_have_known_keys():
    from pinotwin.machine.parts import Axis, MachineFile
    from pinotwin.system.reading import kinds_of

    specs = [(page.name, yaml.safe_load(text)) for page in PAGES for text in blocks(page, "yaml")]
    whole = [(page, spec) for page, spec in specs if "axes" in spec]
    assert whole
    for page, spec in whole:
        assert set(spec) <= set(kinds_of(MachineFile)), page
        for axis in spec["axes"].values():
            assert set(axis) <= set(kinds_of(Axis)), page


def test_effects_page_is_what_the_effects_say():
    path = ROOT / "docs" / "generate_effects.py"
    spec = importlib.util.spec_from_file_location("generate_effects", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    written = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
    assert written == module.page(), "run `make docs`"


def test_the_docs_list_every_command_and_machine():
    assert "docs/commands.md" in text_of("README.md")
    page = text_of("docs/commands.md")
    for command in COMMANDS:
        assert f"pinotwin {command}" in page
    machine_page = text_of("docs/machine.md")
    for name in pt.machines():
        assert f"`{name}`" in machine_page


def test_the_site_builds_without_a_warning(tmp_path, monkeypatch):
    import logging

    pytest.importorskip("material")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("NO_MKDOCS_2_WARNING", "1")
    config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(tmp_path / "site"), strict=True)
    heard = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = heard.append
    logging.getLogger("mkdocs").addHandler(handler)
    try:
        config.plugins.on_startup(command="build", dirty=False)
        build(config)
    finally:
        logging.getLogger("mkdocs").removeHandler(handler)
        config.plugins.on_shutdown()
    assert [record.getMessage() for record in heard] == []
    written = {path.stem for path in (tmp_path / "site").glob("*.html")}
    assert {page.stem for page in PAGES if page.name != "README.md"} <= written
    assert {"notebook_robot", "notebook_drive"} <= written
    start = (tmp_path / "site" / "index.html").read_text(encoding="utf-8")
    assert "fonts.googleapis" not in start
    assert "unpkg" not in start
    assert 'src="iframe-worker.js"' in start
    assert (tmp_path / "site" / "search" / "search_index.js").is_file()
    api = (tmp_path / "site" / "api.html").read_text(encoding="utf-8")
    assert "Read a recording" in api


def test_every_page_is_in_the_navigation():
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for page in PAGES:
        assert page.name == "README.md" or page.name in text, page.name


def test_what_contributing_shows_is_true(tmp_path, monkeypatch) -> None:
    """The effect and the reader of docs/contributing.md do what they say."""
    text = text_of("docs/contributing.md")
    for name, code in re.findall(r'```python title="pinotwin/\S*/(\w+)\.py"\n(.*?)```', text, re.DOTALL):
        (tmp_path / f"shown_{name}.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    effect, reader = importlib.import_module("shown_cubic"), importlib.import_module("shown_wav")
    motion = types.SimpleNamespace(v=np.array([-1.0, 2.0]))
    assert effect.CubicDrag("X").axis_columns(motion).tolist() == [[-1.0], [8.0]]
    file, cut = tmp_path / "shake.wav", tmp_path / "cut.wav"
    wavfile.write(file, 500, np.zeros((9, 2), np.float32))
    content = reader.load(file, file.name)
    assert content.arrays["shake"].shape == (9, 2)
    assert content.arrays["t"][-1] == pytest.approx(8 / 500)
    cut.write_bytes(file.read_bytes()[:60])
    with pytest.raises(pt.errors.LogError, match=r"cut\.wav: is damaged or cut off"):
        reader.load(cut, cut.name)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_files_that_a_page_names_exist(page) -> None:
    shown = set(re.findall(r'title="([^"]+)"', page.read_text(encoding="utf-8")))
    named = re.findall(
        r"`((?:pinotwin|tests|docs|examples|benchmarks)/[\w./*]*)", page.read_text(encoding="utf-8")
    )
    assert [name for name in named if name not in shown and not list(ROOT.glob(name.rstrip("/.")))] == []


def test_the_api_page_holds_every_public_name() -> None:
    listed = re.findall(
        r"^::: ([\w.]+)$", (ROOT / "docs/api.md").read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    names = {entry.rpartition(".")[2] for entry in listed}
    own = {name for name in dir(pt) if name[0] != "_" and name != "EFFECTS" and not name.endswith("Error")}
    assert own <= names
    assert "pinotwin.errors" in listed
    for entry in listed:
        module, _, name = entry.rpartition(".")
        assert entry == "pinotwin.errors" or hasattr(importlib.import_module(module), name), entry
