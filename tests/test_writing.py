"""Results are written whole or not at all: under kills, full disks, read-only folders, two writers at once."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pinotwin.errors import InputError, OutputError
from pinotwin.system import writing
from pinotwin.system.writing import check_file, check_folder, whole_file, whole_folder, write_text

FILES = ("a.txt", "b.txt", "sub/c.txt")

OLD_SYSTEM = """
import ctypes
ctypes.CDLL = lambda *_, **__: object()
"""
WRITER = """
import sys
from pathlib import Path
from pinotwin.system.writing import whole_file, whole_folder
folder, file, first = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
print("ready", flush=True)
for k in range(first, first + 10_000):
    with whole_folder(folder) as part:
        (part / "sub").mkdir()
        for name in ("a.txt", "b.txt", "sub/c.txt"):
            (part / name).write_text(str(k) * 2000)
    with whole_file(file) as part, part.open("w") as stream:
        for _ in range(50):
            stream.write(str(k) * 40)
            stream.flush()
"""


def versions(folder: Path) -> set[str]:
    """Return which runs the files of a folder are of; more than one when old and new are mixed."""
    found = set()
    for name in FILES:
        text = (folder / name).read_text()
        number = text[: len(text) // 2000]
        assert text == number * 2000, f"{name} is cut off"
        found.add(number)
    return found


def litter(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir() if p.name.startswith(".") and ".part" in p.name)


def start(tmp_path: Path, first: int) -> subprocess.Popen[str]:
    words = [sys.executable, "-c", WRITER, str(tmp_path / "out"), str(tmp_path / "log.csv"), str(first)]
    job = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert job.stdout is not None
    assert job.stdout.readline() == "ready\n"
    return job


@pytest.mark.parametrize("swaps", [True, False], ids=["exchange", "two renames"])
def test_a_kill_leaves_an_earlier_result_whole(
    tmp_path: Path, swaps: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not swaps:  # as on a system without renameat2; for the child by the environment of this test alone
        monkeypatch.setattr(sys.modules[__name__], "WRITER", OLD_SYSTEM + WRITER)
    rng = random.Random(3)
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("my own notes")
    for trial in range(12):
        job = start(tmp_path, 1000 + trial)
        time.sleep(0.02 + 0.08 * rng.random())
        assert job.poll() is None
        job.send_signal(signal.SIGKILL)
        job.wait()
        if not out.exists():  # between two renames: the next command puts it back
            assert not swaps
            check = list(tmp_path.glob(".out.*.old.part"))
            assert len(check) == 1
            with pytest.raises(InputError), whole_folder(out):
                raise InputError("stopped")
        assert (out / "mine.txt").read_text() == "my own notes"
        if (out / "a.txt").exists():
            assert len(versions(out)) == 1
        if (tmp_path / "log.csv").exists():
            text = (tmp_path / "log.csv").read_text()
            assert text == text[:4] * 2000
    for target in (out, tmp_path / "log.csv"):
        writing.sweep(target)
    assert litter(tmp_path) == []


def test_what_a_living_process_makes_is_not_swept(tmp_path: Path) -> None:
    with whole_file(tmp_path / "r.json") as part:
        part.write_text("slow")
        write_text(tmp_path / "r.json", "quick")
        assert part.exists()
    assert (tmp_path / "r.json").read_text() == "slow"
    assert litter(tmp_path) == []


def test_what_a_dead_process_left_is_swept(tmp_path: Path) -> None:
    (tmp_path / ".r.json.abcd1234.part.json").write_text("half")
    (tmp_path / ".other.json.abcd1234.part.json").write_text("somebody else's")
    held = tmp_path / ".r.json.wxyz1234.part.json"
    held.write_text("alive")
    with held.open() as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        write_text(tmp_path / "r.json", "new")
    assert litter(tmp_path) == [".other.json.abcd1234.part.json", ".r.json.wxyz1234.part.json"]


def test_a_folder_that_was_only_set_aside_comes_back(tmp_path: Path) -> None:
    aside = tmp_path / ".out.abcd1234.old.part"
    aside.mkdir()
    (aside / "twin.json").write_text("good")
    with pytest.raises(InputError), whole_folder(tmp_path / "out"):
        raise InputError("the run after it fails")
    assert (tmp_path / "out" / "twin.json").read_text() == "good"


FULL = """
import resource, signal, sys
from pinotwin.errors import InputError, OutputError
from pinotwin.system.writing import whole_file, whole_folder
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000))
try:
    if sys.argv[1] == "file":
        with whole_file(sys.argv[2]) as part:
            part.write_text("x" * 10_000)
    else:
        with whole_folder(sys.argv[2]) as part:
            (part / "a.txt").write_text("new")
            if sys.argv[1] == "folder":
                (part / "b.txt").write_text("x" * 10_000)
            else:  # a file of the folder that is written whole or not at all itself
                with whole_file(part / "b.txt") as inner:
                    inner.write_text("x" * 10_000)
except InputError as error:
    print(error)
    sys.exit(2)
"""


@pytest.mark.parametrize("kind", ["file", "folder", "file in a folder"])
def test_a_disk_that_is_full_costs_nothing(tmp_path: Path, kind: str) -> None:
    target = tmp_path / "out"
    place = target if kind == "file" else target / "a.txt"
    write_text(place, "old")
    done = subprocess.run([sys.executable, "-c", FULL, kind, str(target)], capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert done.stdout.count("\n") == 1
    assert f"{target}: cannot be written: File too large; the earlier one is kept" in done.stdout
    assert place.read_text() == "old"
    assert litter(tmp_path) == []


def test_what_belongs_to_the_result_goes_with_it(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with whole_folder(out) as part:
        (part / "machine").mkdir()
        (part / "machine" / "machine.yaml").write_text("old")
        (part / "advice_A.csv").write_text("old")
    (out / "notes").mkdir()
    (out / "notes" / "a.md").write_text("mine")
    with whole_folder(out, replaces=("machine", "advice_*.csv")) as part:
        (part / "diagnosis.json").write_text("new")
    assert {str(p.relative_to(out)) for p in out.rglob("*")} == {"diagnosis.json", "notes", "notes/a.md"}


def test_the_folder_one_stands_in_is_filled_not_swapped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    inode = tmp_path.stat().st_ino
    (tmp_path / "log.csv").write_text("mine")
    for text in ("one", "two"):
        with whole_folder(".") as part:
            (part / "sub").mkdir()
            (part / "sub" / "c.txt").write_text(text)
    assert tmp_path.stat().st_ino == inode
    assert (tmp_path / "sub" / "c.txt").read_text() == "two"
    assert (tmp_path / "log.csv").read_text() == "mine"
    assert litter(tmp_path.parent) == []


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    (tmp_path / "out").symlink_to("far")
    (tmp_path / "r.json").symlink_to("far/r.json")
    with whole_folder(tmp_path / "out") as part:
        (part / "a.txt").write_text("a")
    write_text(tmp_path / "r.json", "b")
    assert (tmp_path / "out").is_symlink()
    assert (tmp_path / "r.json").is_symlink()
    assert (tmp_path / "far" / "a.txt").read_text() == "a"
    assert (tmp_path / "far" / "r.json").read_text() == "b"


def test_missing_folders_are_made_and_devices_written_to(tmp_path: Path) -> None:
    check_file(tmp_path / "a" / "b" / "r.json")
    assert list(tmp_path.iterdir()) == []  # looking makes nothing
    write_text(tmp_path / "a" / "b" / "r.json", json.dumps({}))
    assert (tmp_path / "a" / "b" / "r.json").read_text() == "{}"
    write_text("/dev/null", "gone")
    with pytest.raises(InputError, match="No space left"):
        write_text("/dev/full", "x" * 100_000)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_noticed_first(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    for check in (check_file, check_folder):
        with pytest.raises(InputError, match="cannot be written to: Permission denied"):
            check(tmp_path / "x")
    with pytest.raises(InputError, match="cannot be written to: Permission denied"):
        check_folder(tmp_path)
    tmp_path.chmod(0o755)


def test_trouble_with_another_file_keeps_its_name(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), whole_folder(tmp_path / "out"):
        Path("/nowhere/mesh.stl").read_bytes()
    assert list(tmp_path.iterdir()) == []


def test_permissions_are_those_of_any_other_file(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    with whole_file(tmp_path / "r.json") as part:
        part.write_text("")
    assert (tmp_path / "r.json").stat().st_mode == (tmp_path / "plain").stat().st_mode
    (tmp_path / "r.json").chmod(0o600)
    write_text(tmp_path / "r.json", "still private")
    assert (tmp_path / "r.json").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(("earlier", "kept"), [(True, "the earlier one is kept"), (False, "nothing is kept")])
def test_a_folder_says_what_became_of_it_when_a_file_of_it_fails(tmp_path, monkeypatch, earlier, kept):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    def fill(folder):
        with whole_folder(folder) as part:
            monkeypatch.setattr(Path, "write_text", full)
            write_text(part / "report.html", "text")

    folder = tmp_path / "twin"
    if earlier:
        folder.mkdir()
    with pytest.raises(OutputError) as raised:
        fill(folder)
    assert str(raised.value) == f"{folder}: cannot be written: No space left on device; {kept}"
    assert folder.exists() == earlier
