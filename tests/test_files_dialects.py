"""Spellings of text logs: clocks, numbers, names that stand twice, rows between the rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pinotwin.log import Log
from pinotwin.logs.files import read


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


def test_values_behind_their_names_need_the_same_names_in_every_row(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="line 3 has"):
        written(tmp_path, "q 1 u 2\nq 2 u 3\nu 3 q 4\nq 4 u 5\n", "x.log")


def test_two_columns_of_one_name_are_told_apart(tmp_path: Path) -> None:
    log = written(tmp_path, "t,q[0],q[1],q[0],q[1],u [A],u [V]\n0,1,5,2,5,3,7\n1,2,5,3,5,4,8\n")
    assert list(log.channels) == ["t", "q[0]", "q[1]", "q#2[0]", "q#2[1]", "u", "u#2"]
    assert log.notes == ("4 columns are named 'q', told apart as q#2[0], q#2[1]",)
    assert log.units == {"u": "A", "u#2": "V"}


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
