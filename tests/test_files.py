"""Readers: what is written comes back, in every format and every spelling of a table."""

from __future__ import annotations

import io
import json
import pickle
import tempfile
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mcap.writer import Writer

from pinotwin.log import Log, split_unit
from pinotwin.logs.files import read, read_argument

few = settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])

numbers = st.floats(-1e12, 1e12, allow_nan=False, allow_subnormal=False)


def tables(min_columns: int = 1) -> st.SearchStrategy[np.ndarray]:
    """Return tables of (n, k) numbers, more rows than columns."""
    shapes = st.tuples(st.integers(6, 20), st.integers(min_columns, 4))
    return shapes.flatmap(lambda shape: hnp.arrays(float, shape, elements=numbers))


def assert_channels(log: Log, names: list[str], table: np.ndarray) -> None:
    assert list(log.channels) == names
    for name, column in zip(names, table.T, strict=True):
        np.testing.assert_array_equal(log[name], column)


ROOM = tempfile.TemporaryDirectory()
"""One for all examples: gone at the end, where thousands of directories stayed in /tmp."""


def fresh(name: str) -> Path:
    return Path(tempfile.mkdtemp(dir=ROOM.name)) / name


@few
@given(
    table=tables(),
    delimiter=st.sampled_from([",", ";", "\t", " ", "   "]),
    decimal=st.sampled_from([".", ","]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"]),
    newline=st.sampled_from(["\n", "\r\n"]),
    headed=st.booleans(),
    trailing=st.booleans(),
)
def test_text_comes_back(
    table: np.ndarray,
    delimiter: str,
    decimal: str,
    encoding: str,
    newline: str,
    headed: bool,
    trailing: bool,
) -> None:
    if delimiter == ",":
        decimal = "."
    headed = headed or table.shape[1] == 1  # "0,5" alone is two columns as well as one
    names = [f"s{i}µ" for i in range(table.shape[1])]
    rows = [delimiter.join(repr(x).replace(".", decimal) for x in row) for row in table.tolist()]
    lines = [delimiter.join(names), *rows] if headed else rows
    if trailing and delimiter.strip() and table.shape[1] > 1:
        lines = [line + delimiter for line in lines[:1]] + [line + delimiter for line in lines[1:]]
    path = fresh("run.csv")
    path.write_bytes((newline.join(lines) + newline).encode(encoding))
    log = read(path)
    expected = names if headed else [f"run[{i}]" for i in range(len(names))]
    for name, column in zip(expected, table.T, strict=True):
        np.testing.assert_array_equal(log[name], column)


@few
@given(table=tables(), holes=st.data())
def test_holes_in_text_become_nan_and_are_counted(table: np.ndarray, holes: st.DataObject) -> None:
    row = holes.draw(st.integers(0, len(table) - 1))
    mark = holes.draw(st.sampled_from(["NaN", "nan", "n/a", "NULL", "#N/A", "-", " NaN "]))
    cells = [[repr(x) for x in line] for line in table.tolist()]
    cells[row][0] = mark
    path = fresh("run.csv")
    names = [f"s{i}" for i in range(table.shape[1])]
    path.write_text("\n".join(",".join(line) for line in [names, *cells]))
    log = read(path)
    assert np.isnan(log["s0"][row])
    assert int(np.isnan(log["s0"]).sum()) == 1
    assert f"s0: 1 missing values, first in line {row + 2}" in log.notes


@few
@given(table=tables())
def test_parquet_comes_back(table: np.ndarray) -> None:
    names = [f"s{i}" for i in range(table.shape[1])]
    path = fresh("run.parquet")
    pq.write_table(pa.table(dict(zip(names, table.T, strict=True))), path)
    assert_channels(read(path), names, table)


@few
@given(table=tables(2), transposed=st.booleans())
def test_npy_comes_back_split_along_the_long_axis(table: np.ndarray, transposed: bool) -> None:
    path = fresh("run.npy")
    np.save(path, table.T if transposed else table)
    assert_channels(read(path), [f"run[{i}]" for i in range(table.shape[1])], table)


@few
@given(table=tables(2))
def test_npz_comes_back(table: np.ndarray) -> None:
    path = fresh("run.npz")
    np.savez(path, t=table[:, 0], q=table[:, 1:], gain=2.5)
    log = read(path)
    np.testing.assert_array_equal(log["t"], table[:, 0])
    assert log.scalars == {"gain": 2.5}


@few
@given(table=tables(2), gain=numbers)
def test_mat_comes_back_with_nested_structs(table: np.ndarray, gain: float) -> None:
    path = fresh("run.mat")
    content = {"rec": {"q": table, "deep": {"t": table[:, 0]}}, "kp": gain, "name": "robot"}
    scipy.io.savemat(path, content)
    log = read(path)
    for i, column in enumerate(table.T):
        np.testing.assert_array_equal(log[f"rec.q[{i}]"], column)
    np.testing.assert_array_equal(log["rec.deep.t"], table[:, 0])
    assert log.scalars["kp"] == gain
    assert "left out, not numbers: name" in log.notes


@few
@given(table=tables(2), gain=numbers)
def test_hdf5_comes_back(table: np.ndarray, gain: float) -> None:
    path = fresh("run.h5")
    with h5py.File(path, "w") as file:
        file["servo/q"] = table
        file["servo/t"] = table[:, 0]
        file["servo/t"].attrs["unit"] = "ms"
        file["kp"] = gain
    log = read(path)
    for i, column in enumerate(table.T):
        np.testing.assert_array_equal(log[f"servo.q[{i}]"], column)
    assert log.scalars["kp"] == gain
    assert log.units == {"servo.t": "ms"}


@few
@given(table=tables(2))
def test_matlab_v73_comes_back(table: np.ndarray) -> None:
    path = fresh("run.mat")
    with h5py.File(path, "w", userblock_size=512) as file:
        file["rec/q"] = table.T  # MATLAB stores its columns first
        file["rec/q"].attrs["MATLAB_class"] = np.bytes_("double")
        file["label"] = np.array([[114], [111]], dtype=np.uint16)
        file["label"].attrs["MATLAB_class"] = np.bytes_("char")
        file["#refs#/a"] = np.zeros(50)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(128))
    log = read(path)
    assert_channels(log, [f"rec.q[{i}]" for i in range(table.shape[1])], table)
    assert log.notes == ("left out, not numbers: label",)


def _write_mcap(path: Path, topics: dict[str, list[dict[str, object]]]) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for topic, messages in topics.items():
            channel = writer.register_channel(topic, message_encoding="json", schema_id=0)
            for i, message in enumerate(messages):
                stamp = 10**18 + i * 4_000_000
                data = json.dumps(message).encode()
                writer.add_message(channel, log_time=stamp, data=data, publish_time=stamp)
        writer.finish()


@few
@given(table=tables(2))
def test_mcap_comes_back(table: np.ndarray) -> None:
    path = fresh("run.mcap")
    _write_mcap(path, {"/servo": [{"q": row[0], "axes": row[1:]} for row in table.tolist()]})
    log = read(path)
    np.testing.assert_array_equal(log["q"], table[:, 0])
    np.testing.assert_array_equal(log["axes[0]"], table[:, 1])
    np.testing.assert_allclose(log["t"], 0.004 * np.arange(len(table)), atol=1e-12)
    assert log.units == {"t": "s"}


def test_mcap_topics_of_two_clocks_can_be_read_one_by_one(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    _write_mcap(path, {"/servo/x": [{"q": 1.0}] * 9, "/imu": [{"gx": 2.0}] * 20})
    assert set(read(path).channels) == {"imu.gx", "imu.t"}
    log = read(path, only="servo")
    assert set(log.channels) == {"servo.x.q", "servo.x.t"}
    assert len(log) == 9


def test_units_in_headers_are_recorded_not_applied(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("Time (ms),Y.q [mm],Y.u [bananas],A [1]\n0,1,2,3\n4,5,6,7\n")
    log = read(path)
    assert list(log.channels) == ["Time", "Y.q", "Y.u [bananas]", "A [1]"]
    assert log.units == {"Time": "ms", "Y.q": "mm"}
    np.testing.assert_array_equal(log["Y.q"], [1.0, 5.0])


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("Y.q [mm]", ("Y.q", "mm")),
        ("Y_Ist (A)", ("Y_Ist", "A")),
        ("q[0]", ("q[0]", None)),
        ("q [0]", ("q [0]", None)),
        ("q [1]", ("q [1]", None)),
        (" q ", ("q", None)),
        ("speed [deg/s]", ("speed", "deg/s")),
        ("[mm]", ("[mm]", None)),
    ],
)
def test_split_unit(header: str, expected: tuple[str, str | None]) -> None:
    assert split_unit(header) == expected


def test_a_row_of_units_beneath_the_header(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t;Y.q;mode\n[s];[mm];-\n0;1,5;0\n1;2,5;1\n")
    log = read(path)
    assert log.units == {"t": "s", "Y.q": "mm", "mode": "-"}
    np.testing.assert_array_equal(log["Y.q"], [1.5, 2.5])


def test_comments_and_a_header_in_a_comment(tmp_path: Path) -> None:
    path = tmp_path / "run.txt"
    path.write_text("# made by np.savetxt\n# t, q\n0, +1\n# a break\n1, 2\n\n2, 3\n")
    log = read(path)
    np.testing.assert_array_equal(log["t"], [0, 1, 2])
    np.testing.assert_array_equal(log["q"], [1, 2, 3])


def test_blank_lines_are_skipped_and_said_so(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t,q\n0,1\n\n1,\n\n")
    log = read(path)
    assert log.notes == ("1 blank lines were skipped", "q: 1 missing values, first in line 4")


def test_latin_1_and_text_columns_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes("t,µ,mode\n0,1,auto\n1,2,Zürich\n".encode("latin-1"))
    log = read(path)
    assert list(log.channels) == ["t", "µ"]
    assert log.notes == (
        "text is not UTF-8 and was read as latin-1",
        "left out, not numbers: mode",
    )


def test_dates_become_seconds(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("time,q\n2024-05-01 10:00:00.000,1\n2024-05-01 10:00:00.004,2\n")
    log = read(path)
    np.testing.assert_allclose(log["time"], [0.0, 0.004], atol=1e-12)
    assert log.units == {"time": "s"}
    assert log.notes[0].startswith("time: dates and times were turned into seconds since 2024-05-01")


def test_quoted_cells_with_decimal_commas(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text('"t","q, real"\n"0,1","1,5"\n"0,2","1,6"\n')
    np.testing.assert_array_equal(read(path)["q, real"], [1.5, 1.6])


def test_infinities_stay_and_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t,q\n0,inf\n1,2\n2,-inf\n")
    log = read(path)
    assert np.isposinf(log["q"][0])
    assert log.notes == ("q: 2 missing or infinite values, first in line 2",)


def test_content_outweighs_the_ending(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    pq.write_table(pa.table({"t": [0.0, 1.0]}), path)
    log = read(path)
    np.testing.assert_array_equal(log["t"], [0.0, 1.0])
    assert log.notes == ("the content is parquet, not what .csv promises",)


def test_parquet_lists_times_nulls_and_units(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    schema = pa.schema(
        [
            pa.field("t", pa.timestamp("ms")),
            pa.field("q", pa.list_(pa.float64())),
            pa.field("u", pa.float32(), metadata={"unit": "A"}),
            pa.field("mode", pa.string()),
            pa.field("on", pa.bool_()),
        ]
    )
    columns = [[0, 4, 8], [[1.0, 2.0]] * 3, [1.5, None, 2.5], ["a", "b", "c"], [True, False, True]]
    arrays = [pa.array(x, f.type) for x, f in zip(columns, schema, strict=True)]
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), path)
    log = read(path)
    np.testing.assert_allclose(log["t"], [0.0, 0.004, 0.008])
    np.testing.assert_array_equal(log["q[1]"], [2.0, 2.0, 2.0])
    np.testing.assert_array_equal(log["u"], [1.5, np.nan, 2.5])
    np.testing.assert_array_equal(log["on"], [1.0, 0.0, 1.0])
    assert log.units == {"t": "s", "u": "A"}
    assert "u: 1 missing values, first in row 1" in log.notes


def test_other_lengths_are_left_out_with_a_note(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    content = {"q": np.zeros((6, 500)), "u": np.arange(6.0), "other": np.zeros(90)}
    scipy.io.savemat(path, content)
    log = read(path)
    assert len(log) == 500
    assert log.scalars["u[5]"] == 5.0
    assert log.notes == ("left out, not of length 500: other (90,)",)


def test_files_side_by_side(tmp_path: Path) -> None:
    (tmp_path / "pos.csv").write_text("t,J1,q\n0,1,5\n1,2,6\n")
    (tmp_path / "cur.csv").write_text("t,J1,u\n0,3,7\n1,4,8\n")
    log = read_argument(f"{tmp_path}/pos.csv+{tmp_path}/cur.csv")
    assert list(log.channels) == ["t", "pos.J1", "q", "cur.J1", "u"]
    np.testing.assert_array_equal(log["cur.J1"], [3.0, 4.0])
    assert log.source == f"{tmp_path}/pos.csv+{tmp_path}/cur.csv"


def test_different_clocks_are_kept_apart(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,q\n0,1\n1,2\n")
    (tmp_path / "b.csv").write_text("t,u\n0,1\n2,2\n")
    assert list(read(tmp_path / "a.csv", tmp_path / "b.csv").channels) == ["a.t", "q", "b.t", "u"]


def test_a_plus_in_the_name_of_a_file_is_no_join(tmp_path: Path) -> None:
    (tmp_path / "a+b.csv").write_text("t,q\n0,1\n1,2\n")
    assert list(read_argument(str(tmp_path / "a+b.csv")).channels) == ["t", "q"]


def test_a_log_is_frozen_and_survives_pickling() -> None:
    log = Log({"t": np.arange(3.0)}, "x", {"k": 1.0}, ("note",), {"t": "s"}, {"t": (2.0, 1.0)})
    with pytest.raises(ValueError, match="read-only"):
        log["t"][0] = 5.0
    back = pickle.loads(pickle.dumps(log))
    np.testing.assert_array_equal(back["t"], log["t"])
    assert (back.scalars, back.notes, back.units, back.scale) == (
        log.scalars,
        log.notes,
        log.units,
        log.scale,
    )
    assert back.fingerprint() == log.fingerprint()
    assert log.rows(slice(1, 3)).fingerprint() != log.fingerprint()
    np.testing.assert_array_equal(log.raw("t"), [-0.5, 0.0, 0.5])


def test_numbers_are_never_read_cell_by_cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    x = rng.normal(size=(11, 20_000))
    path = tmp_path / "big.csv"
    pacsv.write_csv(pa.table({f"c{i}": row for i, row in enumerate(x)}), path)
    monkeypatch.delattr("pinotwin.logs.files.text._parse_slowly")
    log = read(path)
    np.testing.assert_array_equal(log["c10"], x[10])


def test_a_csv_of_numpy_comes_back() -> None:
    buffer = io.StringIO()
    table = np.random.default_rng(1).normal(size=(20, 3))
    np.savetxt(buffer, table, header="t q u")
    path = fresh("run.txt")
    path.write_text(buffer.getvalue())
    assert_channels(read(path), ["t", "q", "u"], table)


def test_two_exports_of_one_recording_share_their_clock_whatever_its_name(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("Time [ms],Xact,state\n0,1.5,3\n2,1.25,3\n4,1,3\n")
    (tmp_path / "y.csv").write_text("Time [ms],Yact,state\n0,7,1\n2,8,1\n4,9,2\n")
    log = read_argument(f"{tmp_path / 'x.csv'}+{tmp_path / 'y.csv'}")
    assert list(log.channels) == ["Time", "Xact", "x.state", "Yact", "y.state"]
    assert log.units["Time"] == "ms"
    assert "Time is the same in all joined files and kept once" in log.notes
