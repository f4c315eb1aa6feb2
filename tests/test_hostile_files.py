"""Damaged and hostile files: an answer or one line, never a crash, a hang, a flood of memory or a look elsewhere."""

from __future__ import annotations

import contextlib
import json
import os
import struct
import time
import zipfile
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import lz4.frame
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zstandard
from lxml import etree
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import Writer
from rosbags.rosbag2 import CompressionMode
from scipy.io import savemat

import pinotwin as pt
from pinotwin.errors import InputError, LogError, MachineError
from pinotwin.logs.files import content, isolated
from pinotwin.logs.files.content import Content
from pinotwin.machine.urdf_check import read_tree
from tests.arrow_memory import arrow_peak
from tests.fuzz import CHECKED, READERS, fuzz
from tests.rig import URDF, good_log, write_machine
from tests.ros_bags import with_checksums, write_bag

COUNT = int(os.environ.get("PINOTWIN_FUZZ_FILES", "40"))


@pytest.mark.parametrize("reader", READERS)
def test_spoiled_files(reader: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    count = COUNT // 3 if reader in ("mat", "mat73", "hdf5") else COUNT  # each starts an interpreter
    tally = fuzz(reader, count, tmp_path)
    read = tally["accepted"] + (0 if reader in CHECKED else tally["altered"])
    assert tally["refused"] + read == count, capfd.readouterr().err
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


def _npz(path: Path, kind: object, rows: int) -> None:
    with zipfile.ZipFile(path, "w") as packed, packed.open("x.npy", "w") as out:
        np.lib.format.write_array_header_2_0(out, {"descr": kind, "fortran_order": False, "shape": (rows,)})


def _mat(path: Path, rows: int) -> None:
    sizes = struct.pack("<IIiiIIII", 5, 8, rows, 1, 1, 1, ord("x"), 0)[:24] + b"x".ljust(8, b"\0")
    flags = struct.pack("<IIII", 6, 8, 6, 0)
    packed = zlib.compress(struct.pack("<II", 14, 72 + rows) + flags + sizes + struct.pack("<II", 1, rows))
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<HH", 0x100, 0x4D49)
    path.write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)


def _chunk(path: Path, compression: str, data: bytes, claimed: int, crc: int = 0) -> Path:
    """Write an MCAP file of one chunk, as a writer that is not to be believed would."""
    out = BytesIO()
    writer = Writer(out, use_chunking=False, use_statistics=False)
    writer.start()
    writer.register_channel("servo", "json", writer.register_schema("s", "jsonschema", b"{}"))
    writer.finish()
    chunk = RecordBuilder()
    Chunk(compression, data, 0, 0, crc, claimed).write(chunk)
    whole = out.getvalue()
    at = whole.index(struct.pack("<BQ", 0x0F, 4))
    foot = struct.pack("<BQIBQQQI", 0x0F, 4, 0, 2, 20, 0, 0, 0) + whole[-8:]
    path.write_bytes(whole[:at] + chunk.end() + foot)
    return path


def test_sizes_are_asked_for_first(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("t", shape=(10**13,), chunks=(10**6,), dtype=float)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file.create_dataset("t", shape=(10**6,), chunks=(10**3,), dtype=np.dtype((float, (100,))))
    with (tmp_path / "a.npy").open("wb") as out:
        np.lib.format.write_array_header_1_0(
            out, {"descr": "<f8", "fortran_order": False, "shape": (10**9, 10**3)}
        )
    _npz(tmp_path / "b.npz", "|i1", 70_000_000)
    _npz(tmp_path / "c.npz", [(f"f{k}", "|i1") for k in range(100)], 700_000)
    _npz(tmp_path / "d.npz", "<U1000", 200_000)
    _mat(tmp_path / "a.mat", 70_000_000)
    pq.write_table(pa.table({"x": pa.array(np.zeros(80_000_000, dtype=np.int8))}), tmp_path / "a.parquet")
    wide = pa.array([b"a" * 400_000] * 1500, pa.binary(400_000))
    pq.write_table(pa.table({"x": wide}), tmp_path / "b.parquet", compression="zstd")
    _chunk(tmp_path / "a.mcap", "zstd", b"", 2**30)
    (tmp_path / "a.jsonl").write_text(json.dumps({f"k{i}": 1 for i in range(20_000)}) + "\n{}" * 5000)
    for path in sorted(tmp_path.iterdir()):
        with pytest.raises(LogError, match=r"claims .* numbers, more than"):
            pt.read(path)


@pytest.mark.parametrize("kind", [pa.string(), pa.large_string(), pa.binary()], ids=str)
def test_a_long_text_that_fills_all_rows_is_kept_once(tmp_path: Path, kind: pa.DataType) -> None:
    text = pa.array([b"a" * 100_000] * 1000).cast(kind)
    pq.write_table(pa.table({"t": np.arange(1000.0), "x": text}), tmp_path / "a.parquet", store_schema=False)
    meta = pq.read_metadata(tmp_path / "a.parquet")
    assert meta.row_group(0).column(1).total_uncompressed_size < 200_000
    assert list(pt.read(tmp_path / "a.parquet").channels) == ["t"]
    assert 0 < arrow_peak(tmp_path / "a.parquet") < 20_000_000


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_does_not_unpack_to_more_than_it_says(tmp_path: Path, compression: str) -> None:
    compress = {"zstd": zstandard.compress, "lz4": lz4.frame.compress}[compression]
    path = _chunk(tmp_path / "a.mcap", compression, compress(bytes(10**7)), 1000)
    with pytest.raises(LogError, match="a chunk of 1001 bytes instead of 1000"):
        pt.read(path)


def _bag(folder: Path) -> Path:
    log = {k: x[:300] for k, x in good_log().items()}
    return write_bag(folder / "bag", log, command=True)


def _spoil_chunk(data: bytearray) -> None:
    data[data.index(b"zstd") + 200] ^= 1


def _spoil_summary(data: bytearray) -> None:
    data[data.rindex(b"/joint_states") + 1] ^= 1


def _lose_messages(data: bytearray) -> None:
    """Count 300 messages less in the statistics, whose checksum is not set."""
    at = data.rindex(struct.pack("<BQ", 0x0B, 66)) + 9
    data[at : at + 8] = (int.from_bytes(data[at : at + 8], "little") - 300).to_bytes(8, "little")
    data[-12:-8] = bytes(4)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_spoil_chunk, "damaged or cut off"),
        (_spoil_summary, "checksum of the summary"),
        (_lose_messages, "600 messages of 300"),
    ],
)
@pytest.mark.parametrize("folder", [True, False])
def test_a_bag_in_mcap_is_as_its_checksums_say(
    tmp_path: Path, spoil: Callable[[bytearray], None], said: str, folder: bool
) -> None:
    bag = _bag(tmp_path)
    path = with_checksums(bag / "bag.mcap", "zstd")
    assert len(pt.read(bag if folder else path)) == 300
    data = bytearray(path.read_bytes())
    spoil(data)
    path.write_bytes(data)
    with pytest.raises(LogError, match=said):
        pt.read(bag if folder else path)


def test_every_checksum_of_an_mcap_file_is_compared(tmp_path: Path) -> None:
    path = with_checksums(_bag(tmp_path) / "bag.mcap", "none", data=True)
    sound = path.read_bytes()
    for at in np.linspace(8, len(sound) - 50, 40).astype(int):
        data = bytearray(sound)
        data[at] ^= 4
        path.write_bytes(data)
        with pytest.raises(LogError, match="damaged or cut off"):
            pt.read(path)


def test_what_the_metadata_of_a_bag_say_is_no_more_than_that(tmp_path: Path) -> None:
    bag = _bag(tmp_path)
    metadata = bag / "metadata.yaml"
    text = metadata.read_text()
    metadata.write_text(text.replace("name: /joint_states", "name: /joint_stateX"))
    notes = pt.read(bag).notes
    assert any("/joint_stateX: 0 messages where the bag states 300" in note for note in notes)
    (tmp_path / "other.mcap").write_bytes((bag / "bag.mcap").read_bytes())
    metadata.write_text(text.replace("bag.mcap", "../other.mcap"))
    with pytest.raises(LogError, match="damaged or cut off"):
        pt.read(bag)
    metadata.write_text(text)
    (bag / "bag.mcap").unlink()
    os.mkfifo(bag / "bag.mcap")
    with pytest.raises(LogError, match=r"bag\.mcap is no file"):
        pt.read(bag)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("bag", {"storage": "sqlite3", "compression": CompressionMode.FILE}),
        ("bag", {"storage": "sqlite3", "compression": CompressionMode.MESSAGE}),
        ("log.bag", {"storage": "ros1", "chunks": "BZ2"}),
        ("log.bag", {"storage": "ros1", "chunks": "LZ4"}),
    ],
)
def test_a_compressed_bag_is_unpacked_within_limits(
    tmp_path: Path, name: str, kind: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    log = {k: x[:300] for k, x in good_log().items()}
    bag = write_bag(tmp_path / name, log, **kind)
    assert len(pt.read(bag)) == 300
    monkeypatch.setattr(content, "MOST", 1000)
    with pytest.raises(LogError, match=r"claims .* numbers, more than"):
        pt.read(bag)


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
