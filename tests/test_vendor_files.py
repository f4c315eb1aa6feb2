"""What controllers and robots export is read as it is: no line deleted, no column renamed by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pinotwin.columns import Column, bind
from pinotwin.errors import LogError
from pinotwin.log import Log
from pinotwin.logs.files import read
from pinotwin.scaffold.guess import guess_columns
from pinotwin.units import find_unit, si_factor
from tests.vendor_formats import CURRENT, FORMATS, twincat

ROTARY = {"A"}


@pytest.fixture(scope="module")
def servo() -> dict[str, np.ndarray]:
    """Two axes, 500 rows at 4 ms; positions of several metres, so that thousands occur."""
    t = 0.004 * np.arange(500)
    y, a = 2.1 * np.sin(2.0 * t), 1.3 * np.sin(3.0 * t + 0.4)
    return {
        "t": t,
        "Y.qr": y,
        "Y.q": y - 2e-5 * np.cos(2.0 * t),
        "Y.u": 300.0 * np.sign(np.cos(2.0 * t)) - 60.0 * y,
        "A.qr": a,
        "A.q": a - 1e-4 * np.sin(7.0 * t),
        "A.u": 4.0 * np.cos(3.0 * t + 0.4),
    }


# Format -> channel of the contract -> channel as read. What is not named here is read under the contract's name.
NAMES: dict[str, dict[str, str]] = {
    "tnc_scope": {
        "t": "Zeit", "Y.qr": "s soll Y", "Y.q": "s ist Y", "Y.u": "I ist Y",
        "A.qr": "s soll A", "A.q": "s ist A", "A.u": "I ist A",
    },
    "tnc_scope_own": {
        "t": "t", "Y.qr": "s soll/Y", "Y.q": "s ist/Y", "Y.u": "I ist/Y",
        "A.qr": "s soll/A", "A.q": "s ist/A", "A.u": "I ist/A",
    },
    "halscope": {
        "t": "t", "Y.qr": "joint.Y.motor-pos-cmd", "Y.q": "joint.Y.motor-pos-fb", "Y.u": "cia402.Y.actual-torque",
        "A.qr": "joint.A.motor-pos-cmd", "A.q": "joint.A.motor-pos-fb", "A.u": "cia402.A.actual-torque",
    },
    "mr_configurator": {
        "t": "Time", "Y.qr": "Command position Y", "Y.q": "Feedback position Y", "Y.u": "Torque Y",
        "A.qr": "Command position A", "A.q": "Feedback position A", "A.u": "Torque A",
    },
    "daq": {
        "t": "t", "Y.qr": "Y qr", "Y.q": "Y q", "Y.u": "Y u", "A.qr": "A qr", "A.q": "A q", "A.u": "A u",
    },
    "sinumerik": {
        "t": "t", "Y.qr": "Lagesollwert.Y", "Y.q": "Lageistwert.Y", "Y.u": "Strom-Istwert.Y",
        "A.qr": "Lagesollwert.A", "A.q": "Lageistwert.A", "A.u": "Strom-Istwert.A",
    },
    "twincat": {
        "t": "t", "Y.qr": "Y SetPos", "Y.q": "Y ActPos", "Y.u": "Y ActTorque",
        "A.qr": "A SetPos", "A.q": "A ActPos", "A.u": "A ActTorque",
    },
    "fanuc": {
        "t": "TIME", "Y.qr": "POSC-Y", "Y.q": "POSF-Y", "Y.u": "TCMD-Y",
        "A.qr": "POSC-A", "A.q": "POSF-A", "A.u": "TCMD-A",
    },
    "excel": {
        "t": "Time", "Y.qr": "Y Command", "Y.q": "Y Actual", "Y.u": "Y Current",
        "A.qr": "A Command", "A.q": "A Actual", "A.u": "A Current",
    },
    "opcua": {"t": "SourceTimestamp"},
    "mtconnect": {"t": "timestamp"},
    "plotjuggler": {
        "t": "__time", "Y.q": "/joint_states/Y/position", "Y.u": "/joint_states/Y/effort",
        "A.q": "/joint_states/A/position", "A.u": "/joint_states/A/effort",
        "Y.qr": "/command/Y/reference", "A.qr": "/command/A/reference",
    },
    "lerobot": {
        "t": "timestamp", "Y.q": "observation.state[0]", "A.q": "observation.state[1]",
        "Y.u": "observation.effort[0]", "A.u": "observation.effort[1]",
        "Y.qr": "action[0]", "A.qr": "action[1]",
    },
}  # fmt: off


def write(folder: Path, kind: str, servo: dict[str, np.ndarray]) -> Path:
    ending, make = FORMATS[kind]
    path = folder / f"{kind}{ending}"
    path.write_bytes(make(servo, ROTARY))
    return path


def as_contract(kind: str, log: Log) -> Log:
    """Return the log in SI with the names of the contract; units come from the file alone."""
    names = NAMES.get(kind, {})
    amperes = kind in ("tnc_scope", "tnc_scope_own", "daq", "sinumerik", "twincat", "fanuc", "excel")
    columns = {
        name: Column(column, factor=1.0 / CURRENT[name[0]] if name.endswith(".u") and amperes else 1.0)
        for name, column in names.items()
    }
    return bind(log, columns)


@pytest.mark.parametrize("kind", [k for k in FORMATS if k != "halsampler"])
def test_every_export_comes_back_in_si(tmp_path: Path, servo: dict[str, np.ndarray], kind: str) -> None:
    log = as_contract(kind, read(write(tmp_path, kind, servo)))
    expected = set(servo) - ({"Y.qr", "A.qr"} if kind in ("json_rows", "json_lines") else set())
    assert expected <= set(log.channels)
    np.testing.assert_allclose(log.t - log.t[0], servo["t"], atol=1e-9 if log.t[0] < 1e9 else 1e-6)
    for name in expected - {"t"}:
        # the file's last digit: 1e-6 mm, 1e-6 deg, or seven significant ones
        np.testing.assert_allclose(log[name], servo[name], rtol=1e-6, atol=1e-6, err_msg=name)


@pytest.mark.parametrize(
    "kind", ["tnc_scope_own", "halscope", "mr_configurator", "daq", "opcua", "mtconnect", "plotjuggler"]
)
def test_new_finds_every_column_of_an_export(tmp_path: Path, servo: dict[str, np.ndarray], kind: str) -> None:
    log = read(write(tmp_path, kind, servo))
    found = guess_columns(log, {"Y": ("Y", False), "A": ("A", True)})
    guessed = {guess.channel: guess.column for guess in found.found}
    expected = {channel: column for channel, column in NAMES[kind].items() if channel not in found.named}
    assert {channel: guessed.get(channel) for channel in expected} == expected
    assert set(servo) <= {*guessed, *found.named}


def test_the_block_above_the_numbers_is_kept(tmp_path: Path, servo: dict[str, np.ndarray]) -> None:
    notes = " ".join(read(write(tmp_path, "tnc_scope", servo)).notes)
    assert "iTNC 530" in notes
    assert "recorded 22.11.2026 14:03:12" in notes
    log = read(write(tmp_path, "sinumerik", servo))
    assert "t: made from the sample time 4 ms above the numbers" in log.notes
    assert log.units == {
        "t": "s",
        "Lagesollwert.Y": "mm",
        "Lageistwert.Y": "mm",
        "Strom-Istwert.Y": "A",
        "Lagesollwert.A": "Grad",
        "Lageistwert.A": "Grad",
        "Strom-Istwert.A": "A",
    }


def test_halsampler_is_read_by_column_and_says_where_samples_were_lost(
    tmp_path: Path, servo: dict[str, np.ndarray]
) -> None:
    path = write(tmp_path, "halsampler", servo)
    rows = path.read_text().splitlines()
    path.write_text("\n".join([*rows[:100], "overrun", *rows[110:]]) + "\n")
    log = read(path)
    assert len(log) == len(servo["t"]) - 10
    np.testing.assert_allclose(log["halsampler[2]"][:100], 1e3 * servo["Y.q"][:100], atol=1e-6)
    assert "1 overrun marks: samples were lost there" in log.notes


def test_a_slower_channel_of_twincat_is_left_out_and_a_faster_one_interpolated(
    tmp_path: Path, servo: dict[str, np.ndarray]
) -> None:
    path = tmp_path / "scope.csv"
    path.write_bytes(twincat(servo, ROTARY, slower=5))
    log = read(path)
    assert "A ActTorque" not in log
    assert len(log) == len(servo["t"])
    assert any("every 20 where the others are every 4: A ActTorque" in note for note in log.notes)

    text = twincat(servo, ROTARY).decode().replace("\t500\t", "\t501\t")  # one stamp of two clocks differs
    path.write_bytes(text.encode())
    assert any("interpolated onto the clock of the others" in note for note in read(path).notes)


def test_real_exports_of_twincat_scope(data_dir: Path) -> None:
    paths = sorted((data_dir / "twincat_scope").glob("*.csv"))
    assert paths
    for path in paths:
        log = read(path)
        assert len(log) == 376
        np.testing.assert_array_equal(log.t, np.arange(376.0))
        assert log.units["t"] == "ms"
        np.testing.assert_array_equal(log["var_INT32"], log.t)
        if "func_OS" in log:  # sampled five times as often
            np.testing.assert_allclose(log["func_OS"][:76], log.t[:76])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Trace of May\nt,q\n0,1\n1,2\n2,3\n", {"t": [0, 1, 2], "q": [1, 2, 3]}),
        ("a title\n\nanother, with a comma\nt;q\n0;1,5\n1;2,5\n", {"t": [0, 1], "q": [1.5, 2.5]}),
        ('sep=,\nt,q\n0,"1,234.5"\n1,"2,000.25"\n', {"q": [1234.5, 2000.25]}),
        ("t;q\n0;1.234,5\n1;2.000,25\n", {"q": [1234.5, 2000.25]}),
        ("t;q [Grad]\n[s];[furlong]\n0;1\n1;2\n", {"t": [0, 1], "q": [1, 2]}),
        ("Samples;3\nOffset;0\n1;2\n3;4\n5;6\n", {"x[0]": [1, 3, 5]}),
        ("time,q\n14:03:12.000,1\n14:03:12.004,2\n", {"time": [0, 0.004], "q": [1, 2]}),
        ("time;q\n22.11.2026 23:59:59,5;1\n23.11.2026 00:00:00,5;2\n", {"time": [0, 1]}),
        ("x;y\n1;2\n3;4\nEOF\n", {"x": [1, 3]}),
        ("Sampling rate: 2 kHz\nq,u\n1,2\n3,4\n", {"t": [0, 0.0005], "q": [1, 3]}),
        ('t,s\n0,"[1.5, 2.5]"\n1,"[3.5, 4.5]"\n', {"s[0]": [1.5, 3.5], "s[1]": [2.5, 4.5]}),
    ],
)
def test_tables_with_something_above_or_inside(
    tmp_path: Path, text: str, expected: dict[str, list[float]]
) -> None:
    path = tmp_path / "x.csv"
    path.write_text(text)
    log = read(path)
    for name, values in expected.items():
        np.testing.assert_allclose(log[name], values, atol=1e-12, err_msg=name)


def test_a_sample_time_without_unit_is_not_used(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text("Sample time;4\nq;u\n1;2\n3;4\n")
    assert list(read(path).channels) == ["q", "u"]


@pytest.mark.parametrize(
    ("written", "factor"),
    [
        ("Grad", np.pi / 180),
        ("[°]", np.pi / 180),
        ("‰", 1e-3),
        ("U/min", 2 * np.pi / 60),
        ("1/min", 2 * np.pi / 60),
        ("mrad/s", 1e-3),
        ("V (Voltage)", 1.0),
        ("MM", 1e-3),
        ("inc", 1.0),
    ],
)
def test_units_as_drives_write_them(written: str, factor: float) -> None:
    unit = find_unit(written)
    assert unit is not None
    assert si_factor(unit) == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize("written", ["(None)", "", "furlong", "NM", "-1"])
def test_what_is_no_unit(written: str) -> None:
    assert find_unit(written) is None


def test_encoder_counts_need_their_size() -> None:
    log = Log({"t": np.arange(3.0), "p": np.arange(3.0)}, "x.csv", units={"p": "inc"})
    with pytest.raises(LogError, match=r"Y\.q is in inc, which has no size of its own; give columns\.Y\.q"):
        bind(log, {"Y.q": Column("p")})
    bound = bind(log, {"Y.q": Column("p", factor=1e-6)})
    np.testing.assert_allclose(bound["Y.q"], [0, 1e-6, 2e-6])


def test_names_of_joint_states_are_those_of_the_contract() -> None:
    log = Log({"t": np.arange(3.0), "/joint_states/elbow/position": np.ones(3), "elbow.effort": np.ones(3)})
    bound = bind(log, {})
    assert set(bound.channels) == {"t", "elbow.q", "elbow.u"}
    assert "elbow.q: taken from /joint_states/elbow/position" in bound.notes
