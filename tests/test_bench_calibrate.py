"""The limits of false alarms: derived from what healthy questions need, written into a file of rules."""

from __future__ import annotations

import runpy
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

import pinotwin.diagnosis.rules as rules
from benchmarks.questions.calibrate import Limit, derived, least, reached, with_value, write_rules
from benchmarks.questions.healthy import Question, asked
from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.rules import RULES
from pinotwin.errors import DataError


@pytest.mark.parametrize("needed", [0.013, 0.9, 7.0])
def test_the_least_silent_value_is_found_to_one_percent(needed):
    found = least("excess", lambda r: r.excess >= needed)
    assert needed <= found <= 1.01 * needed


def test_a_question_that_no_rule_need_silence_asks_for_nothing():
    assert least("excess", lambda r: True) == 0.0


def test_a_question_that_the_rule_cannot_silence_is_told_from_one_that_it_can():
    assert least("excess", lambda r: False) == np.inf


def test_a_limit_is_exceeded_as_often_as_it_says():
    rng = np.random.default_rng(3)
    beyond = []
    for _ in range(400):
        (limit,) = derived([{"excess": float(x)} for x in rng.lognormal(size=99)], alpha=0.05)
        beyond.append(np.mean(rng.lognormal(size=200) > limit.value))
    assert 0.03 < np.mean(beyond) < 0.05  # rounded up, so a little below


@pytest.mark.parametrize(
    ("values", "alpha", "expected"),
    [
        ([0.1, 0.5, 0.3], 0.02, 0.53),  # too few for the second largest
        ([0.412, 0.2], 0.02, 0.44),  # a twentieth more, rounded up to two digits
        ([0.0, 0.0], 0.02, RULES.excess),  # no question needs it: it stays
        ([0.1 * k for k in range(1, 100)], 0.02, 11.0),
    ],
)
def test_limits_from_what_questions_need(values, alpha, expected):
    (limit,) = derived([{"excess": x} for x in values], alpha)
    assert limit.value == pytest.approx(expected)
    assert limit.questions == len(values)


def test_values_are_written_where_they_are_read(tmp_path):
    file = tmp_path / "rules.py"
    shutil.copy(str(rules.__file__), file)
    for value in (1.25, 2.5):  # twice: the first table is replaced
        limits = [Limit("excess", value, (value, 0.1), 40), Limit("open_change", 3.0, (2.9,), 40)]
        write_rules(file, limits, "python -m benchmarks calibrate --seed 5", "2026-01-02")
    module = SimpleNamespace(**runpy.run_path(str(file)))
    assert module.RULES.excess == 2.5
    assert module.RULES.open_change == 3.0
    assert module.RULES.push == RULES.push
    assert module.DERIVED == {"excess": (2.5, 2.5, 40), "open_change": (3.0, 2.9, 40)}
    assert module.COMMAND.endswith("--seed 5")
    assert module.DATE == "2026-01-02"


def test_a_file_without_the_rule_is_refused_and_left_alone(tmp_path):
    file = tmp_path / "rules.py"
    file.write_text("RULES = 1\n")
    with pytest.raises(DataError, match="excess"):
        write_rules(file, [Limit("excess", 1.0, (1.0,), 3)], "", "")
    assert file.read_text() == "RULES = 1\n"


def test_every_derived_rule_is_in_force():
    for name, (value, largest, count) in rules.DERIVED.items():
        assert getattr(RULES, name) == value
        assert count > 20
        assert 0.0 <= largest <= value


@pytest.mark.parametrize("situation", ["structure", "change"])
def test_a_healthy_machine_is_silent_from_where_its_limits_are(situation, tmp_path):
    given = asked(Question("own", "emps", situation, 3), tmp_path, None)
    needs = reached(given)
    quiet = RULES
    for name, value in needs.items():
        quiet = with_value(quiet, name, max(value * 1.001, getattr(RULES, name)))
    found = diagnose(given.subject, given.logs, validate=given.validation, rules=quiet)
    assert found.effects == []
    assert found.verdict == "none"
