"""One grade per axis and signal: the four contradictions that a report once held cannot come back."""

from __future__ import annotations

import itertools
import math

import pytest

from pinotwin.diagnosis.conclusion.verdict import with_open_signals
from pinotwin.diagnosis.grade import KIND, explained, grade
from pinotwin.diagnosis.result import Diagnosis, Gap
from pinotwin.diagnosis.result import Found as Named
from pinotwin.diagnosis.rules import RULES
from pinotwin.system.phrases import MEANING

NAN = float("nan")

TABLE = [
    # rms, misfit, noise, after, grade
    (0.20, 0.1, 0.25, None, "agrees"),
    (0.37, 0.1, 0.25, None, "agrees"),
    (4.49, 4.4, 0.248, None, "within misfit"),
    (4.49, 2.7, 0.248, None, "above misfit"),
    (4.49, 0.3, 0.248, None, "not explained"),
    (4.49, None, 0.248, None, "not judged"),
    (22.5, 1.0, 2.06, 2.28, "gap explained"),
    (74.0, 0.5, 0.3, 0.69, "gap explained"),
    (0.135, 0.005, 0.0086, 0.0748, "partly explained"),
    (10.0, 0.1, 0.1, 3.0, "partly explained"),
    (10.0, 0.1, 0.1, 9.9, "not explained"),
    (10.0, 0.1, 0.1, 12.0, "not explained"),
    (10.0, None, None, 1.0, "not judged"),
    (10.0, NAN, 0.0, 1.0, "not judged"),
    (10.0, 6.0, None, None, "above misfit"),
    (10.0, 3.0, 0.0, 4.0, "gap explained"),
    (NAN, 0.1, 0.1, 1.0, "not judged"),
    (10.0, None, 0.1, 0.15, "gap explained"),
]


@pytest.mark.parametrize(("rms", "misfit", "noise", "after", "expected"), TABLE)
def test_grades(rms, misfit, noise, after, expected):
    assert grade(rms, misfit, noise, after) == expected


def test_a_tracking_error_is_open_from_further_on():
    """Of healthy axes the tracking error differs by up to 4.8 times what the simulation left of the own logs."""
    assert grade(4.8, 1.0, 0.0) == "not explained"
    assert grade(4.8, 1.0, 0.0, signal="e") == "above misfit"
    assert grade(4.8, 1.0, 0.0, signal="ql") == "above misfit"  # another half of a robot's log reaches 3.9
    assert grade(6.5, 1.0, 0.0, signal="e") == "not explained"


def diagnosed(e, effects=()):
    gap = {"X": {"u": Gap(1.0, 0.1, 1.0, 1.0, 1.0), "e": Gap(e, 0.02, 0.0, e, 1.0)}}
    return Diagnosis("No change.", gap, (), effects, (), {}, {}, "assumed", (), "change", {})


def test_an_axis_that_follows_otherwise_than_its_twin_is_no_unchanged_one():
    quiet = diagnosed(3.5)
    assert with_open_signals(quiet) is quiet
    off = with_open_signals(diagnosed(6.7))
    assert (off.verdict, off.unexplained) == ("unexplained", {"X": {"e": 1.0}})
    assert off.sentence.startswith("X follows its command unlike its twin: the tracking error is 6.7 times")
    assert off.grade("X", "e") == "not explained"


@pytest.mark.parametrize(("rms", "after", "word"), [(9.0, 1.2, "gap explained"), (2.3, 2.29, "above misfit")])
def test_a_tracking_error_may_shrink_by_what_was_named_on_another_axis(rms, after, word):
    gap = {"X": {"u": Gap(1.0, 0.1, 1.0, 1.0, 1.0), "e": Gap(rms, 0.02, 0.0, after, 1.0)}}
    other = Named("feedforward", "Y", 0.9, {}, {}, {}, [])
    given = Diagnosis("", gap, (), [other], (), {}, {}, "assumed", (), "change", {})
    assert given.grade("X", "e") == word


def test_a_gap_of_eighteen_times_the_noise_never_agrees():
    """Axis Y "agrees", 4.49 N beside a noise of 0.248 N; its plot said that no gap was beyond the noise."""
    for misfit in (None, NAN, 0.0, 0.248, 4.5, 100.0):
        assert grade(4.49, misfit, 0.248) != "agrees"


def test_nine_times_the_noise_left_is_not_explained():
    """ "Gap explained" with 0.0748 left of 0.135 N·m at a noise of 0.0086 N·m."""
    assert grade(0.135, 0.0, 0.0086, 0.0748) == "partly explained"


def test_a_gap_without_a_cause_is_never_explained():
    """A's tracking error, 164 times the noise, "gap explained" without any shrink delivered."""
    said = [grade(1.64, misfit, 0.01, None) for misfit in (0.0, 0.5, None)]
    assert said == ["not explained", "not explained", "not judged"]


def test_only_noise_differs_means_that_it_agrees():
    """ "What differs is noise" while C.e was 33 times its noise."""
    assert grade(3.3, 0.1, 0.1) == "not explained"


def test_words_and_numbers_never_contradict():
    sizes = (0.0, 0.1, 0.5, 1.0, 2.0, 5.0, 20.0, 100.0)
    for rms, misfit, noise, after in itertools.product(sizes, (None, *sizes), sizes[1:], (None, *sizes)):
        word = grade(rms, misfit, noise, after)
        level = math.hypot(noise, misfit or 0.0)
        assert word in KIND
        assert word in MEANING
        assert (word == "agrees") == (rms <= RULES.odd * noise)
        if word == "gap explained":
            assert after is not None
            assert after <= RULES.open_change * level
            assert explained(rms, level, after) >= (
                RULES.explained_unknown if misfit is None else RULES.explained_known
            )
        if word == "within misfit":
            assert noise < rms <= RULES.odd * level
        if word == "above misfit":
            assert RULES.odd * level < rms <= RULES.open_change * level
        if word == "not explained":
            assert after is not None or rms > RULES.open_change * level
        if word in ("partly explained", "gap explained"):
            assert after is not None
            assert after < rms


def test_less_left_is_never_a_worse_grade():
    order = ["not explained", "partly explained", "gap explained"]
    for rms, noise in ((10.0, 0.1), (3.0, 1.0), (50.0, 2.0)):
        ranks = [order.index(grade(rms, 0.1, noise, rms * share / 100)) for share in range(100, -1, -1)]
        assert ranks == sorted(ranks)
