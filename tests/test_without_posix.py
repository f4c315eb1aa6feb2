"""Shop-floor PCs run Windows: without ``fcntl``, ``resource`` and a fork the package imports, reads and writes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

BLOCK = """
import os, sys
for name in ("fcntl", "resource", "termios", "pwd", "grp"):
    sys.modules[name] = None
for name in ("fork", "forkpty", "O_NOFOLLOW", "sched_getaffinity", "geteuid", "getuid"):
    if hasattr(os, name):
        delattr(os, name)
import ctypes
really = ctypes.CDLL
def no_c_library(name, *more, **named):
    if name is None:
        raise TypeError("LoadLibrary() argument 1 must be str, not None")
    return really(name, *more, **named)
ctypes.CDLL = no_c_library
"""
IMPORTS = """
import importlib, pkgutil
import pinotwin
for module in pkgutil.walk_packages(pinotwin.__path__, "pinotwin."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
"""
CHAIN = """
from pinotwin.cli.main import main
from scipy.io import savemat
import pinotwin as pt

def run(*words):
    code = main([str(word) for word in words])
    assert code == 0, (words, code)

if __name__ == "__main__":
    run("record", "emps", "--seconds", 8, "--seed", 1, "--out", "log.csv")
    run("record", "emps", "--command", "log.csv", "--seed", 2, "--inject", "viscous:X=0.5", "--out", "worn.csv")
    log = pt.read("log.csv")
    savemat("log.mat", {"t": log.t, **{name.replace(".", "_"): x for name, x in log.channels.items()}})
    assert len(pt.read("log.mat").t) == len(log.t)
    run("identify", "emps", "log.csv", "--no-loop", "--out", "twin")
    for _ in range(2):  # the second time over the first one's result
        run("force", "twin", "log.csv", "--out", "force.csv")
    run("diagnose", "twin", "--each", "log.csv", "worn.csv", "--quick", "--workers", 2, "--out", "found")
"""


def run(code: str, folder: Path) -> None:
    (folder / "shop.py").write_text(BLOCK + code)
    done = subprocess.run([sys.executable, "shop.py"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_module_is_imported(tmp_path: Path) -> None:
    run(IMPORTS, tmp_path)


def test_a_machine_is_recorded_identified_and_diagnosed(tmp_path: Path) -> None:
    run(CHAIN, tmp_path)
    rows = json.loads((tmp_path / "found" / "each.json").read_text())["logs"]
    assert rows[0]["verdict"] == "none"
    assert [cause["effect"] for cause in rows[1]["causes"]] == ["viscous"]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(
        ["shop.py", "log.csv", "worn.csv", "log.mat", "twin", "force.csv", "found"]
    )
