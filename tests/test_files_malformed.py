"""Malformed logs: each gives one line that names the file, the place, and the remedy."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from mcap.writer import Writer

from pinotwin.errors import LogError
from pinotwin.logs.files import read, read_argument

_ENDINGS = (
    ".asc, .bag, .csv, .dat, .db3, .h5, .hdf, .hdf5, .json, .jsonl, .log, .mat, .mcap, .ndjson, .npy, .npz, "
    ".parquet, .pq, .sco, .tsv, .txt"
)
_NO_NUMBERS = "holds no numbers; export the recorded signals as numeric columns"
_NO_SERIES = "holds a single row or only single numbers; export time series"


def _npy(x: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, x, allow_pickle=True)
    return buffer.getvalue()


def _locked_npz() -> bytes:
    """A damaged flag says that a member is encrypted."""
    buffer = io.BytesIO()
    np.savez(buffer, t=np.arange(3.0))
    content = bytearray(buffer.getvalue())
    for mark, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        content[content.index(mark) + at] |= 1
    return bytes(content)


def _mat(**variables: object) -> bytes:
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, variables)
    return buffer.getvalue()


def _parquet(table: pa.Table) -> bytes:
    buffer = io.BytesIO()
    pq.write_table(table, buffer)
    return buffer.getvalue()


def _hdf5(**sets: object) -> bytes:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        for name, value in sets.items():
            file[name] = value
    return buffer.getvalue()


def _mcap(encoding: str, data: bytes, messages: int = 2) -> bytes:
    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start()
    channel = writer.register_channel(topic="/servo", message_encoding=encoding, schema_id=0)
    for i in range(messages):
        writer.add_message(channel, log_time=i, data=data, publish_time=i)
    writer.finish()
    return buffer.getvalue()


CASES: list[tuple[str, bytes, str]] = [
    (
        "locked.npz",
        _locked_npz(),
        "is damaged or cut off (File 't.npy' is encrypted, password required for extraction); save or copy it again",
    ),
    ("empty.csv", b"", "is empty; record or export it again"),
    ("blank.csv", b"\n \n\n", "holds no lines of data; record or export it again"),
    ("comments.csv", b"# a\n# b\n", "holds no lines of data; record or export it again"),
    ("header.csv", b"t,q\n", "has a header but no rows of numbers; record or export it again"),
    (
        "units.csv",
        b"t;q\ns;mm\n",
        "has a header but no rows of numbers; record or export it again",
    ),
    (
        "words.csv",
        b"Zeit\n" + b"auto auto\n" * 8,
        "has a header but no rows of numbers; record or export it again",
    ),
    ("one_row.csv", b"t,q\n0,1\n", _NO_SERIES),
    (
        "word.csv",
        b"t,q\n0,1\n1,oops\n2,3\n",
        "line 3, column 'q': 'oops' is not a number; correct the cell or delete the line",
    ),
    (
        "word_far.csv",
        b"# note\nt;q\n\n" + b"0;1,5\n" * 700 + b"0;ERR\n",
        "line 704, column 'q': 'ERR' is not a number; correct the cell or delete the line",
    ),
    (
        "thousands.csv",
        b"t;q\n0,5;1\n0,6;2\n" + b"0,7;3\n" * 700 + b"1.000;3\n",
        "line 704, column 't': '1.000' is not a number; correct the cell or delete the line",
    ),
    (
        "decimals.csv",
        b"t;q\n0,5;1.5\n1,5;2.5\n",
        "'0,5' and '1.5' use different decimal signs; export with one",
    ),
    (
        "ragged.csv",
        b"t,q\n0,1\n1\n2,3\n",
        "line 3 has 1 cells where 2 are expected; correct the line",
    ),
    (
        "wide.csv",
        b"t,q\n0,1\n1,2,3\n2,3\n",
        "line 3 has 3 cells where 2 are expected; correct the line",
    ),
    (
        "cut.csv",
        b"t,q\n0,1\n1,2\n2",
        "line 4 has 1 cells where 2 are expected; the log was cut off, delete this last line",
    ),
    (
        "german.csv",
        b"t,q\n0,0,1,5\n0,1,2\n0,2,1,6\n",
        "the comma stands between the columns and is the decimal sign as well (2 names, 3 to 4 cells a row); "
        "export with semicolons or with decimal points",
    ),
    (
        "words.csv",
        b"mode,tool\nauto,a\nman,b\n",
        _NO_NUMBERS,
    ),
    (
        "binary.csv",
        bytes(range(256)) * 4,
        "is not text (a NUL byte at offset 0); export the log as CSV or Parquet",
    ),
    ("control.txt", bytes(range(1, 32)) * 20, "is not text; export the log as CSV or Parquet"),
    (
        "nul_tail.csv",
        b"t,q\n0,1\n1,2\n" + b"\x00" * 100,
        "is not text (a NUL byte at offset 12); export the log as CSV or Parquet",
    ),
    (
        "utf16.csv",
        "t,q\n0,1\n".encode("utf-16") + b"\x00",
        "is damaged UTF-16 text; export it again as UTF-8",
    ),
    ("log.foo", b"abc", f"unknown ending '.foo'; known: {_ENDINGS}"),
    ("log.xlsx", b"PK\x03\x04", ".xlsx files cannot be read; save the sheet as CSV"),
    (
        "log.pkl",
        b"\x80\x04",
        ".pkl files cannot be read; a pickle can run code; save the signals as CSV or Parquet",
    ),
    (
        "not.mat",
        b"t,q\n0,1\n",
        "is not a mat file although it ends in .mat; it begins with b't,q\\n0,1\\n'; export it "
        "again or correct the ending",
    ),
    (
        "not.parquet",
        b"t,q\n",
        "is not a parquet file although it ends in .parquet; it begins with b't,q\\n'; export it "
        "again or correct the ending",
    ),
    (
        "not.h5",
        b"t,q\n",
        "is not a hdf5 file although it ends in .h5; it begins with b't,q\\n'; export it again or "
        "correct the ending",
    ),
    (
        "objects.npy",
        _npy(np.array([1, [2, 3]], dtype=object)),
        "holds Python objects, and a pickle can run code; save it as plain numbers",
    ),
    ("text.npy", _npy(np.array(["a", "b"])), _NO_NUMBERS),
    ("scalars.mat", _mat(kp=1.0, kv=2.0), _NO_SERIES),
    ("texts.mat", _mat(a="hello"), _NO_NUMBERS),
    (
        "empty.parquet",
        _parquet(pa.table({"t": pa.array([], pa.float64())})),
        "has columns but no rows; record or export it again",
    ),
    ("empty.h5", _hdf5(), _NO_NUMBERS),
    (
        "other.mcap",
        _mcap("protobuf", b"\x00\x01"),
        "topic '/servo' is encoded as 'protobuf'; only JSON and ROS messages can be read, re-encode the "
        "topic or export it as CSV",
    ),
    (
        "ros.mcap",
        _mcap("cdr", b"\x00\x01"),
        "is damaged or cut off (Profile is not ros2.); repair it with `ros2 bag reindex` or copy it again",
    ),
    ("none.mcap", _mcap("json", b"{}", messages=0), "holds no messages; record it again"),
    (
        "words.mcap",
        _mcap("json", json.dumps({"mode": "auto", "t": 1.0}).encode(), messages=1),
        _NO_SERIES,
    ),
]


@pytest.mark.parametrize(("name", "content", "message"), CASES, ids=[c[0] for c in CASES])
def test_one_clear_line(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(LogError) as caught:
        read(path)
    assert str(caught.value) == f"{path}: {message}"


DAMAGED: list[tuple[str, Callable[[], bytes]]] = [
    ("cut.npy", lambda: _npy(np.zeros(100))),
    ("cut.mat", lambda: _mat(t=np.arange(100.0))),
    ("cut.h5", lambda: _hdf5(t=np.arange(100.0))),
    ("cut.parquet", lambda: _parquet(pa.table({"t": np.arange(100.0)}))),
    ("cut.mcap", lambda: _mcap("json", b'{"q": 1.0}', messages=50)),
]


@pytest.mark.parametrize(("name", "make"), DAMAGED, ids=[c[0] for c in DAMAGED])
def test_files_cut_in_half_are_said_to_be_damaged(
    tmp_path: Path, name: str, make: Callable[[], bytes]
) -> None:
    path = tmp_path / name
    whole = make()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(LogError, match=r"is damaged") as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def _broken(whole: bytes, rng: np.random.Generator) -> bytes:
    """Return a file with some bytes changed, its end cut off, or a part replaced."""
    raw = bytearray(whole)
    kind = rng.integers(3)
    if kind == 0:
        for place in rng.integers(0, len(raw), 4):
            raw[place] = rng.integers(256)
    elif kind == 1:
        del raw[rng.integers(1, len(raw)) :]
    else:
        start = rng.integers(len(raw))
        raw[start : start + 10] = rng.bytes(20)
    return bytes(raw)


_NUMBERS = np.random.default_rng(0).normal(size=(60, 3))
SOUND: list[tuple[str, Callable[[], bytes]]] = [
    ("x.csv", lambda: "\n".join(",".join(map(repr, r)) for r in _NUMBERS.tolist()).encode()),
    ("x.npy", lambda: _npy(_NUMBERS)),
    ("x.mat", lambda: _mat(rec={"q": _NUMBERS, "name": "abc"}, k=2.0)),
    ("x.h5", lambda: _hdf5(q=_NUMBERS, k=3.0)),
    ("x.parquet", lambda: _parquet(pa.table({"q": _NUMBERS[:, 0]}))),
    ("x.mcap", lambda: _mcap("json", b'{"q": 1.0}', messages=50)),
]


@pytest.mark.parametrize(("name", "make"), SOUND, ids=[c[0] for c in SOUND])
def test_whatever_happens_to_a_file_the_answer_is_a_log_or_one_line(
    tmp_path: Path, name: str, make: Callable[[], bytes]
) -> None:
    rng = np.random.default_rng(1)
    path = tmp_path / name
    said: list[str] = []
    for _ in range(60):
        path.write_bytes(_broken(make(), rng))
        try:
            read(path)
        except LogError as error:
            said.append(str(error))
    assert said
    assert all(text.startswith(f"{path}: ") and "\n" not in text for text in said)


def test_missing_file_lists_the_logs_beside_it(tmp_path: Path) -> None:
    (tmp_path / "run1.csv").write_text("t,q\n0,1\n")
    with pytest.raises(LogError) as caught:
        read(tmp_path / "run2.csv")
    assert str(caught.value) == f"{tmp_path}/run2.csv: no such file; logs in its folder: run1.csv"


def test_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(LogError) as caught:
        read(tmp_path / "no" / "run.csv")
    expected = f"{tmp_path}/no/run.csv: no such file; the folder {tmp_path}/no does not exist either"
    assert str(caught.value) == expected


def test_a_folder_is_no_log(tmp_path: Path) -> None:
    with pytest.raises(LogError) as caught:
        read(tmp_path)
    assert str(caught.value) == f"{tmp_path}: is a folder; name a log file inside it"


def test_no_file_at_all() -> None:
    with pytest.raises(LogError, match="no log file given; name at least one"):
        read()


def test_join_needs_equal_lengths(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("q\n1\n2\n3\n")
    (tmp_path / "b.csv").write_text("u\n1\n2\n")
    with pytest.raises(LogError) as caught:
        read(tmp_path / "a.csv", tmp_path / "b.csv")
    assert str(caught.value) == (
        f"cannot join files of different length (rows: {tmp_path}/a.csv 3, {tmp_path}/b.csv 2); "
        f"cut them alike first"
    )


def test_join_argument_with_nothing_beside_the_plus() -> None:
    with pytest.raises(LogError, match=r"a\.csv\+: an empty name beside '\+'; write a\.csv\+b\.csv"):
        read_argument("a.csv+")


def test_only_names_a_clock_that_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,q\n0,1\n1,2\n")
    with pytest.raises(LogError, match=r"a\.csv: holds no numbers whose name begins with 'imu'"):
        read(path, only="imu")
