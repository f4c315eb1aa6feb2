"""What a command imports, counted; ``python -m benchmarks startup`` has the times."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.rig import good_log, write_log, write_machine

NEVER = (
    "trimesh",
    "yourdfpy",
    "networkx",
    "numba",
    "plotly",
    "meshcat",
    "control",
    "h5py",
    "mcap",
    "rosbags",
)
"""Libraries that no start needs."""


def imported(tmp_path: Path, *words: str) -> set[str]:
    """Return the modules that a command has imported when it ends."""
    code = (
        "import atexit, sys\n"
        "atexit.register(lambda: print('modules', *sys.modules))\n"
        "from pinotwin.cli.main import main\n"
        f"sys.exit(main({list(words)!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    last = done.stdout.splitlines()[-1].split()
    assert last[0] == "modules", done.stderr
    return set(last[1:])


def test_the_package_imports_nothing_but_itself() -> None:
    code = "import sys; old = set(sys.modules); import pinotwin; print(*(set(sys.modules) - old))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {name.partition(".")[0] for name in done.stdout.split()} - set(sys.stdlib_module_names) == {
        "pinotwin"
    }


def test_check_of_a_csv_needs_neither_meshes_nor_a_compiler(tmp_path: Path) -> None:
    write_log(tmp_path / "log.csv", good_log())
    write_machine(tmp_path / "rig")
    assert imported(tmp_path, "check", "rig", "log.csv") & set(NEVER) == set()


def test_a_missing_file_is_said_before_anything_slow_is_loaded(tmp_path: Path) -> None:
    found = imported(tmp_path, "check", "trunnion", "none.csv")
    assert found & {*NEVER, "scipy.signal", "scipy.linalg", "scipy.interpolate", "pyarrow"} == set()
