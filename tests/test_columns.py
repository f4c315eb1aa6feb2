"""Column mapping: from a controller's names and units to SI, and every mistake in it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pinotwin.columns import Column, bind, is_contract_name
from pinotwin.errors import LogError, MachineError
from pinotwin.log import Log
from pinotwin.machine.sections import parse_columns
from pinotwin.units import SI_FACTOR, UNUSED


def raw_log(**more: object) -> Log:
    channels = {"Time": [0.0, 4.0, 8.0], "Y_ActPos": [0.0, 10.0, 30.0], "Y_Cur": [1.0, -1.0, 2.0]}
    return Log(channels, "run.csv", {"gtau": 35.0}, **more)  # type: ignore[arg-type]


def test_units_factor_offset_and_scalars() -> None:
    columns = parse_columns(
        {
            "t": {"column": "Time", "unit": "ms"},
            "Y.q": {"column": "Y_ActPos", "unit": "mm", "factor": -1, "offset": 0.5},
            "Y.u": {"column": "Y_Cur", "unit": "A", "factor": "gtau"},
        }
    )
    log = bind(raw_log(), columns)
    np.testing.assert_allclose(log.t, [0.0, 0.004, 0.008])
    np.testing.assert_allclose(log["Y.q"], [0.5, 0.49, 0.47])
    np.testing.assert_allclose(log["Y.u"], [35.0, -35.0, 70.0])
    np.testing.assert_allclose(log.raw("Y.q"), [0.0, 10.0, 30.0], atol=1e-12)
    assert log.units == {"t": "ms", "Y.q": "mm", "Y.u": "A"}


@settings(max_examples=40, deadline=None)
@given(
    unit=st.sampled_from(sorted(SI_FACTOR.keys() - UNUSED.keys())),  # those are dropped
    factor=st.floats(1e-3, 1e3),
    offset=st.floats(-10, 10),
)
def test_raw_undoes_the_scaling(unit: str, factor: float, offset: float) -> None:
    x = np.array([0.0, 1.0, -3.0, 250.0])
    log = bind(Log({"x": x}), {"Y.q": Column("x", unit, factor, offset)})
    tolerance = 1e-12 * (1 + abs(offset) / (SI_FACTOR[unit] * factor))
    np.testing.assert_allclose(log.raw("Y.q"), x, rtol=1e-9, atol=1e3 * tolerance)


def test_a_counter_that_wraps_is_unwrapped_and_its_command_goes_along() -> None:
    true = np.cumsum(np.linspace(-20.0, 35.0, 200)) + 350.0  # [deg], both ways, several turns
    q, qr = np.mod(true, 360.0), np.mod(true + 12.0, 360.0)  # the command starts beyond the wrap
    q[50] = np.nan
    entry = {"column": "A_pos", "unit": "deg", "wrap": 360, "factor": -1, "offset": 0.1}
    columns = parse_columns({"A.q": entry, "A.qr": {**entry, "column": "A_set"}})
    log = bind(Log({"A_pos": q, "A_set": qr}), columns)
    good = np.isfinite(q)
    np.testing.assert_allclose(log["A.q"][good], 0.1 - np.radians(true[good]), atol=1e-9)
    np.testing.assert_allclose(log["A.qr"], 0.1 - np.radians(true + 12.0), atol=1e-9)
    assert np.isnan(log["A.q"][50])
    assert any(note.startswith("A.q: unwrapped") and note.endswith("times by 360 deg") for note in log.notes)
    np.testing.assert_allclose(log.raw("A.q")[good], true[good], atol=1e-7)


def test_a_rate_makes_the_clock() -> None:
    log = bind(raw_log(), parse_columns({"t": {"rate": 5000}, "Y.q": "Y_ActPos"}))
    np.testing.assert_allclose(log.t, [0.0, 2e-4, 4e-4])
    assert "t: made from the rate 5000 Hz, not recorded" in log.notes


def test_names_of_the_contract_pass_as_si() -> None:
    log = bind(Log({"t": [0, 1], "Y.q": [1, 2], "C_link.fx": [3, 4], "gx": [5, 6], "Zeit": [0, 0]}), {})
    assert list(log.channels) == ["t", "Y.q", "C_link.fx", "gx"]
    np.testing.assert_array_equal(log["Y.q"], [1.0, 2.0])
    assert log.notes == ("not mapped and left out: Zeit",)


def test_stated_units_are_applied_and_said() -> None:
    log = bind(Log({"t": [0, 1], "Y.q": [1, 2]}, units={"Y.q": "mm"}), {})
    np.testing.assert_allclose(log["Y.q"], [0.001, 0.002])
    assert log.notes == ("Y.q: the file states mm, converted to SI",)


def test_the_mapping_outweighs_the_file_and_says_so() -> None:
    log = raw_log(units={"Y_ActPos": "m"})
    bound = bind(log, {"Y.q": Column("Y_ActPos", "mm")})
    np.testing.assert_allclose(bound["Y.q"], [0.0, 0.01, 0.03])
    assert "Y.q: the mapping says mm, the file says m; the mapping was followed" in bound.notes


def test_the_stated_unit_serves_where_the_mapping_has_none() -> None:
    bound = bind(raw_log(units={"Y_ActPos": "mm"}), {"Y.q": Column("Y_ActPos")})
    np.testing.assert_allclose(bound["Y.q"], [0.0, 0.01, 0.03])


def test_headers_may_be_written_with_their_unit() -> None:
    bound = bind(raw_log(units={"Time": "ms"}), parse_columns({"t": "Time (ms)"}))
    np.testing.assert_allclose(bound.t, [0.0, 0.004, 0.008])


def test_columns_by_index_whatever_the_file_is_called() -> None:
    log = Log({"run_a[0]": [0.0, 1.0], "run_a[1]": [5.0, 6.0]}, "run_a.npy")
    bound = bind(log, parse_columns({"t": {"column": 0}, "M.q": "[1]"}))
    np.testing.assert_array_equal(bound["M.q"], [5.0, 6.0])


def test_a_bound_log_and_a_log_in_si_need_no_mapping() -> None:
    columns = parse_columns({"t": {"rate": 10}, "Y.q": {"column": "Y_ActPos", "unit": "mm"}})
    bound = bind(raw_log(), columns)
    assert bind(bound, columns) is bound
    own = Log({"t": [0.0, 0.5], "Y.q": [1.0, 2.0]})
    again = bind(own, columns)
    np.testing.assert_array_equal(again.t, [0.0, 0.5])
    np.testing.assert_array_equal(again["Y.q"], [1.0, 2.0])


def test_contract_names() -> None:
    for name in ("t", "Y.q", "A.qr", "j.1.u", "tool.fx", "gx", "az", "Y.temperature"):
        assert is_contract_name(name)
    for name in ("q", "Y", "Y.pos", "fx", "time"):
        assert not is_contract_name(name)


_KEYS = "known: column, factor, found, kd, kp, law, offset, rate, unit, wrap"
_SIGNALS = "known: a, e, fx, fy, fz, mx, my, mz, q, ql, qr, temperature, u, v"

BAD_MAPPINGS: list[tuple[object, str]] = [
    ([1], "columns: expected keys and values, found [1]"),
    (
        {"Y.q": {"colum": "x"}},
        f"columns.Y.q.colum: unknown key; did you mean 'column'? {_KEYS}",
    ),
    ({"Y.q": 3.5}, "columns.Y.q: expected a column's name or keys and values, found 3.5"),
    ({"Y.q": {}}, "columns.Y.q: has no column; add column: <name in the log>"),
    ({"Y.q": {"column": [1]}}, "columns.Y.q.column: expected text, found [1]"),
    ({"Y.qq": "x"}, f"columns.Y.qq: no such signal; did you mean 'q'? {_SIGNALS}"),
    (
        {"Y.q": {"column": "x", "factor": True}},
        "columns.Y.q.factor: expected a number, or the name of one in the log, found True",
    ),
    (
        {"Y.q": {"column": "x", "offset": math.nan}},
        "columns.Y.q.offset: expected a number, found nan",
    ),
    (
        {"Y.q": {"column": "x", "factor": 0}},
        "columns.Y.q.factor is 0, which erases the channel; correct it",
    ),
    (
        {"Y.q": {"column": "x", "rate": 10}},
        "columns.Y.q.rate: only t may have a rate, above 0 Hz and instead of a column",
    ),
    (
        {"Y.u": {"column": "x", "wrap": 360}},
        "columns.Y.u.wrap: only q, qr and ql may wrap, after a range above 0",
    ),
    (
        {"Y.q": {"column": "x", "wrap": -360}},
        "columns.Y.q.wrap: only q, qr and ql may wrap, after a range above 0",
    ),
    (
        {"t": {"rate": -1}},
        "columns.t.rate: only t may have a rate, above 0 Hz and instead of a column",
    ),
]


@pytest.mark.parametrize(("mapping", "message"), BAD_MAPPINGS, ids=[m for _, m in BAD_MAPPINGS])
def test_mistakes_in_the_mapping(mapping: object, message: str) -> None:
    with pytest.raises(MachineError) as caught:
        parse_columns(mapping)  # type: ignore[arg-type]
    assert str(caught.value) == message


def test_an_unknown_unit_names_the_nearest() -> None:
    with pytest.raises(MachineError, match=r"columns\.Y\.q\.unit: unknown unit 'mmm'; did you mean 'mm'"):
        parse_columns({"Y.q": {"column": "x", "unit": "mmm"}})


BAD_BINDINGS: list[tuple[dict[str, object], str]] = [
    (
        {"Y.q": "Y_ActPoss"},
        "run.csv: Y.q: no column 'Y_ActPoss'; did you mean 'Y_ActPos'? known: Time, Y_ActPos, Y_Cur",
    ),
    (
        {"Y.u": {"column": "Y_Cur", "factor": "gtua"}},
        "run.csv: Y.u: no scalar 'gtua' for factor; did you mean 'gtau'? known: gtau",
    ),
    (
        {},
        "run.csv: no channel has a name of the contract (t, <axis>.q, <axis>.u...) and no columns "
        "are mapped; map them under `columns` in machine.yaml; channels: Time, Y_ActPos, Y_Cur",
    ),
    (
        {"Y.q": "[1]"},
        "run.csv: Y.q: no column '[1]'; known: Time, Y_ActPos, Y_Cur",
    ),
]


@pytest.mark.parametrize(("mapping", "message"), BAD_BINDINGS, ids=[m for _, m in BAD_BINDINGS])
def test_mistakes_between_mapping_and_log(mapping: dict[str, object], message: str) -> None:
    with pytest.raises(LogError) as caught:
        bind(raw_log(), parse_columns(mapping))
    assert str(caught.value) == message


def test_an_ambiguous_index_is_refused() -> None:
    log = Log({"a[0]": [0.0, 1.0], "b[0]": [0.0, 1.0]}, "a+b")
    with pytest.raises(LogError, match=r"a\+b: t: \[0\] could be any of a\[0\], b\[0\]; name one"):
        bind(log, {"t": Column("[0]")})


def test_a_unit_of_the_file_that_nobody_knows() -> None:
    log = Log({"Y.q": [0.0, 1.0]}, "x.h5", units={"Y.q": "furlong"})
    with pytest.raises(LogError, match=r"x\.h5: Y\.q: unknown unit 'furlong'.*; set unit in machine"):
        bind(log, {})


def test_what_is_optional_is_left_out_where_the_file_lacks_it_or_its_size() -> None:
    mapping = {
        "Y.q": Column("Y_ActPos"),
        "Y.qr": Column("Y_NomPos"),
        "Y.u": Column("Y_Cur", factor="ktau"),
    }
    found = bind(raw_log(), mapping, optional=mapping)
    assert list(found.channels) == ["Y.q"]
    for name in ("Y.qr", "Y.u"):
        with pytest.raises(LogError, match=name):
            bind(raw_log(), mapping, optional=mapping.keys() - {name})


def test_of_many_channels_only_the_nearest_are_listed() -> None:
    log = Log({f"rec.pos_{i}": [0.0, 1.0] for i in range(40)}, "x.mat")
    with pytest.raises(LogError) as caught:
        bind(log, {"Y.q": Column("rec.pos_77")})
    assert str(caught.value).startswith("x.mat: Y.q: no column 'rec.pos_77'; did you mean 'rec.pos_")
    assert len(str(caught.value)) < 150
