"""Compiled functions are kept for the user, found by another clone, and never found again after an edit."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from pinotwin.system.kernels import compiled

INNER = """
from pinotwin.system.kernels import compiled

FACTOR = 2.0

@compiled
def inner(x):
    return FACTOR * x
"""
OUTER = """
import sys
from pinotwin.system.kernels import compiled
from inner import inner

@compiled
def outer(x):
    return inner(x) + 1.0

print(outer(float(sys.argv[1])))
"""


def clone(folder: Path, inner: str = INNER) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "inner.py").write_text(inner)
    (folder / "outer.py").write_text(OUTER)
    return folder


def started(folder: Path, kept: Path, value: float = 3.0) -> subprocess.Popen[str]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(kept), "PYTHONDONTWRITEBYTECODE": "1"}
    words = [sys.executable, "outer.py", str(value)]
    return subprocess.Popen(words, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True)


def answer(folder: Path, kept: Path) -> float:
    out, _ = started(folder, kept).communicate(timeout=120)
    return float(out)


def files(kept: Path) -> set[Path]:
    return set(kept.rglob("*.*"))


@pytest.fixture(scope="module")
def compiled_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of what one clone has compiled."""
    folder = tmp_path_factory.mktemp("once")
    assert answer(clone(folder / "one"), folder / "kept") == 7.0
    return folder / "kept"


@pytest.fixture
def kept(compiled_once: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(compiled_once, tmp_path / "kept"))


def test_another_clone_finds_what_one_has_compiled(kept: Path, tmp_path: Path) -> None:
    before = files(kept)
    assert len(before) == 4
    assert answer(clone(tmp_path / "two"), kept) == 7.0
    assert files(kept) == before


def test_an_edit_of_a_callee_in_another_file_is_seen(kept: Path, tmp_path: Path) -> None:
    folder = tmp_path / "one"
    assert answer(clone(folder, INNER.replace("FACTOR * x", "FACTOR * x * x")), kept) == 19.0
    assert answer(clone(folder, INNER.replace("2.0", "5.0")), kept) == 16.0


def test_an_edit_of_a_default_or_an_option_of_a_callee_is_seen(tmp_path: Path) -> None:
    kept, folder = tmp_path / "kept", tmp_path / "one"
    stated = INNER.replace("inner(x)", "inner(x, by=2.0)").replace("FACTOR * x", "by * x")
    assert answer(clone(folder, stated), kept) == 7.0
    assert answer(clone(folder, stated.replace("by=2.0", "by=5.0")), kept) == 16.0
    divided = INNER.replace("FACTOR * x", "FACTOR / x")
    assert answer(clone(folder, divided), kept) == pytest.approx(5.0 / 3.0)
    unchecked = divided.replace("@compiled", '@compiled(error_model="numpy")')
    assert float(started(clone(folder, unchecked), kept, 0.0).communicate(timeout=120)[0]) == math.inf


def test_the_order_in_a_named_tuple_within_another_is_seen(tmp_path: Path) -> None:
    code = """
        from typing import NamedTuple
        from pinotwin.system.kernels import compiled
        Inner = NamedTuple("Inner", [("a", float), ("b", float)])
        Outer = NamedTuple("Outer", [("inner", Inner), ("c", float)])

        @compiled
        def first(x):
            return x.inner.a

        print(first(Outer(Inner(a=1.0, b=2.0), 3.0)))
    """
    text = textwrap.dedent(code)
    for order in (text, text.replace('("a", float), ("b", float)', '("b", float), ("a", float)')):
        (tmp_path / "outer.py").write_text(order)
        assert answer(tmp_path, tmp_path / "kept") == 1.0


def test_a_comment_compiles_nothing_again(kept: Path, tmp_path: Path) -> None:
    before = files(kept)
    assert answer(clone(tmp_path / "one", "# a comment\n" + INNER), kept) == 7.0
    assert files(kept) == before


def test_two_processes_at_once_are_right(tmp_path: Path) -> None:
    kept, folder = tmp_path / "kept", clone(tmp_path / "one")
    both = [started(folder, kept, value) for value in (3.0, 4.0, 5.0)]
    assert [float(one.communicate(timeout=120)[0]) for one in both] == [7.0, 9.0, 11.0]
    assert len(files(kept)) == 4
    assert answer(folder, kept) == 7.0


def test_a_folder_that_cannot_be_written_costs_time_alone(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    assert answer(clone(tmp_path / "one"), blocked) == 7.0


def test_a_damaged_file_is_compiled_again(kept: Path, tmp_path: Path) -> None:
    for file in files(kept):
        file.write_bytes(file.read_bytes()[:100])
    assert answer(clone(tmp_path / "one"), kept) == 7.0


def test_the_newest_forms_of_a_function_are_kept(tmp_path: Path) -> None:
    code = """
        from pathlib import Path
        from pinotwin.system.kernel_files import _Files
        folder = Path("forms")
        folder.mkdir()
        for k in range(60):
            (folder / f"a.f-{k}").write_text("")
        (folder / "a.ff-1").write_text("")
        _Files(folder, "a.f", "")._forget_old()
        print(len(list(folder.iterdir())))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert int(done.stdout) == 51


def test_a_function_in_a_closure_counts() -> None:
    def of(inner):  # type: ignore[no-untyped-def]
        @compiled
        def outer(x):  # type: ignore[no-untyped-def]
            return inner(x) + 1.0

        return outer

    twice, half = compiled(lambda x: 2.0 * x), compiled(lambda x: 0.5 * x)
    assert of(twice)(3.0) == 7.0
    assert of(half)(3.0) == 2.5
    assert twice(3.0) == 6.0
