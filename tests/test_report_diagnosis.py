"""The page of a diagnosis: what it says for each verdict, and that its numbers are the diagnosis'."""

from __future__ import annotations

import base64
import math
from dataclasses import replace

import numpy as np
import pytest

from pinotwin.diagnosis import Diagnosis
from pinotwin.diagnosis.result import Found, Gap, Region, Shrink, Traces
from pinotwin.effects import EFFECTS as KNOWN
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.report import diagnosis_report
from pinotwin.report.diagnosis_plots import bars, where_figure
from pinotwin.report.diagnosis_verdict import headline
from pinotwin.report.plain_words import EFFECTS, region_words
from tests.test_report import figures, read

GAP = Gap(rms=5.0, nrmse=0.2, noise=3.0, after=3.4)
SHRINK = Shrink(before=5.0, after=3.4, share=0.75, interval=(0.5, 0.9375), promised=1.0, on="validation")
SPEED = Region("Y", "u", "velocity", (-0.01, 0.01), "m/s", 0.6, 0.15, 0.01)
TILT = Region("A", "u", "position", (0.0, math.pi / 2), "rad", 0.4, 0.2, 0.03)


def found(effect: str = "quadratic_drag", axis: str = "Y") -> Found:
    other = {"effect": "viscous_thermal", "axis": axis, "probability": 0.07, "why": "<b>little</b>"}
    return Found(
        effect, axis, 0.93, {}, {"b2": 12.0}, {"u": SHRINK}, [other], {"Y.viscous.b": (100.0, 80.0, -4.0)}
    )


def diagnosis(verdict: str = "none", **changes: object) -> Diagnosis:
    t = np.r_[np.arange(0.0, 1.0, 0.01), np.arange(2.0, 3.0, 0.01)]
    trace = Traces("Y", 0, t, np.sin(t), 0.1 * np.sin(t))
    made = Diagnosis(
        verdict=verdict,
        sentence="",
        gap={"Y": {"u": GAP}, "A": {"u": replace(GAP, rms=3.1)}},
        where=[],
        effects=[],
        confusable=[],
        unexplained={},
        remains={},
        noise="repeats",
        advice=[],
        situation="structure",
        shrink={},
        traces=[trace],
        machine="trunnion",
    )
    return replace(made, **changes)


EXPLAINED = diagnosis(
    "explained",
    where=[SPEED, TILT],
    effects=[found()],
    unexplained={"Y": {"u": 0.1}},
    shrink={"Y": {"u": SHRINK}},
    confusable=[["Y.coulomb_asymmetric", "base model"]],
    advice=["to tell quadratic_drag from viscous_thermal on Y: constant speeds"],
    commands={"advice_speeds_Y.csv": {}},
)
PARTLY = replace(EXPLAINED, verdict="partly_explained", remains={"Y": "time-periodic at 7 Hz"})
UNEXPLAINED = diagnosis(
    "unexplained", where=[SPEED], unexplained={"Y": {"u": 1.0}}, remains={"Y": "event-like"}
)


@pytest.mark.parametrize("given", [diagnosis(), EXPLAINED, PARTLY, UNEXPLAINED])
def test_every_verdict_makes_a_whole_page_that_loads_nothing(given: Diagnosis) -> None:
    page = diagnosis_report(given)
    assert all(x.startswith(("#", "data:")) for x in read(page).loaded)
    assert page.index(headline(given).split(",")[0]) < page.index("<table" if given.where else "<ul")
    assert "quadratic_drag" not in page
    assert not any("nan" in cell.split() for row in read(page).rows for cell in row)


def test_the_headline_names_cause_axis_and_share() -> None:
    assert "quadratic drag on axis Y" in headline(EXPLAINED)
    assert "75.0 %" in headline(EXPLAINED)
    assert "a log that it was not fitted to" in headline(EXPLAINED)
    hint = replace(found(), shrink={"u": replace(SHRINK, share=-0.1)})
    assert "removes" not in headline(replace(EXPLAINED, effects=[hint]))
    assert "does not shrink" in headline(replace(EXPLAINED, effects=[hint]))
    assert "agree" in headline(diagnosis())
    assert "axis Y" in headline(UNEXPLAINED)
    assert "none of the causes" in headline(UNEXPLAINED)
    assert "stays without a cause" in headline(PARTLY)
    assert "stays without a cause" not in headline(EXPLAINED)


def test_an_untested_chance_is_not_stated_and_what_confidence_means_is_said() -> None:
    band = Region("Y", "u", "frequency", (0.0, 1.0), "Hz", 0.5, 0.02, None)
    page = diagnosis_report(replace(EXPLAINED, where=[band]))
    (row,) = [r for r in read(page).rows if r and "slow changes, below 1 Hz" in " ".join(r)]
    assert row[-1] == "–"
    assert "this cause was put into what the model leaves anyway" in page


def test_the_bars_turn_shares_of_the_square_into_rms() -> None:
    """Above a noise of 3 a gap of 5 holds 16: a quarter left is 13, a half 17, a sixteenth 10."""
    today, promised, delivered, noise = bars(GAP, SHRINK)
    assert (today.value, delivered.value, noise.value) == (5.0, 3.4, 3.0)
    assert promised.value == pytest.approx(3.0)
    assert delivered.low == pytest.approx(math.sqrt(10.0))
    assert delivered.high == pytest.approx(math.sqrt(17.0))
    assert [b.value for b in bars(GAP, None)] == [5.0, 3.0]


def test_the_map_shows_the_densest_region_of_each_kind() -> None:
    denser = replace(SPEED, range=(0.2, 0.3), share=0.5, time_share=0.05)
    error = replace(SPEED, signal="e", share=0.9)  # another signal, another row
    drawn = where_figure([SPEED, denser, TILT, error], [("Y", "u"), ("A", "u"), ("Y", "e")]).data[0]
    assert list(drawn.y) == ["Y effort", "A effort", "Y error"]
    column = list(drawn.x).index("speed")
    assert drawn.z[0][column] == pytest.approx(1.0)  # ten times denser than even
    assert drawn.z[1][column] is None
    assert drawn.z[1][list(drawn.x).index("position")] == pytest.approx(math.log10(2.0))
    assert "200 to 300 mm/s" in drawn.customdata[0][column]


def test_regions_are_said_in_units_of_the_shop_floor() -> None:
    assert region_words(SPEED) == "around standstill and reversal, slower than 10 mm/s"
    assert region_words(TILT) == "between positions 0 to 90 °"
    other = Region("Y", "u", "other_axis", (0.1, 1.0), "rad/s", 0.5, 0.2, 0.02, "A")
    assert region_words(other) == "while axis A moves"


def test_the_tables_hold_the_numbers_of_the_diagnosis() -> None:
    rows = read(diagnosis_report(EXPLAINED)).rows
    (cause,) = [r for r in rows if r and r[0] == "quadratic drag on axis Y" and len(r) == 7]
    assert cause[1:6] == ["5 N", "3.4 N", "75.0 %", "50% to 94%", "100 %"]
    assert ["Y.viscous.b", "100", "80", "-4"] in rows
    (region,) = [r for r in rows if r and "standstill" in " ".join(r)]
    assert region[3:] == ["60%", "15%", "4.0 ×", "1 %"]


def test_names_are_escaped_and_alternatives_shown() -> None:
    page = diagnosis_report(EXPLAINED)
    assert "<b>little</b>" not in page
    assert "viscous thermal on axis Y (7%): &lt;b&gt;little" in page
    assert "coulomb asymmetric on axis Y and what the model already holds" in page
    assert "advice_speeds_Y.csv" in page


def test_what_stays_is_said() -> None:
    assert "Axis Y: a vibration that repeats in time, at 7 Hz" in diagnosis_report(PARTLY)
    assert "What stays" not in diagnosis_report(EXPLAINED)


def test_no_line_bridges_a_pause_in_the_trace() -> None:
    """Plotly writes single precision as base64; a pause is one NaN between the halves."""
    drawn = [
        f
        for f in figures(diagnosis_report(EXPLAINED))
        if f["layout"].get("xaxis", {}).get("title", {}).get("text") == "time [s]"
    ]
    (figure,) = drawn
    assert [trace["name"] for trace in figure["data"]] == ["model today", "with the cause"]
    y = figure["data"][0]["y"]
    values = np.frombuffer(base64.b64decode(y["bdata"]), dtype=y["dtype"])
    assert np.flatnonzero(np.isnan(values)).tolist() == [100]


def test_with_the_log_the_gap_is_drawn_against_speed_and_position() -> None:
    t = np.arange(0.0, 4.0, 0.002)
    channels = {"t": t}
    machine = Machine.load("trunnion")
    for k, axis in enumerate(machine.axes):
        channels[f"{axis}.q"] = 0.1 * np.sin((2 + k) * t)
        channels[f"{axis}.u"] = np.cos((2 + k) * t)
    page = diagnosis_report(replace(EXPLAINED, subject=machine), Log(channels, source="drill.csv"))
    drawn = [figure["layout"] for figure in figures(page)]
    titles = [layout.get("xaxis", {}).get("title", {}).get("text") for layout in drawn]
    assert "velocity [mm/s]" in titles
    assert "position [mm]" in titles
    assert "drill.csv" in page


def test_every_effect_of_the_yaml_has_plain_words() -> None:
    assert set(KNOWN) <= set(EFFECTS)
    assert all("_" not in words for words in EFFECTS.values())
