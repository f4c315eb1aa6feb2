"""The wheel: what `pip install .` gives a user is whole, bundled machines included."""

from __future__ import annotations

import json
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
import yaml

from pinotwin import __version__
from pinotwin.cli.main import COMMANDS
from pinotwin.machine import machines
from tests.conftest import ROOT

NO_NETWORK = (
    "No matching distribution",
    "Connection",
    "connection",
    "Temporary failure",
    "timed out",
)


def pip(*words: object) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "-m",
        "pip",
        "--quiet",
        "--disable-pip-version-check",
        *map(str, words),
    ]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build in a copy, so that no `build` folder appears in the project."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ("pinotwin", "urdf"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("tests", "examples", "docs", "out"):  # neighbours that must not get in
        (source / name).mkdir()
        (source / name / "__init__.py").touch()
    here = int(metadata.version("setuptools").split(".")[0]) >= 77
    words = ["--no-build-isolation"] if here else []
    done = pip("wheel", source, "--no-deps", *words, "-w", folder)
    if done.returncode and not here and any(word in done.stderr for word in NO_NETWORK):
        pytest.skip("the build needs setuptools>=77, which is neither here nor to be had offline")
    assert done.returncode == 0, done.stderr
    (found,) = folder.glob("*.whl")
    return found


def test_every_module_and_machine_is_in_the_wheel(wheel: Path) -> None:
    inside = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    source = wheel.parent / "source"
    expected = {
        str(p.relative_to(source)).replace("urdf/", "pinotwin/urdf/", 1)
        if folder == "urdf"
        else str(p.relative_to(source))
        for folder in ("pinotwin", "urdf")
        for p in (source / folder).rglob("*")
        if p.is_file()
    }
    assert inside == expected


def test_the_index_page_has_no_picture_and_no_link_that_leads_nowhere(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    (name,) = (n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
    page = archive.read(name).decode()
    assert "Description-Content-Type: text/markdown" in page
    assert re.findall(r"\]\((?!https?:|#)[^)]+\)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert re.findall(r"\]\((?!https?:|#)[^)]+\)", page) == []
    assert re.search("^Project-URL:", page, re.MULTILINE)
    assert re.search("^Classifier: ", page, re.MULTILINE)


@pytest.mark.parametrize(
    ("repository", "expected"),
    [
        (None, "See  docs and [a](https://b.c), [d](#e)."),
        (
            "//h",
            "See ![pic](//h/raw/HEAD/i.png) [docs](//h/blob/HEAD/d.md) and [a](https://b.c), [d](#e).",
        ),
    ],
)
def test_pictures_and_links_lead_to_the_repository_or_go(repository: str | None, expected: str) -> None:
    setup = runpy.run_path(str(ROOT / "setup.py"))
    text = "See ![pic](i.png) [docs](d.md) and [a](https://b.c), [d](#e)."
    assert setup["index_page"](text, repository) == expected


def test_the_container_is_for_the_python_and_the_files_that_are_here() -> None:
    lines = (ROOT / "Dockerfile").read_text(encoding="utf-8").splitlines()
    steps = [line.split(maxsplit=1) for line in lines if line and not line.startswith("#")]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (base,) = (rest for word, rest in steps if word == "FROM")
    assert base == f"python:{project['requires-python'].removeprefix('>=')}-slim"
    (entry,) = (rest for word, rest in steps if word == "ENTRYPOINT")
    assert json.loads(entry)[0] in project["scripts"]
    words = [word for word, _ in steps]
    assert words.index("USER") > max(k for k, word in enumerate(words) if word == "RUN")
    (install,) = (rest for word, rest in steps if word == "RUN" and "pip install" in rest)
    assert (ROOT / install.split("-c /src/")[1].split()[0]).is_file()
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert ".venv" in ignored


def test_a_plain_install_runs_what_the_readme_shows() -> None:
    script = runpy.run_path(str(ROOT / ".ci" / "plain_install"))
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    steps = script["of_readme"]()
    assert [text for kind, text in steps if kind == "python"] == re.findall(
        r"```python\n(.*?)```", readme, re.DOTALL
    )
    shown = [text for kind, text in steps if kind == "command"]
    assert "pinotwin demo" in shown  # `make demo`
    assert all(shlex.split(text)[1] in COMMANDS for text in shown)
    made = " ".join(script["RECORDS"])
    assert all(source.startswith("out/demo/") or source in made for source in script["COPIES"].values())
    assert "make plain" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def test_the_citation_and_the_package_agree() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert cited["version"] == __version__
    assert cited["license"] == project["license"]
    assert cited["abstract"] == project["description"]


def test_the_installed_package_lists_and_loads_its_machines(wheel: Path, tmp_path: Path) -> None:
    target, work = tmp_path / "target", tmp_path / "work"
    work.mkdir()
    done = pip("install", "--no-deps", "--no-compile", "--target", target, wheel)
    assert done.returncode == 0, done.stderr
    environment = {**os.environ, "PYTHONPATH": str(target)}
    code = (
        "import json, pinotwin as pt\n"
        "print(json.dumps({'file': pt.__file__, 'names': list(pt.machines()),"
        " 'axes': list(pt.Machine.load('trunnion').axes)}))"
    )
    say = [sys.executable, "-c", code]
    out = subprocess.run(say, capture_output=True, text=True, cwd=work, env=environment, check=True)
    said = json.loads(out.stdout)
    assert Path(said["file"]).is_relative_to(target)
    assert said["names"] == list(machines())
    assert said["axes"] == ["Y", "A", "C"]
    command = [sys.executable, target / "bin" / "pinotwin", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=work, env=environment)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"pinotwin {__version__}\n"
