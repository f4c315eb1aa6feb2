"""Scores against answers made by hand, closed forms and published tables."""

from __future__ import annotations

import dataclasses
import json

import msgspec
import numpy as np
import pytest

from benchmarks.floors import beaten, floor_scores
from pinotwin.arrays import plain
from pinotwin.bench.answers import Answer, same_class
from pinotwin.bench.scoring import Bound, rows
from pinotwin.bench.statistics import Share, calibration
from pinotwin.bench.table import document, markdown, measured
from pinotwin.report.blind import bench_page

STRIBECK, DELAY = ("stribeck", "X"), ("delay", "X")


def made(kind="single", truth=(STRIBECK,), named=(), rho=1.0, verdict="explained", **more):
    count = len(truth)
    sizes = rho if isinstance(rho, tuple) else (rho,) * count
    return Answer(
        0,
        "m",
        "structure",
        kind,
        truth,
        sizes,
        verdict,
        named=tuple((*n, 0.8) for n in named),
        stated=tuple(named[:1]),
        **more,
    )


def figures(answers):
    return {r.name: r for r in rows(answers)}


def healthy(named=(), verdict=None, **more):
    return made("healthy", (), named, verdict=verdict or ("explained" if named else "none"), **more)


def test_clopper_pearson_is_that_of_the_tables():
    # METHODS A5: at most 2 alarms in 150 healthy machines for an upper bound below 5 %.
    assert Share(2, 150).upper() == pytest.approx(0.0414, abs=1e-4)
    assert Share(0, 100).upper() == pytest.approx(1.0 - 0.05 ** (1 / 100), rel=1e-9)
    assert Share(5, 5).upper() == 1.0
    assert Share(0, 0).value is None


def test_calibration_error_and_brier_score():
    stated = np.repeat([0.55, 0.95], 50)
    right = np.concatenate([np.arange(50) < 20, np.arange(50) < 48])
    found = calibration(stated, right, bins=2)
    assert found.error == pytest.approx(0.5 * (0.15 + 0.01))
    assert found.brier == pytest.approx(np.mean((stated - right) ** 2))
    assert [b[2] for b in found.bins] == [50, 50]
    honest = np.random.default_rng(0)
    p = honest.uniform(0.3, 1.0, 20_000)
    assert calibration(p, honest.uniform(size=len(p)) < p).error < 0.015
    assert calibration([0.5] * 9, [True] * 9) is None


def test_a_healthy_machine_is_accused_by_any_verdict_but_none():
    f = figures([healthy(), healthy((DELAY,)), healthy(verdict="unexplained"), healthy()])
    assert f["healthy machine accused of anything"].share == Share(2, 4)
    assert f["… an effect named"].share == Share(1, 4)
    assert f["healthy machine accused of anything"].state == "below"


def test_top_one_counts_effect_and_axis_by_size():
    other_axis = ("stribeck", "Y")
    f = figures(
        [
            made(named=(STRIBECK,)),
            made(named=(DELAY, STRIBECK)),
            made(named=(other_axis,)),
            made(named=(), verdict="none"),
            made(named=(STRIBECK,), rho=0.05),
            made(named=(), rho=0.05, verdict="none"),
            made(named=(), rho=0.001, verdict="none"),
            made("form", named=(STRIBECK,)),
        ]
    )
    assert f["top-1 effect and axis, rho ≥ 0.1"].share == Share(1, 4)
    assert f["… among the first two"].share == Share(2, 4)
    assert f["… axis right"].share == Share(2, 3)
    assert f["top-1, 0.02 ≤ rho < 0.1"].share == Share(1, 2)
    assert f["top-1, rho ≥ 0.1, another functional form"].share == Share(1, 1)
    assert f["known called none"].share == Share(1, 4)


def test_classes_merge_by_physics_and_by_what_is_stated_and_never_in_the_strict_row():
    bend = made(truth=(("joint_flexibility", "X"),), named=(("drive_flexibility", "X"),))
    load = made(truth=(("payload", "A"),), named=(("payload", "C"),))
    stated = made(named=(DELAY,), confusable=(("X.delay", "X.stribeck"),))
    elsewhere = made(named=(("delay", "Y"),), confusable=(("Y.delay", "X.stribeck"),))
    plain_wrong = made(named=(DELAY,))
    f = figures([bend, load, stated, elsewhere, plain_wrong])
    assert [a.right() for a in (bend, load, stated, elsewhere, plain_wrong)] == [
        True,
        True,
        True,
        False,
        False,
    ]
    assert f["… unmerged, rho ≥ 0.1"].share == Share(0, 5)
    assert not same_class(("drive_flexibility", "Y"), ("joint_flexibility", "X"))


def test_doubles_need_both_and_only_where_the_weaker_shows():
    both = (STRIBECK, DELAY)
    f = figures(
        [
            made("double", both, (DELAY, STRIBECK)),
            made("double", both, (DELAY,)),
            made("double", both, (), rho=(5.0, 0.01)),
            made(named=(STRIBECK, DELAY)),
            made(named=(STRIBECK,)),
        ]
    )
    assert f["both of two, weaker rho ≥ 0.1"].share == Share(1, 2)
    assert f["… at least one of them"].share == Share(2, 2)
    assert f["a spurious extra effect beside the right one"].share == Share(1, 2)


def test_outside_the_catalogue_and_known_use_the_same_yardstick():
    mains = (("mains", "X"),)
    f = figures(
        [
            made("outside", mains, verdict="unexplained"),
            made("outside", mains, (DELAY,)),
            made("left_out", (DELAY,), (STRIBECK,), verdict="partly_explained"),
            made(named=(STRIBECK,), verdict="partly_explained"),
            made(verdict="unexplained"),
            made(named=(STRIBECK,)),
        ]
    )
    assert f["outside the catalogue recognised"].share == Share(2, 3)
    assert f["known called unknown"].share == Share(2, 3)


def test_whatever_is_named_for_what_nobody_knows_counts_against_the_confidence():
    right = [made(named=(STRIBECK,)) for _ in range(8)]
    wrong = [healthy((DELAY,)), made("outside", (DELAY,), (DELAY,))]
    f = figures([*right, *wrong])
    assert f["expected calibration error"].value == pytest.approx(0.2 * 0.8 + 0.8 * 0.2)
    assert f["Brier score"].value == pytest.approx(0.8 * 0.04 + 0.2 * 0.64)


def test_shrink_promised_and_delivered():
    def shrunk(delivered, promised, interval, **more):
        return made(
            named=(STRIBECK,),
            shrink={
                "signal": "u",
                "delivered": delivered,
                "promised": promised,
                "interval": interval,
                "on": "validation",
            },
            **more,
        )

    f = figures(
        [
            shrunk(0.9, 0.95, [0.8, 0.96]),
            shrunk(0.8, 0.99, [0.7, 0.9]),
            shrunk(0.97, 0.97, [0.98, 1.0]),
            shrunk(0.2, 0.3, [0.1, 0.4], rho=0.2),
        ]
    )
    assert f["expected against achieved reduction, median difference"].value == pytest.approx(0.075)
    assert f["… 90 % interval covers"].share == Share(2, 4)
    assert f["achieved reduction when right, rho ≥ 0.5, median"].value == pytest.approx(0.9)


def test_floors_are_held_to_our_own_rate_of_false_alarms():
    answers = [healthy() for _ in range(4)]
    answers[0] = dataclasses.replace(answers[0], named=(("delay", "X", 0.9),))
    answers += [made(named=(STRIBECK,)) for _ in range(3)]
    answers = [dataclasses.replace(a, number=k) for k, a in enumerate(answers)]
    said = [("delay", s) for s in (0.1, 0.2, 0.3, 0.9)]
    said += [("stribeck", 0.5), ("stribeck", 0.25), ("delay", 0.95)]
    picks = {k: {"pursuit": (effect, "X", score)} for k, (effect, score) in enumerate(said)}
    ours, floor = floor_scores(answers, picks)
    assert ours.alarms == Share(1, 4)
    assert ours.visible == Share(3, 3)
    assert floor.threshold == 0.3  # one of four lies above it
    assert floor.alarms == Share(1, 4)
    assert floor.visible == Share(1, 3)
    assert beaten([ours, floor])


def test_the_confusion_matrix_counts_what_was_said():
    answers = [
        made(named=(STRIBECK,)),
        made(named=(DELAY,)),
        made(named=(("stribeck", "Y"),)),
        made(verdict="none"),
        made(truth=(DELAY,), named=(DELAY,)),
    ]
    have = measured(answers)
    assert have["stribeck"] == {"stribeck": 1, "delay": 1, "stribeck (other axis)": 1, "none": 1}
    assert have["delay"] == {"delay": 1}


def test_an_answer_survives_its_line_of_json():
    one = made(
        named=(STRIBECK,),
        shrink=None,
        confusable=(("X.a", "X.b"),),
    )
    assert msgspec.convert(json.loads(json.dumps(plain(dataclasses.asdict(one)))), Answer) == one


def test_bounds():
    assert Bound(0.8, 0.9).holds(0.85)
    assert not Bound(high=0.05).holds(0.06)
    assert Bound(0.8).holds(None) is None


@pytest.fixture
def bench():
    answers = [
        healthy(),
        healthy((DELAY,)),
        made(named=(STRIBECK,)),
        made(named=(DELAY,)),
        made("outside", (("mains", "X"),), verdict="unexplained"),
        *(made(named=(STRIBECK,)) for _ in range(9)),
        dataclasses.replace(made(), verdict="error", error="ValueError: <oh>"),
    ]
    return document(answers, 20)


def test_the_table_in_markdown_and_json_says_the_same(bench):
    text, content = markdown(bench), json.loads(json.dumps(plain(bench)))
    assert "15 of 20 cases" in text
    assert "| healthy machine accused of anything | 50.0% | 1/2 | ≤ 5% | ≤ 2% | MISSED |" in text
    row = next(r for r in content["scores"] if r["name"] == "healthy machine accused of anything")
    assert row["share"] == {"hits": 1, "of": 2}
    assert row["state"] == "below"
    assert content["confusion"]["stribeck"]["error"] == 1
    assert content["errors"] == [{"case": 0, "error": "ValueError: <oh>"}]


def test_the_page_holds_the_table_the_matrices_and_escapes(bench):
    page = bench_page(bench).html()
    for title in (
        "Scores",
        "What is taken for what",
        "How far a stated probability",
        "Diagnoses that broke off",
    ):
        assert title in page
    assert "&lt;oh&gt;" in page
    assert "<oh>" not in page
    assert page.count('class="plot"') == 3
    assert "https://" not in page.partition("plotly-packed")[0]
    assert "missed: healthy machine accused of anything" in page


def test_an_empty_bench_makes_a_page_all_the_same():
    page = bench_page(document([], 0)).html()
    assert "Too few cases for any score." in page
