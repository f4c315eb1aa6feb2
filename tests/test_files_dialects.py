"""Spellings of text logs: clocks, numbers, names that stand twice, rows between the rows."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pinotwin.errors import LogError
from pinotwin.log import Log
from pinotwin.logs.files import content, isolated, read
from tests.arrow_memory import arrow_peak


@pytest.fixture
def cases(data_dir: Path) -> Path:
    """Small files beside the recordings; skipped where they are not at hand."""
    folder = data_dir.parent / "cases"
    if not folder.is_dir():
        pytest.skip(f"the small cases are not at hand ({folder})")
    return folder


def written(tmp_path: Path, text: str | bytes, name: str = "x.csv") -> Log:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read(path)


def stamps(tmp_path: Path, *cells: str) -> np.ndarray:
    log = written(tmp_path, "time;q\n" + "".join(f"{cell};{i}\n" for i, cell in enumerate(cells)))
    assert log.units["time"] == "s"
    return log["time"]


EVEN = [0.0, 0.004, 0.008]


@pytest.mark.parametrize(
    "cells",
    [
        ("2026-03-02T08:00:00.000Z", "2026-03-02T08:00:00.004Z", "2026-03-02T08:00:00.008Z"),
        ("2026-03-02 08:00:00.000+02:00", "2026-03-02 08:00:00.004+02:00", "2026-03-02 08:00:00.008+0200"),
        ("2026-12-31T23:59:59.996Z", "2027-01-01T00:00:00.000Z", "2027-01-01T00:00:00.004Z"),
        ("2026-12-31T23:59:59.996", "2027-01-01T00:00:00.000", "2027-01-01T00:00:00.004"),
        ("2024-03-31T01:59:59.996+01:00", "2024-03-31T03:00:00.000+02:00", "2024-03-31T03:00:00.004+02:00"),
        ("2024-10-27T02:59:59.996+02:00", "2024-10-27T02:00:00.000+01:00", "2024-10-27T02:00:00.004+01:00"),
        ("2024-03-31T01:59:59.996-03:30", "2024-03-31T05:30:00.000Z", "2024-03-31T05:30:00.004Z"),
        ("20260302T080000.000Z", "20260302T080000.004Z", "20260302T080000.008Z"),
        ("2026/03/02 08:00:00,000", "2026/03/02 08:00:00,004", "2026/03/02 08:00:00,008"),
        ("11:59:59.996 AM", "12:00:00.000 PM", "12:00:00.004 PM"),
        ("11:59:59.996 p.m.", "12:00:00.000 a.m.", "12:00:00.004 a.m."),
        ("3/2/2026 7:59:59.996 AM", "3/2/2026 8:00:00.000 AM", "3/2/2026 8:00:00.004 AM"),
        ("12:59:59,996", "13:00:00,000", "13:00:00,004"),
        ("02-Mar-2026 07:59:59.996", "02-Mar-2026 08:00:00.000", "02-Mar-2026 08:00:00.004"),
        ("2026-03-02t08:00:00.000z", "2026-03-02t08:00:00.004z", "2026-03-02t08:00:00.008z"),
    ],
    ids=lambda cells: cells[0],
)
def test_stamps_become_seconds(tmp_path: Path, cells: tuple[str, ...]) -> None:
    np.testing.assert_allclose(stamps(tmp_path, *cells), EVEN, atol=1e-11)


@pytest.mark.parametrize(("before", "after"), [(1, 3), (2, 2)])
def test_a_clock_put_to_or_from_summer_time_without_a_zone_goes_on(
    tmp_path: Path, before: int, after: int
) -> None:
    day = "2024-03-31" if after > before else "2024-10-27"
    cells = [f"{day}T0{before}:59:59.{ms}" for ms in ("984", "988", "992", "996")]
    cells += [f"{day}T0{after}:00:00.{ms}" for ms in ("000", "004", "008", "012")]
    np.testing.assert_allclose(stamps(tmp_path, *cells), 0.004 * np.arange(8), atol=1e-11)


def test_a_pause_of_about_an_hour_stays(tmp_path: Path) -> None:
    cells = [f"2024-03-31T01:00:00.{ms}" for ms in ("000", "004", "008")]
    cells += [f"2024-03-31T02:00:03.{ms}" for ms in ("000", "004", "008")]
    assert stamps(tmp_path, *cells)[3] == pytest.approx(3603.0)


@pytest.mark.parametrize(
    "text",
    [
        "t|q\n0|1234.5\n1|-2.5\n2|3\n",
        "| t | q |\n|---|---|\n| 0 | 1234.5 |\n| 1 | -2.5 |\n| 2 | 3 |\n",
        " t | q\n---+--------\n 0 | 1234.5\n 1 | -2.5\n 2 | 3\n",
        "t;q\n0;1'234.5\n1;-2.5\n2;3\n",
        "t;q\n0;1’234,5\n1;-2,5\n2;3\n",
        "t;q\n0;1\u00a0234,5\n1;-2,5\n2;3\n",
        "t,q\n0,1234.5\n1,\u22122.5\n2,3\n",
        "t,q\n0,1234.5\n\n1,-2.5\n,\n   \n2,3\n\n",
        "t,q\n0,1234.5\n1,-2.5\nt,q\n2,3\n",
        "Trace 7\nt;q\n[s];[mm]\n0;1234.5\n1;-2.5\nTrace 7\nt;q\n[s];[mm]\n2;3\n",
        "t,q\n0,0,1234,5\n1,0,-2,5\n2,0,3,0\n",
        "t=0 q=1234.5\nt=1 q=-2.5\nt=2 q=3\n",
        "Sampling period is 1000000000 nSec\n\nq +1234.5 \nq -2.5 \nq +3.0 \n",
        "t: 0, q: 1234,5\nt: 1, q: -2,5\nt: 2, q: 3,0\n",
    ],
)
def test_one_table_in_many_spellings(tmp_path: Path, text: str) -> None:
    log = written(tmp_path, text)
    np.testing.assert_array_equal(log["t"], [0, 1, 2])
    np.testing.assert_array_equal(log["q"], [1234.5, -2.5, 3])


def test_what_stands_between_the_rows_is_counted(tmp_path: Path) -> None:
    log = written(tmp_path, "t,q\n0,1\n\n,\n1,2\nt,q\n2,3\n")
    assert log.notes == ("2 blank lines were skipped", "1 repeated lines of the header were skipped")


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_a_row_without_a_value_is_a_sample_where_no_column_is_the_clock(tmp_path: Path, mark: str) -> None:
    text = f"Sample time: 4 ms\nq{mark}u\n1{mark}2\n{mark}\n3{mark}4\n"
    log = written(tmp_path, text)
    np.testing.assert_array_equal(log["q"], [1, np.nan, 3])
    np.testing.assert_allclose(log.t, [0.0, 0.004, 0.008])


def test_unavailable_is_missing(tmp_path: Path) -> None:
    log = written(tmp_path, "t,Xact,Xload\n0,1,UNAVAILABLE\n1,2,5\n2,Unavailable,6\n")
    assert np.isnan(log["Xload"][0])
    assert np.isnan(log["Xact"][2])


def test_a_comma_that_cuts_only_some_numbers_is_said(cases: Path, tmp_path: Path) -> None:
    path = cases / "public" / "decimal_and_field_comma" / "akd.csv"
    with pytest.raises(
        Exception, match=r"the comma stands between the columns and is the decimal sign as well"
    ):
        read(path)


def test_more_whole_numbers_than_names_are_not_joined_where_one_has_a_sign(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="the comma stands between the columns"):
        written(tmp_path, "t,q\n0,0,1,-5\n0,1,1,6\n")


def test_one_column_with_decimal_commas_and_whole_numbers(tmp_path: Path) -> None:
    np.testing.assert_array_equal(written(tmp_path, "q\n1e-07\n0,0\n0,5\n3\n")["q"], [1e-7, 0.0, 0.5, 3.0])


def test_a_stamp_before_the_values_is_the_clock(tmp_path: Path) -> None:
    log = written(tmp_path, "08:00:00.00 q=1 u=2\n08:00:00.01 q=3 u=4\n08:00:00.02 q=5 u=6\n", "x.log")
    np.testing.assert_allclose(log["time"], [0.0, 0.01, 0.02], atol=1e-12)
    np.testing.assert_array_equal(log["u"], [2, 4, 6])


@pytest.mark.parametrize("end", ["", ","])
def test_numbers_without_a_name_are_no_stamps(tmp_path: Path, end: str) -> None:
    log = written(tmp_path, f"0.0,1.0{end}\n0.5,2.0{end}\n1.0,3.0{end}\n")
    np.testing.assert_array_equal(log["x[1]"], [1, 2, 3])


def test_a_word_before_a_number_may_be_a_mode(tmp_path: Path) -> None:
    log = written(tmp_path, "auto 1\nauto 2\nman 3\n", "x.log")
    np.testing.assert_array_equal(log["x[1]"], [1, 2, 3])


def test_values_behind_their_names_need_the_same_names_in_every_row(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="line 3 has"):
        written(tmp_path, "q 1 u 2\nq 2 u 3\nu 3 q 4\nq 4 u 5\n", "x.log")


def test_two_columns_of_one_name_are_told_apart(tmp_path: Path) -> None:
    log = written(tmp_path, "t,q[0],q[1],q[0],q[1],u [A],u [V]\n0,1,5,2,5,3,7\n1,2,5,3,5,4,8\n")
    assert list(log.channels) == ["t", "q[0]", "q[1]", "q#2[0]", "q#2[1]", "u", "u#2"]
    assert log.notes == ("4 columns are named 'q', distinguished as q#2[0], q#2[1]",)
    assert log.units == {"u": "A", "u#2": "V"}


@pytest.mark.parametrize(
    ("names", "apart"),
    [
        ("q;q;q", ["q", "q#2", "q#3"]),
        ("q#2;q;q", ["q#2", "q", "q#3"]),
        ("q;q;q#2", ["q", "q#3", "q#2"]),
        ("q (2);q (2);q", ["q (2)", "q#2 (2)", "q"]),
    ],
)
def test_a_number_that_another_column_has_is_not_given_again(
    tmp_path: Path, names: str, apart: list[str]
) -> None:
    log = written(tmp_path, f"{names}\n1;2;3\n2;3;5\n")
    assert list(log.channels) == apart
    np.testing.assert_array_equal([x[1] for x in log.channels.values()], [2, 3, 5])


def test_unused_channels_of_one_name_are_left_out(tmp_path: Path) -> None:
    log = written(tmp_path, "t,off,q,off\n0,0,1,2.5\n1,0,2,2.5\n")
    assert list(log.channels) == ["t", "q"]
    assert log.notes == ("left out, unused: 2 columns named 'off', of which none changes",)


def test_a_row_of_groups_over_the_names(tmp_path: Path) -> None:
    log = written(
        tmp_path, "title\n;Axis X;;Axis Y;\nTime;pos;cur;pos;cur\nms;mm;A;mm;A\n0;1;2;3;4\n4;2;3;4;5\n"
    )
    assert list(log.channels) == ["Time", "Axis X pos", "Axis X cur", "Axis Y pos", "Axis Y cur"]
    assert log.units["Axis Y cur"] == "A"
    assert log.units["Time"] == "ms"


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("Time,pos,cur\nUnit,mm,A\n0,1,2\n1,2,3\n", {"pos": "mm", "cur": "A"}),
        ("Channel name,pos,cur\nUnit,mm,A\n0,1,2\n1,2,3\n", {"t": "s", "pos": "mm", "cur": "A"}),
        (
            "Channel name,pos,Channel name,cur\nUnit,mm,Unit,A\n0,1,0,2\n1,2,1,3\n",
            {"t": "s", "pos": "mm", "cur": "A"},
        ),
    ],
)
def test_a_row_that_says_that_it_holds_units(tmp_path: Path, text: str, units: dict[str, str]) -> None:
    log = written(tmp_path, text)
    assert log.units == units
    np.testing.assert_array_equal(log["cur"], [2, 3])


def test_long_lines_of_dashes_and_bars_take_no_time(tmp_path: Path) -> None:
    text = "| t | q |\n" + "-" * 60_000 + "x\n| 0 | 1 |" + " " * 300_000 + "x\n| 1 | 2 |\n"
    with pytest.raises(LogError):
        written(tmp_path, text)


@pytest.mark.parametrize(
    ("above", "step"),
    [
        ("Sampling time interval(ms),0.667", 6.67e-4),
        ("Sampling period is 1000000 nSec", 1e-3),
        ("Sample interval: 250 us", 2.5e-4),
    ],
)
def test_a_sampling_interval_above_the_numbers_is_the_clock(tmp_path: Path, above: str, step: float) -> None:
    log = written(tmp_path, f"{above}\nq,u\n1,2\n3,4\n5,6\n")
    np.testing.assert_allclose(log.t, step * np.arange(3))


def test_a_column_of_steps_is_summed_to_the_clock(tmp_path: Path) -> None:
    log = written(tmp_path, "duration,q\n0.001,1\n0.001,2\n0.002,3\n")
    np.testing.assert_allclose(log.t, [0.0, 0.001, 0.003])
    assert "t" not in written(tmp_path, "duration,q\n0.5,1\n1.5,2\n99.5,3\n")


def test_the_small_cases(cases: Path) -> None:
    log = read(cases / "drives" / "tncscope_own.sco")
    assert list(log.channels) == ["t", "v ist/Y", "v soll/Y", "s ist/Y", "s soll/Y", "I ist/Y"]
    assert log.units == {"t": "us", **dict.fromkeys(("v ist/Y", "v soll/Y"), "mm/min"),
                         **dict.fromkeys(("s ist/Y", "s soll/Y"), "mm"), "I ist/Y": "A"}  # fmt: skip
    dot, comma = (read(cases / "drives" / f"halscope_{name}.log") for name in ("dot", "comma"))
    assert len(dot.channels) == 5
    for name, x in dot.channels.items():
        np.testing.assert_array_equal(x, comma[name])
    np.testing.assert_allclose(dot.t, 1e-3 * np.arange(4000))
    for name in ("drives/iso_time.csv", "robust/iso_z.csv"):
        log = read(cases / name)
        np.testing.assert_allclose(np.diff(next(iter(log.channels.values()))), 0.004, atol=1e-9)


def test_the_public_cases(cases: Path) -> None:
    log = read(cases / "public" / "two_columns_of_one_name" / "franka.csv")
    assert {"q[0]", "q_d[0]", "q_d#2[0]", "tau_J[6]"} <= set(log.channels)
    np.testing.assert_allclose(np.diff(log.t), 0.001)
    log = read(cases / "public" / "unused_channels_of_one_name" / "graph.csv")
    assert list(log.channels) == ["Time", "Servo motor speed", "Torque", "Droop pulses (by 1 pls.)", "INP"]
    assert log.units["Time"] == "ms"


LONG = """timestamp,dataItemId,name,value
2026-03-02T08:00:00.000Z,x1,Xact,1.0
2026-03-02T08:00:00.000Z,x2,Xload,UNAVAILABLE
2026-03-02T08:00:00.000Z,x3,mode,AUTOMATIC
2026-03-02T08:00:00.010Z,x1,Xact,1.5
2026-03-02T08:00:00.020Z,x2,Xload,7
2026-03-02T08:00:00.030Z,x1,Xact,2.5
"""


def test_changes_are_carried_forward_and_said(tmp_path: Path) -> None:
    log = written(tmp_path, LONG)
    np.testing.assert_allclose(log["timestamp"], [0.0, 0.01, 0.02, 0.03], atol=1e-12)
    np.testing.assert_array_equal(log["Xact"], [1.0, 1.5, 1.5, 2.5])
    np.testing.assert_array_equal(log["Xload"], [np.nan, np.nan, 7.0, 7.0])
    assert (
        "written on change, carried forward to the next: Xact (3 of 4 rows), Xload (2 of 4 rows)" in log.notes
    )
    assert "left out, not numbers: mode" in log.notes


def test_one_display_name_of_two_nodes_does_not_join_them(tmp_path: Path) -> None:
    rows = [f"ns=2;s={a}.Pos,Pos,{t},{x},Good,mm" for t in range(3) for a, x in (("X", t), ("Y", 10 + t))]
    rows[2] = rows[2].replace("Good", "BadNoCommunication")
    log = written(tmp_path, "Node Id,Display Name,Time,Value,Status Code,Unit\n" + "\n".join(rows) + "\n")
    np.testing.assert_array_equal(log["X.Pos"], [0, np.nan, 2])
    np.testing.assert_array_equal(log["Y.Pos"], [10, 11, 12])
    assert log.units["Y.Pos"] == "mm"


def test_one_signal_of_two_devices_is_two_channels(tmp_path: Path) -> None:
    rows = [
        f"{t},{a},{s},{k + 10 * t}" for t in range(3) for k, (a, s) in enumerate(("Xp", "Xi", "Yp", "Yi"))
    ]
    log = written(tmp_path, "time,axis,signal,value\n" + "\n".join(rows) + "\n")
    assert list(log.channels) == ["time", "X.p", "X.i", "Y.p", "Y.i"]
    np.testing.assert_array_equal(log["Y.p"], [2, 12, 22])


CHANGES = """Time,X,Y,Z
0.00,1,5,9
0.01,2,,
0.02,3,6,
0.03,,7,
0.04,,,8
0.05,4,,
"""


def test_empty_cells_of_a_table_written_on_change_are_carried_forward(tmp_path: Path) -> None:
    log = written(tmp_path, CHANGES)
    np.testing.assert_array_equal(log["X"], [1, 2, 3, 3, 3, 4])
    np.testing.assert_array_equal(log["Y"], [5, 5, 6, 7, 7, 7])
    np.testing.assert_array_equal(log["Z"], [9, 9, 9, 9, 8, 8])
    assert "written on change, carried forward to the next: X, Y, Z" in log.notes


def test_what_is_unavailable_is_not_carried_over(tmp_path: Path) -> None:
    log = written(tmp_path, CHANGES.replace("0.03,,7,", "0.03,UNAVAILABLE,7,"))
    assert np.isnan(log["X"][3])


def test_a_value_beside_a_signal_of_numbers_is_no_long_form(tmp_path: Path) -> None:
    log = written(tmp_path, "t,value,signal\n0,1,4\n1,2,5\n2,3,6\n")
    np.testing.assert_array_equal(log["value"], [1, 2, 3])


def test_a_value_beside_a_mode_is_no_long_form(tmp_path: Path) -> None:
    log = written(tmp_path, "t,value,mode\n0,1,auto\n1,2,manual\n2,3,auto\n")
    np.testing.assert_array_equal(log["value"], [1, 2, 3])


def test_a_long_table_of_parquet(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    tags = ["q", "u"] * 3
    pq.write_table(
        pa.table({"t": [0.0, 0.0, 1.0, 1.0, 2.0, 2.0], "tag": tags, "value": np.arange(6.0)}), path
    )
    log = read(path)
    np.testing.assert_array_equal(log["u"], [1.0, 3.0, 5.0])


def test_channels_in_rows_of_their_own_come_onto_one_clock(tmp_path: Path) -> None:
    rows = ["__time,a/q,a/u,b/qr,c/slow"]
    for i in range(40):
        rows.append(f"{0.01 * i:.3f},{i},{2 * i},,")
        rows.append(f"{0.01 * i + 0.005:.3f},,,{10 * i},{i if i % 8 == 0 else ''}")
    log = written(tmp_path, "\n".join(rows) + "\n")
    assert len(log) == 40
    np.testing.assert_array_equal(log["a/q"], np.arange(40))
    np.testing.assert_allclose(log["b/qr"][1:], 10 * np.arange(40)[1:] - 5.0)
    assert any("interpolated" in note and "b/qr" in note for note in log.notes)
    assert any("left out" in note and "c/slow" in note for note in log.notes)


def test_holes_in_a_table_of_one_clock_stay(tmp_path: Path) -> None:
    rows = [f"{i},{'' if 10 < i < 30 else i},{'' if i < 25 else i}" for i in range(40)]
    log = written(tmp_path, "t,q,u\n" + "\n".join(rows) + "\n")
    assert len(log) == 40
    assert np.isnan(log["q"]).sum() == 19
    assert np.isnan(log["u"]).sum() == 25


@pytest.mark.parametrize(
    "names", [["pan.pos", "lift.pos"], {"motors": ["pan.pos", "lift.pos"]}, {"axes": None}, 7]
)
def test_lists_of_a_lerobot_episode_get_the_names_of_its_meta(tmp_path: Path, names: object) -> None:
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"features": {"action": {"names": names}}}))
    path = tmp_path / "data" / "chunk-000" / "episode_000000.parquet"
    path.parent.mkdir(parents=True)
    lists = pa.array([[1.0, 2.0], [3.0, 4.0]], type=pa.list_(pa.float32()))
    pq.write_table(pa.table({"timestamp": [0.0, 0.02], "action": lists, "observation.state": lists}), path)
    log = read(path)
    known = isinstance(names, list) or "motors" in str(names)
    np.testing.assert_array_equal(log["action.lift.pos" if known else "action[1]"], [2.0, 4.0])
    np.testing.assert_array_equal(log["observation.state[0]"], [1.0, 3.0])


MANY = 2_000_000


def _bomb(path: Path) -> None:
    zeros = np.zeros(MANY, dtype=np.int8)
    if path.suffix == ".npz":
        np.savez_compressed(path, x=zeros)
    elif path.suffix == ".parquet":
        column = pa.ListArray.from_arrays(pa.array(np.arange(0, MANY + 1, 20), pa.int32()), pa.array(zeros))
        pq.write_table(pa.table({"x": column}), path)
    else:
        with h5py.File(path, "w") as file:
            for name in ("t", "x"):
                file.create_dataset(name, shape=(MANY // 2,), dtype="i1", chunks=(10**5,), compression="gzip")


@pytest.mark.parametrize("ending", ["npz", "parquet", "h5"])
def test_numbers_are_counted_as_floats_before_they_are_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    path = tmp_path / f"x.{ending}"
    _bomb(path)
    assert len(read(path)) > 1
    monkeypatch.setattr(content, "_FREE", 8 * MANY // 2)
    monkeypatch.setattr(
        isolated, "load", lambda load, path, source: load(path, source)
    )  # else it is not seen
    with pytest.raises(
        LogError, match=r"claims 2e\+06 numbers, more than the .* that a log of \d+ bytes may hold"
    ):
        read(path)


def test_long_words_of_a_table_take_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    same = pa.DictionaryArray.from_arrays(pa.array(np.zeros(20_000, dtype=np.int32)), ["x" * 20_000])
    pq.write_table(pa.table({"t": np.arange(20_000.0), "note": same}), path, store_schema=False)
    assert read(path).notes == ("left out, not numbers: note",)
    assert 0 < arrow_peak(path) < 200e6  # of 400 MB of words
