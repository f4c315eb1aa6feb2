"""The wheel: what `pip install .` gives a user is whole, bundled machines included."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

from pinotwin import __version__
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
    for name in ("pyproject.toml", "README.md", "LICENSE"):
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
