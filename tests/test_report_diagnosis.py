"""The page of a diagnosis: what it says for each verdict, and that its numbers are the diagnosis'."""

from __future__ import annotations

import base64
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from pinotwin.arrays import plain
from pinotwin.cli.diagnose import cause_lines, gap_lines
from pinotwin.diagnosis import Diagnosis
from pinotwin.diagnosis.conclusion.sizes import times_text, told
from pinotwin.diagnosis.conclusion.where import telling
from pinotwin.diagnosis.grade import printed
from pinotwin.diagnosis.phrases import explanation, region_words
from pinotwin.diagnosis.result import Found, Gap, Region, Shrink, Size, Traces
from pinotwin.effects import EFFECTS as KNOWN
from pinotwin.effects.position import PositionTable
from pinotwin.log import Log
from pinotwin.logs.prepared import Prepared
from pinotwin.loop.servo import Servo
from pinotwin.machine import Machine
from pinotwin.report import diagnosis_report
from pinotwin.report.diagnosis_verdict import headline
from pinotwin.report.display import number, scale_of
from pinotwin.report.first_screen import loudest
from pinotwin.system.phrases import STATES
from pinotwin.viewer.gap import gap_page, mark, shade
from pinotwin.viewer.scene import draw, visual_model
from tests.test_report import figures, read
from tests.test_studies import identified

GAP = Gap(rms=5.0, nrmse=0.2, noise=3.0, after=3.1)
SHRINK = Shrink(before=5.0, after=3.4, share=0.75, interval=(0.5, 0.9375), promised=1.0, on="validation")
SPEED = Region("Y", "u", "velocity", (-0.01, 0.01), "m/s", 0.6, 0.15, 0.01)
TILT = Region("A", "u", "position", (0.0, math.pi / 2), "rad", 0.4, 0.2, 0.03)


def found(effect: str = "quadratic_drag", axis: str = "Y") -> Found:
    other = {"effect": "viscous_thermal", "axis": axis, "probability": 0.07, "why": "<b>little</b>"}
    size = Size(f"{effect}.b2", 0.0, 12.0, "N·s²/m²", (10.0, 14.0))
    return Found(effect, axis, 0.93, {}, {"b2": 12.0}, {"u": SHRINK}, [other], {}, size=[size])


def diagnosis(**changes: object) -> Diagnosis:
    t = np.r_[np.arange(0.0, 1.0, 0.01), np.arange(2.0, 3.0, 0.01)]
    trace = Traces("Y", 0, t, np.sin(t), 0.1 * np.sin(t))
    made = Diagnosis(
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
    where=[SPEED, TILT],
    effects=[found()],
    shrink={"Y": {"u": SHRINK}},
    confusable=[["Y.coulomb_asymmetric", "base model"]],
    advice=["to tell quadratic_drag from viscous_thermal on Y: constant speeds"],
    commands={"advice_speeds_Y.csv": {}},
)
PARTLY = replace(
    EXPLAINED,
    unexplained={"Y": {"u": 0.4}},
    remains={"Y": "swings in time at 7 Hz"},
)
UNEXPLAINED = diagnosis(where=[SPEED], unexplained={"Y": {"u": 1.0}}, remains={"Y": "event-like"})


@pytest.mark.parametrize("given", [diagnosis(), EXPLAINED, PARTLY, UNEXPLAINED])
def test_every_verdict_makes_a_whole_page_that_loads_nothing(given: Diagnosis) -> None:
    page = diagnosis_report(given)
    assert all(x.startswith(("#", "data:")) for x in read(page).loaded)
    assert page.index(headline(given)[0].split(" (")[0]) < page.index("<table" if given.where else "<ul")
    assert "quadratic_drag" not in page
    assert not any("nan" in cell.split() for row in read(page).rows for cell in row)


def test_the_headline_names_cause_axis_size_and_data() -> None:
    first = headline(EXPLAINED)[0]
    assert (
        "Y: quadratic drag is missing from the model: drag coefficient 12 N·s²/m² (90 %: 10 to 14)." in first
    )
    assert "the residual falls from 5 to 3.4 N RMS (validated on the log)" in first
    logs = [{"source": "/a/b/new.csv", "role": "validation"}, {"source": "old.csv", "role": "diagnosed"}]
    assert "validated on new.csv" in headline(replace(EXPLAINED, provenance={"logs": logs}))[0]
    hint = replace(found(), shrink={"u": replace(SHRINK, share=-0.1)})
    assert "does not reduce the residual" in headline(replace(EXPLAINED, effects=[hint]))[0]
    assert headline(replace(EXPLAINED, situation="change"))[0].startswith(
        "Y: quadratic drag appeared: drag coefficient 12 "
    )
    assert "no missing effect found" in headline(diagnosis())[0]
    assert "no change found" in headline(replace(diagnosis(), situation="change"))[0]
    assert "axis Y, and no known effect" in headline(UNEXPLAINED)[0]
    assert any("remain unexplained" in line for line in headline(PARTLY))
    assert not any("remain unexplained" in line for line in headline(EXPLAINED))


def test_a_tracking_error_without_a_cause_is_told_only_where_no_cause_is_named() -> None:
    own = Gap(rms=1.0, nrmse=0.1, noise=0.5, after=1.0, misfit=1.0)
    off = Gap(rms=9e-6, nrmse=0.1, noise=math.nan, after=9e-6, misfit=1e-6)
    gap = {axis: {"u": own, "e": off} for axis in ("Y", "A")}
    limited = replace(found("saturation", "A"), shrink={})
    said = headline(diagnosis(gap=gap, effects=[limited], situation="change"))
    assert any(line.startswith("The tracking error of Y is predicted worse") for line in said)


def test_one_grade_in_card_plot_text_and_json() -> None:
    for given in (diagnosis(), EXPLAINED, PARTLY, UNEXPLAINED):
        page = diagnosis_report(given)
        for axis, row in given.gap.items():
            word = given.grade(axis, "u")
            assert given.to_dict()["gap"][axis]["u"]["grade"] == word
            card = page[page.index(f"<h3>Axis {axis} ") :]
            state = STATES[given.situation][given.state(axis)]
            assert card.index(f">{state}</span>") < card.index("</h3>")
            note = card[card.index('<div class="note"') :]
            assert note[note.index(">") + 1 :].startswith(f"{printed(word)} · ")
            assert given.to_dict()["state"][axis] == given.state(axis)
            assert any(
                line.startswith(f"{axis}.u") and line.endswith(printed(word))
                for line in gap_lines(replace(given, gap={axis: row}))
            )


def test_a_gap_that_the_verdict_leaves_open_is_never_graded_as_explained() -> None:
    assert EXPLAINED.grade("Y") == "gap explained"
    assert PARTLY.grade("Y") == "partly explained"
    assert UNEXPLAINED.grade("Y") == "not explained"
    tiny = replace(GAP, rms=3.1, after=0.1)
    pattern = replace(UNEXPLAINED, gap={"Y": {"u": tiny}})  # nothing is named: a pattern closes it
    assert pattern.grade("Y") == "not explained"


def test_words_of_the_old_pages_are_gone() -> None:
    """Axis Y "agrees" beside "no gap beyond the noise that a cause could close", at 18 times the noise."""
    gap = {"Y": {"u": Gap(4.49, 0.08, 0.248, 4.49)}, "A": {"u": Gap(0.135, 0.1, 0.0086, 0.0748)}}
    given = replace(EXPLAINED, gap=gap, effects=[found("ripple", "A")], unexplained={}, shrink={})
    page = diagnosis_report(given)
    assert given.grade("Y") == "not judged"
    assert given.grade("A") == "partly explained"
    assert ">agrees</span>" not in page
    assert "No gap beyond the noise" not in page
    assert any("0.0748 of 0.135" in line for line in headline(replace(given, subject=None)))


def test_a_tracking_error_that_differs_is_spoken_of_although_nothing_changed() -> None:
    error = Gap(7e-6, 0.1, 0.0, 7e-6, 1e-6)
    given = replace(diagnosis(), gap={"Y": {"u": replace(GAP, rms=3.1), "e": error}}, situation="change")
    assert given.grade("Y", "e") == "not explained"
    assert "tracking error of Y" in headline(given)[-1]


def test_an_untested_chance_is_not_stated_and_what_confidence_means_is_said() -> None:
    band = Region("Y", "u", "frequency", (0.0, 1.0), "Hz", 0.5, 0.02, None)
    page = diagnosis_report(replace(EXPLAINED, where=[band]))
    (row,) = [r for r in read(page).rows if r and "slow changes, below 1 Hz" in " ".join(r)]
    assert row[-1] == "–"
    assert "when it is injected into the residual" in page


def test_regions_of_the_cause_come_first_and_slow_changes_last() -> None:
    slow = Region("Y", "u", "frequency", (0.0, 1.0), "Hz", 0.99, 0.01, None)
    other = replace(TILT, share=0.99)
    assert telling([slow, other, SPEED], ["Y"]) == [SPEED, slow, other]


def test_regions_are_said_in_units_of_the_shop_floor() -> None:
    assert region_words(SPEED) == "around standstill and reversal, slower than 10 mm/s"
    assert region_words(TILT) == "between positions 0 to 90 °"
    other = Region("Y", "u", "other_axis", (0.1, 1.0), "rad/s", 0.5, 0.2, 0.02, "A")
    assert region_words(other) == "while axis A moves"


def test_the_tables_hold_the_numbers_of_the_diagnosis() -> None:
    rows = read(diagnosis_report(EXPLAINED)).rows
    (cause,) = [r for r in rows if r and r[0] == "quadratic drag on axis Y, motor effort"]
    assert cause[1:6] == ["5 N", "3.4 N", "75.0 %", "50 to 94 %", "100 %"]
    (size,) = [r for r in rows if r and r[0] == "quadratic drag on axis Y" and len(r) == 7]
    assert size[1:] == ["drag coefficient", "none", "12 N·s²/m²", "10 to 14", "", "93 %"]
    (region,) = [r for r in rows if r and "standstill" in " ".join(r)]
    assert region[3:] == [" 60 % in 15 %", "4 ×", "1 %"]


def test_many_numbers_become_a_few() -> None:
    waves = [Size("ripple.a1", 0.0, 3.0, "N", (2.9, 3.1)), Size("ripple.b1", 0.0, 4.0, "N", (3.9, 4.1))]
    (one,) = told(waves)
    assert (one.name, one.after) == ("ripple.amplitude", 5.0)
    assert one.interval == pytest.approx((4.9, 5.1))
    points = [
        Size(f"position_table.m{k}", 0.0, float(x), "N", (x - 1.0, x + 1.0)) for k, x in enumerate(range(9))
    ]
    assert [(s.name, s.after) for s in told(points)] == [
        ("position_table.highest of 9 points", 8.0),
        ("position_table.lowest of 9 points", 0.0),
    ]
    assert times_text(Size("viscous.b", 51.2, 297.0, "N·s/m", (290.0, 300.0))) == "× 5.8"
    assert times_text(Size("coulomb.c", 1.0, 1.996, "N·m", (1.9, 2.1))) == "+100 %"
    assert times_text(Size("viscous.b", 100.0, 80.0, "N·s/m", (70.0, 90.0))) == "-20 %"


def test_an_effort_that_had_no_limit_is_told_as_none_and_the_json_is_strict() -> None:
    limit = Size("saturation.limit", math.inf, 3.2, "N·m", (3.1, math.inf))
    limited = diagnosis(effects=[replace(found("saturation", "A"), size=[limit])])
    (line,) = [x for x in cause_lines(limited) if "limit none" in x]
    assert line.split("limit ")[1] == "none -> 3.2 N·m (90 %: 3.1 and more)"
    page = diagnosis_report(limited)
    rows = read(page).rows
    assert ["none", "3.2 N·m", "3.1 and more"] in [row[2:5] for row in rows]
    assert not any("inf" in cell.split() for row in rows for cell in row)
    text = json.dumps(plain(limited.to_dict()), allow_nan=False)
    assert json.loads(text)["effects"][0]["size"]["before"] is None


def test_names_are_escaped_and_alternatives_shown() -> None:
    page = diagnosis_report(EXPLAINED)
    assert "<b>little</b>" not in page
    assert "warming on axis Y (7\u00a0%): &lt;b&gt;little" in page
    assert "dry friction by direction on axis Y and the reference model" in page
    assert "advice_speeds_Y.csv" in page


def test_what_stays_is_said_in_a_sentence() -> None:
    stays = replace(PARTLY, remains={"Y": "looks like friction that changes along the stroke"})
    assert "It looks like friction that changes along the stroke." in diagnosis_report(stays)


def test_the_page_says_what_it_rests_on_and_links_what_lies_beside_it() -> None:
    log = {"source": "new.csv", "role": "diagnosed", "rows": 5, "seconds": 3.0, "sha256": "ab" * 32}
    given = {
        "version": "1.2",
        "date": "2026-01-02",
        "seconds_taken": 41.0,
        "options": {"seed": 3},
        "logs": [log],
    }
    page = diagnosis_report(replace(EXPLAINED, provenance=given), files=[("machine.html", "3-D")])
    for said in ("1.2", "2026-01-02", "41 s", "<dt>seed</dt><dd>3</dd>", "abab", 'href="machine.html"'):
        assert said in page


def test_no_line_bridges_a_pause_in_the_trace() -> None:
    """Plotly writes single precision as base64; a pause is one NaN between the halves."""
    drawn = [
        f
        for f in figures(diagnosis_report(EXPLAINED))
        if f["layout"].get("xaxis", {}).get("title", {}).get("text") == "time [s]"
    ]
    (figure,) = drawn
    assert [trace["name"] for trace in figure["data"]] == ["without the cause", "with the cause"]
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
    ready = Prepared(machine, Log(channels, source="drill.csv"))
    page = diagnosis_report(replace(EXPLAINED, subject=machine, prepared=[ready]))
    drawn = [figure["layout"] for figure in figures(page)]
    titles = [layout.get("xaxis", {}).get("title", {}).get("text") for layout in drawn]
    assert "velocity [mm/s]" in titles
    assert "position [mm]" in titles
    assert "drill.csv" in page


def test_every_effect_of_the_yaml_has_plain_words() -> None:
    assert all(explanation(name) and "_" not in explanation(name) for name in KNOWN)


def test_the_machine_page_is_the_same_from_run_to_run_and_says_the_grades() -> None:
    t = np.arange(0.0, 2.0, 0.002)
    channels = {"t": t}
    machine = Machine.load("trunnion")
    for k, axis in enumerate(machine.axes):
        channels |= {f"{axis}.q": 0.1 * np.sin((2 + k) * t), f"{axis}.u": np.cos((2 + k) * t)}
    given = replace(EXPLAINED, subject=machine, prepared=[Prepared(machine, Log(channels))])
    pages = [gap_page(given, machine) for _ in range(2)]
    assert pages[0] == pages[1]
    assert "Y unlike its model" in pages[0]


def test_numbers_read_as_people_write_them() -> None:
    assert number(1970.0, "N") == "1970 N"
    assert scale_of("e", False, 1.97e-3).text(1.97e-3) == "1.97 mm"
    assert {scale_of(signal, True, 1e-5).unit for signal in ("q", "ql", "e")} == {"mdeg"}


def test_an_event_says_when() -> None:
    push = replace(found("external_force"), size=[Size("largest disturbance", 0.0, 5.0, "N", (4.0, 6.0))])
    time = Region("Y", "u", "time", (4.1, 4.9), "s", 0.6, 0.06, 0.01)
    first = headline(replace(EXPLAINED, effects=[push], where=[time], situation="change"))[0]
    assert (
        "external force appeared: largest disturbance 5 N (90 %: 4 to 6), 4.1 to 4.9 s into the log." in first
    )
    assert "into the log" not in headline(replace(EXPLAINED, where=[time]))[0]


def test_the_picture_shows_the_stretch_where_the_difference_is_largest() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    one = Traces("Y", 0, t, np.where((t > 6.0) & (t < 6.5), 5.0, 0.1), 0.0 * t)
    rows = loudest(one)
    assert rows.stop - rows.start == 100
    assert t[rows][0] <= 6.0 < 6.48 <= t[rows][-1]
    pause = replace(one, t=t + 3.0 * (t > 6.25))  # of rows that are not judged
    assert np.ptp(pause.t[loudest(pause)]) < 1.0


def test_the_machine_page_shows_where_a_defect_is_and_which_way_a_force_acts() -> None:
    machine, t = Machine.load("trunnion"), np.arange(0.0, 2.0, 0.002)
    log = Log({"t": t} | {f"{a}.{x}": np.sin(2.0 * t) for a in machine.axes for x in "qu"})
    push = replace(found("external_force"), size=[Size("largest disturbance", 0.0, -5.0, "N", (-6.0, -4.0))])
    table = PositionTable("A", rotary=True, spacing=0.1, start=0.0, stop=0.4)
    heights = [Size(f"position_table.m{k}", 0.0, x, "N·m", (x, x)) for k, x in enumerate((0, 1, -3, 1, 0))]
    tooth = replace(found("position_table", "A"), listed=table, size=heights)
    drawn = draw(machine.model, visual_model(machine.model, machine.urdf, ()))
    mark(drawn, replace(EXPLAINED, effects=[push, tooth]), machine)
    paths = {path for _, path, _ in drawn.page.messages}
    assert any(path.endswith("Y/arrow/head") for path in paths)
    assert any(path.endswith("place A") for path in paths)
    assert shade(EXPLAINED, "Y") != shade(EXPLAINED, "A")
    pushed = replace(EXPLAINED, subject=machine, effects=[push], prepared=[Prepared(machine, log)])
    assert len(gap_page(pushed, machine)) > 1e5


def test_a_position_gain_is_told_old_and_new() -> None:
    twin, _ = identified()
    servo = Servo.of_cascade(kp=20.0, kv=5000.0, rate=10.0, ffv=1.0, ffa=0.0)
    given = replace(EXPLAINED, subject=replace(twin, servos={"Y": servo}), situation="change")
    factor = Size("position_gain.factor", 1.0, 0.6, "-", (0.58, 0.62))
    first = headline(replace(given, effects=[replace(found("position_gain"), size=[factor])]))[0]
    assert "position gain fell to 0.6 times its value (90 %: 0.58 to 0.62), from 20 to 12 1/s." in first
