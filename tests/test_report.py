"""The report's page: complete, self-contained, honest about what is not known."""

from __future__ import annotations

import base64
import json
import re
import shutil
import zlib
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pytest

from pinotwin.report import Group, Page, Plot, Tabs, identification_report
from pinotwin.report.blocks import notes, paragraph, table
from pinotwin.report.display import number, percent, scale_of
from pinotwin.report.figures import Line, Panel, over_time, visible_rows
from pinotwin.report.parameter_table import parameter_table
from pinotwin.report.verdict import bodies, cautions, headline
from pinotwin.system.templates import asset
from pinotwin.twin import Parameter, Twin
from pinotwin.units import rounded
from tests.test_studies import identified, recorded, trunnion


class Reader(HTMLParser):
    """Collects what a browser would load, the nesting, and the cells of the parameter table."""

    VOID = frozenset({"meta", "link", "br", "img", "input", "hr"})

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.open: list[str] = []
        self.rows: list[list[str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.loaded += [v or "" for k, v in attrs if k in ("src", "href", "data", "action")]
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag == "td" and self.rows:
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "td" in self.open:
            self.rows[-1][-1] += data.replace("\xa0", " ")


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    assert reader.open == []
    return reader


@cache
def report() -> str:
    twin, log = identified()
    return identification_report(twin, log, [recorded(trunnion(), 2, seconds=4.0)])


def figures(page: str) -> list[dict]:
    """Return the figures of a page, their arrays as plotly writes them."""
    found = re.search(r'data-size="(\d+)" data-text="(\d+)">([^<]+)</script>', page)
    if found is None:
        return []
    content = zlib.decompress(base64.b64decode(found[3]), -zlib.MAX_WBITS)
    assert len(content) == int(found[1])

    def whole(value: dict) -> dict:
        if str(value.get("bdata", "")).startswith("@"):
            at, size = map(int, value["bdata"][1:].split())
            rows = np.frombuffer(content[at : at + size], np.uint8).reshape(4, -1)
            value["bdata"] = base64.b64encode(rows.T.tobytes()).decode()
        return value

    return json.loads(content[int(found[2]) :], object_hook=whole)


def test_report_loads_nothing_from_outside() -> None:
    page = report()
    assert all(x.startswith(("#", "data:")) for x in read(page).loaded)
    assert "http://" not in page
    assert "https://" not in page
    assert "@import" not in page
    assert len(page.encode()) < 6e6


def test_report_names_every_axis_and_parameter() -> None:
    twin, _ = identified()
    page = report()
    for name in twin.machine.axes:
        assert f"Axis {name}" in page
    names = [row[0] for row in read(page).rows if row]
    for row in twin.parameters:
        assert any(name.startswith(row.name) for name in names), row.name


def test_parameter_that_is_not_determined_shows_no_number() -> None:
    twin, _ = identified()
    cells = {row[0]: row for row in read(report()).rows if len(row) == 7}
    undetermined = [row for row in twin.parameters if not row.determined]
    assert len(undetermined) >= 5  # axis C stands still
    for row in undetermined:
        shown = next(c for name, c in cells.items() if name.startswith(row.name))
        value, _, interval, relative, before, verdict = shown[1:]
        assert value == "not determined"
        assert not re.search(r"\d", interval + relative + before)
        assert verdict.startswith("not determined")
    known = next(row for row in twin.parameters if row.name == "Y.coulomb.c")
    value = cells["Y.coulomb.c"][1]
    assert float(value) == pytest.approx(known.value, abs=known.error)


def test_values_of_undetermined_parameters_stay_out_of_the_sort_keys() -> None:
    row = Parameter(
        "rigid_body.m_A",
        "rigid_body",
        "linear",
        123.456,
        "kg",
        np.nan,
        False,
        "not determined: nothing in this log excites it",
        prior=123.456,
    )
    assert "123" not in parameter_table([row], ["A"])


def test_plotly_is_packed_once_and_whole() -> None:
    page = report()
    assert page.count('id="plotly-packed"') == 1
    packed = re.search(r'plotly-packed" data-size="(\d+)">([^<]+)</script>', page)
    assert packed is not None
    text = zlib.decompress(base64.b64decode(packed[2]), -zlib.MAX_WBITS)
    assert text.decode() == asset("pinotwin.report", "plotly-basic.min.js")
    assert len(text) == int(packed[1])


def test_an_array_of_several_traces_is_on_the_page_once() -> None:
    x = np.random.default_rng(1).normal(size=500)
    lines = [Line(name, y, "#111") for name, y in {"a": x, "b": x, "c": -x}.items()]
    text = Page("T").section("S", Plot(over_time(np.arange(500.0), [Panel("p", lines)], 300))).html()
    (figure,) = figures(text)
    for trace, y in zip(figure["data"], (x, x, -x), strict=True):
        np.testing.assert_array_equal(decoded(trace["x"]), np.arange(500.0))
        np.testing.assert_allclose(decoded(trace["y"]), y, rtol=1e-5)  # 16 bits
    size = re.search(r'data-text="(\d+)"', text)
    assert size is not None
    assert int(size[1]) == 3 * 4 * 500  # times, x, -x


def decoded(array: dict) -> np.ndarray:
    return np.frombuffer(base64.b64decode(array["bdata"]), dtype=array["dtype"])


def test_plots_of_a_report_cover_the_evidence() -> None:
    found = figures(report())
    names = {trace.get("name") for figure in found for trace in figure["data"]}
    assert {
        "measured",
        "predicted",
        "residual",
        "inertia",
        "coulomb",
        "gravity",
        "ripple",
        "position table",
        "measured minus all other effects",
        "model",
    } <= names
    page = report()
    for title in ("Friction of Y", "Position-dependent effort of Y", "Ripple of A", "Spectrum"):
        assert title in page
    boxes = re.findall(r'data-figure="([^"]+)"', page)
    assert len(boxes) == len(set(boxes)) == len(found)


def test_headline_says_how_good_and_on_what() -> None:
    twin, _ = identified()
    quality = {
        "axes": {
            "Y": {"fit": 0.01, "held_out": {"rms": 2.0, "nrmse": 0.03, "nrmse_std": 0.04}},
            "A": {"fit": 0.2, "held_out": {"rms": 1.0, "nrmse": 0.2, "nrmse_std": 0.456}},
        }
    }
    said = headline(replace(twin, quality=quality))
    assert said == (
        "Cross-validated on the log, the twin predicts the motor effort "
        "very well on Y and poorly on A. The largest error is on A: 45.6 % of its standard "
        "deviation (1 N·m RMS)."
    )
    command = {"use": "coupled", "held_out": {"coupled": 0.08}, "tracking": 0.12}
    assert headline(replace(twin, quality={**quality, "simulation": command})) == (
        f"{said} From the command alone it predicts the effort very well (error 4.0 % of its RMS), the tracking "
        "error fairly (12.0 %). This was judged on the last part of the log."
    )
    quality["axes"]["A"]["validation"] = {"rms": 0.1, "nrmse": 0.02, "nrmse_std": 0.03}
    quality["axes"]["Y"]["validation"] = {"rms": 1.0, "nrmse": 0.02, "nrmse_std": 0.02}
    assert headline(replace(twin, quality=quality)).startswith("On the validation log, the twin")
    assert "not identified from a log" in headline(replace(twin, quality={}))


def test_saved_twin_gives_the_same_report(tmp_path: Path) -> None:
    twin, log = identified()
    quality = {**twin.quality, "condition": float("nan")}
    quality["axes"] = {"Y": {"held_out": {"rms": float("nan")}}, "A": {}}
    loaded = Twin.load(replace(twin, quality=quality).save(tmp_path / "twin"))
    page = identification_report(loaded, log)
    assert "The log is too short to judge the twin" in page
    assert page.count("<tr") == identification_report(twin, log).count("<tr")


def test_cautions_carry_warnings_open_parameters_and_colour() -> None:
    twin, _ = identified()
    quality = {
        "axes": {"Y": {"lag1": 0.9}, "A": {"lag1": 0.0}},
        "warnings": ["mind the gap"],
    }
    lines = cautions(replace(twin, quality=quality))
    assert lines[0] == "mind the gap"
    assert any("parameters are not determined by these data" in line for line in lines)
    assert any(line.startswith("The residual of Y is not white") for line in lines)


def test_bodies_say_whose_their_mass_is_and_what_they_cost() -> None:
    twin, log = identified()
    row = {
        "joint": "Y",
        "mass": 50.04,
        "urdf": 45.0,
        "share": 0.1,
        "source": "log",
        "interval95": [48.04, 52.04],
    }
    rows = (
        row,
        {**row, "joint": "A", "share": 0.9, "source": "URDF", "interval95": None},
        {**row, "joint": "C", "source": "rod", "interval95": None},
    )
    price = {"unseen_over_free": 1.25, "unseen_over_best": 1.01}
    told = replace(twin, bodies=rows, quality={**twin.quality, "consistency": price})
    _, cells, said = bodies(told)
    assert cells[0] == ["Y", "50 ± 2", "45", "0.10", "the log"]
    assert cells[1] == ["A", "50", "45", "0.90", "the URDF"]
    assert cells[2][2:] == ["dummy", "0.10", "nobody: not identified"]
    assert said == [
        "held-out error with these bodies: 1.250 times that of an unconstrained fit",
        "held-out error with these bodies: 1.010 times that at the best URDF weight",
    ]
    page = identification_report(told, log)
    assert all(text in page for text in (*cells[0], *said))
    assert "Bodies" not in identification_report(replace(twin, bodies=()), log)


def test_long_tables_are_folded() -> None:
    rows = [
        Parameter(f"Y.position_table.m{k}", "Y.position_table", "linear", 1.0 + k, "N", 0.1, True, "good")
        for k in range(30)
    ]
    text = parameter_table(rows, ["Y"])
    assert 'class="folded"' in text
    assert "30 coefficients, 30 determined: 1 to 30 N" in text
    assert "Y.position_table.m29" in text


def test_names_from_files_cannot_become_markup() -> None:
    evil = "<script>alert(1)</script>"
    figure = go.Figure(go.Scatter(y=[1.0], name="</script><b>"))
    page = (
        Page(evil, evil)
        .section(
            evil,
            evil,
            notes([evil]),
            table([evil], [[evil]]),
            Tabs({evil: [evil], "b": [Group((Plot(figure, evil, evil),))]}),
        )
        .html()
    )
    assert "<script>alert" not in page
    assert "</script><b>" not in page
    read(page)
    assert figures(page)[0]["data"][0]["name"] == "</script><b>"


def test_page_is_a_value_and_leaves_out_what_is_empty() -> None:
    empty = Page("a")
    assert empty.section("Nothing") == empty
    longer = empty.section("Tables only", table(["x"], [[1]]))
    assert empty.sections == ()
    text = longer.html()
    assert 'id="tables-only"' in text
    assert 'id="plotly-packed"' not in text  # no plot, no script: a small page
    assert len(text) < 40_000
    assert longer.html() == text


def test_a_plain_string_is_the_same_as_a_paragraph() -> None:
    said = "a 90 % interval of <Y>"
    page = Page("p").section("s", said).html()
    assert "<p>a 90\u00a0% interval of &lt;Y&gt;</p>" in page
    assert page == Page("p").section("s", paragraph(said)).html()


@pytest.mark.parametrize("rows", [(5000, 5003), (5003, 5000), (500, 510), (510, 500), (8000, 500)])
def test_a_line_with_times_of_its_own_may_be_longer_or_shorter(rows: tuple[int, int]) -> None:
    t, own = (1e-3 * np.arange(n) for n in rows)
    peak = np.where(np.arange(len(own)) == len(own) - 3, 9.0, np.sin(own))
    lines = [Line("run", peak, "#111", t=own - 0.5), Line("mean", np.sin(t), "#222")]
    run, mean = over_time(t, [Panel("velocity", lines)], 300).data
    assert run.x[[0, -1]] == pytest.approx([-0.5, own[-1] - 0.5], abs=1e-6)
    assert mean.x[-1] == pytest.approx(t[-1], abs=1e-6)
    assert max(run.y) == 9.0


def test_thinning_keeps_the_peaks() -> None:
    x = np.zeros(100_000)
    x[54_321], x[77_777] = 5.0, -3.0
    rows = visible_rows([x, np.arange(100_000.0)], 1000)
    assert {0, 54_321, 77_777, 99_999} <= set(rows.tolist())
    assert len(rows) <= 1010
    np.testing.assert_array_equal(visible_rows([np.zeros(10)], 100), np.arange(10))


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (95.1089, 0.1085, ("95.11", "0.11")),
        (-3.1648, 0.0444, ("-3.165", "0.044")),
        (1.2345e-5, 1.2e-7, ("1.234e-05", "0.012e-05")),
        (2.5e7, 3e5, ("2.500e+07", "0.030e+07")),
        (12.0, 300.0, ("12", "300")),
        (1.5, float("nan"), ("1.5", "")),
    ],
)
def test_numbers_show_two_digits_of_their_error(value: float, error: float, shown: tuple[str, str]) -> None:
    assert rounded(value, error) == shown


def test_units_are_readable() -> None:
    assert scale_of("q", False, 0.3).unit == "mm"
    assert scale_of("q", True, 1.0)(np.array([np.pi])) == pytest.approx([180.0])
    assert scale_of("v", False, 2.0).unit == "m/s"
    assert scale_of("v", False, 0.2)(np.array([0.2])) == pytest.approx([200.0])
    assert scale_of("u", True, 0.02).unit == "mN·m"
    assert scale_of("u", False, 5e4)(np.array([5e4])) == pytest.approx([50.0])
    assert percent(0.0341) == "3.4 %"
    assert percent(0.9973) == "99.7 %"
    assert percent(float("nan")) == "not known"
    assert percent(31.4) == "31.4 times"
    assert number(0.12345, "N") == "0.123 N"


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium on this machine")
def test_plots_are_drawn_in_a_browser(tmp_path: Path) -> None:
    """The page unpacks plotly by itself and draws: a page with a plot differs from one without."""
    Image = pytest.importorskip("PIL.Image")

    from tests.screenshot import screenshot

    path, png = tmp_path / "page.html", tmp_path / "page.png"
    y = np.sin(np.linspace(0, 9, 200))
    figure = go.Figure(go.Scatter(y=y, line={"color": "#ff0000", "width": 8}))
    path.write_text(Page("t").section("s", Plot(figure)).html(), encoding="utf-8")
    screenshot(path, png, (900, 700))
    pixels = np.asarray(Image.open(png).convert("RGB")).astype(int)
    red = (pixels[..., 0] > 230) & (pixels[..., 1] < 60) & (pixels[..., 2] < 60)
    assert red.sum() > 2000
