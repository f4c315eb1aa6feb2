"""Damaged and hostile files: an answer or one line, never a crash, a hang, a flood of memory or a look elsewhere."""

from __future__ import annotations

import contextlib
import os
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from lxml import etree
from scipy.io import savemat

import pinotwin as pt
from pinotwin.errors import InputError, LogError, MachineError
from pinotwin.logs.files import isolated
from pinotwin.logs.files.content import Content
from pinotwin.machine.urdf_check import read_tree
from tests.fuzz import READERS, fuzz
from tests.rig import URDF, write_machine

COUNT = int(os.environ.get("PINOTWIN_FUZZ_FILES", "40"))


@pytest.mark.parametrize("reader", READERS)
def test_spoiled_files(reader: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    count = COUNT // 3 if reader in ("mat", "mat73", "hdf5") else COUNT  # each starts an interpreter
    tally = fuzz(reader, count, tmp_path)
    assert tally["refused"] + tally["accepted"] == count, capfd.readouterr().err
    assert tally["refused"] > count // 4


def _ends(path: Path, source: str) -> Content:
    os.kill(os.getpid(), 11)
    return Content()


def _hangs(path: Path, source: str) -> Content:
    time.sleep(60.0)
    return Content()


def _floods(path: Path, source: str) -> Content:
    return Content({"x": np.ones(2**33)})


@pytest.mark.parametrize(
    ("loader", "said"),
    [(_ends, "it ended its reader"), (_hangs, "not done after"), (_floods, "more than its size allows for")],
)
def test_what_a_reader_suffers_is_one_line(tmp_path: Path, loader: isolated.Loader, said: str) -> None:
    seconds = 1.0 if loader is _hangs else 300.0
    (tmp_path / "log.mat").write_bytes(b"x")
    with pytest.raises(LogError, match=said):
        isolated.load(loader, tmp_path / "log.mat", "log.mat", seconds=seconds)


def test_a_file_of_the_users_folder_is_no_module_of_the_reader(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    savemat(tmp_path / "log.mat", {"t": np.arange(30.0), "q": np.arange(30.0) ** 2})
    (tmp_path / "json.py").write_text("raise SystemExit(3)")
    monkeypatch.chdir(tmp_path)
    assert pt.read("log.mat")["q"].tolist() == [float(k**2) for k in range(30)]


def test_sizes_are_asked_for_first(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("t", shape=(10**13,), chunks=(10**6,), dtype=float)
    with (tmp_path / "a.npy").open("wb") as out:
        np.lib.format.write_array_header_1_0(
            out, {"descr": "<f8", "fortran_order": False, "shape": (10**9, 10**3)}
        )
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as packed, packed.open("x.npy", "w") as out:
        np.lib.format.write_array_header_1_0(
            out, {"descr": "|i1", "fortran_order": False, "shape": (450_000_000,)}
        )
    for name in ("a.h5", "a.npy", "b.npz"):
        with pytest.raises(LogError, match=r"claims .* numbers, more than"):
            pt.read(tmp_path / name)


def test_hdf5_stays_in_its_file_and_visits_a_group_once(tmp_path: Path) -> None:
    (tmp_path / "secret.bin").write_bytes(np.arange(5.0).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["x"] = np.arange(5.0)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"], file["q"] = np.arange(5.0), np.arange(5.0)
        file["far"] = h5py.ExternalLink("other.h5", "x")
        file.create_dataset("raw", shape=(5,), dtype=float, external=[(str(tmp_path / "secret.bin"), 0, 40)])
        group = file
        for k in range(40):  # 2^40 ways to the last
            below = file.create_group(f"store/{k}")
            group["left"] = group["right"] = below
            group = below
        group["up"] = file["/store"]
    log = pt.read(tmp_path / "a.h5")
    assert set(log.channels) == {"t", "q"}
    assert any("far: a link to another file, not followed" in note for note in log.notes)


BOMB = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 8)}]\n" for k in range(1, 40)
)
YAMLS: list[tuple[str, str, str]] = [
    ("aliases", BOMB, "more than 50000 entries, aliases written out"),
    ("a ring", "name: &a [*a]\n", "an alias that holds itself"),
    ("a date that is none", "name: 2020-13-45\n", "month must be in"),
    ("5000 digits", f"name: {'9' * 5000}\n", "correct this value"),
    ("lists in lists", "name: " + "[" * 4000 + "]" * 4000 + "\n", "lists in lists without end"),
    ("a tag", "name: !!python/object/apply:os.system [id]\n", "could not determine a constructor"),
    ("400 digits", f"axes: {{X: {{joint: jx, zero: {'9' * 400}}}}}\n", "expected a"),
]


@pytest.mark.parametrize(("text", "said"), [y[1:] for y in YAMLS], ids=[y[0] for y in YAMLS])
def test_hostile_yaml(tmp_path: Path, text: str, said: str) -> None:
    folder = write_machine(tmp_path / "rig")
    first = "" if "name:" in text else "name: rig\nurdf: rig.urdf\n"
    (folder / "machine.yaml").write_text(first + text)
    with pytest.raises(MachineError, match=said) as caught:
        pt.Machine.load(folder)
    assert len(str(caught.value)) < 500
    assert "\n" not in str(caught.value)


def _latin1(text: str) -> bytes:
    return text.replace("<robot", "<!-- Gerät -->\n<robot", 1).encode("latin-1")


URDFS: list[tuple[str, Callable[[str], bytes], str]] = [
    ("Latin-1 without declaration", _latin1, "save it as UTF-8"),
    ("many links", lambda t: t.replace("<link", "<link/>" * 3000 + "<link", 1).encode(), "links and joints"),
    ("NUL", lambda t: t.encode() + b"\x00", "not valid XML"),
]


@pytest.mark.parametrize(("spoil", "said"), [u[1:] for u in URDFS], ids=[u[0] for u in URDFS])
def test_hostile_urdf(tmp_path: Path, spoil: Callable[[str], bytes], said: str) -> None:
    (tmp_path / "rig.urdf").write_bytes(spoil(URDF))
    with pytest.raises(MachineError, match=said) as caught:
        pt.Machine.load(tmp_path / "rig.urdf")
    assert "\n" not in str(caught.value)


def test_latin1_with_its_declaration_is_read(tmp_path: Path) -> None:
    text = b'<?xml version="1.0" encoding="ISO-8859-1"?>\n' + _latin1(URDF)
    (tmp_path / "rig.urdf").write_bytes(text)
    assert len(pt.Machine.load(tmp_path / "rig.urdf").axes) == 2


def test_an_entity_is_not_looked_up(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("42")
    head = f'<!DOCTYPE robot [<!ENTITY s SYSTEM "{tmp_path}/secret">]>\n'
    (tmp_path / "rig.urdf").write_text(head + URDF.replace('<mass value="5"/>', '<mass value="5"/>&s;', 1))
    with contextlib.suppress(InputError):
        pt.Machine.load(tmp_path / "rig.urdf")
    assert b"42" not in etree.tostring(read_tree(tmp_path / "rig.urdf"))


def test_devices_and_pipes_are_no_logs(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "log.csv")
    for path in (tmp_path / "log.csv", Path("/dev/zero")):
        with pytest.raises(LogError, match="is a device or a pipe"):
            pt.read(path)
    (tmp_path / "long.csv").write_bytes(b"1," * 2_000_000)
    with pytest.raises(LogError, match="first line is longer"):
        pt.read(tmp_path / "long.csv")
