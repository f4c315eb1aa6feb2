"""Numbers of a diagnosis: shares of one residual, of named causes alone; changes that a machine can make."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.diagnosis.conclusion.sizes import change_text, name_words, size_text
from pinotwin.diagnosis.conclusion.verdict import with_open_signals
from pinotwin.diagnosis.grade import OPEN
from pinotwin.diagnosis.result import Diagnosis, Gap, Size, shrunk
from pinotwin.diagnosis.result import Found as Named
from pinotwin.effects import PositionTable, Ripple
from pinotwin.identification import identify
from pinotwin.machine import Machine
from pinotwin.report.diagnosis_verdict import headline
from pinotwin.twin import Twin
from tests.invariants import invariants
from tests.test_diagnosis_named import record

STORED = json.loads((Path(__file__).parent / "answers.json").read_text())
"""Answers of the bench: ``now`` as they are, ``once`` with numbers that broke what holds of them."""


@pytest.mark.parametrize("name", STORED["now"])
def test_what_holds_of_every_answer(name: str) -> None:
    assert invariants(STORED["now"][name]) == []


@pytest.mark.parametrize("name", STORED["once"])
def test_a_wrong_number_is_noticed(name: str) -> None:
    once = STORED["once"][name]
    assert {line.partition(":")[0] for line in invariants(once["answer"])} == set(once["broken"])


@pytest.fixture(scope="module")
def twin() -> Twin:
    machine = dataclasses.replace(Machine.load("emps"), columns={})
    return identify(machine, [record(3), record(5)], loop=False)


def test_a_push_shrinks_the_gap_that_it_is_in(twin: Twin) -> None:
    log = record(4)
    pushed = np.clip(np.minimum(log.t - 3.0, 3.6 - log.t) / 0.05, 0.0, 1.0)  # it comes and goes within 50 ms
    quiet = pt.diagnose(twin, log, quick=True, closed_loop=False)
    found = pt.diagnose(
        twin,
        log.with_channels({**log.channels, "X.u": log["X.u"] - 40.0 * pushed}),
        quick=True,
        closed_loop=False,
    )
    (push,) = found.effects
    gap, shrink = found.gap["X"]["u"], push.shrink["u"]
    assert push.effect == "external_force"
    assert (shrink.before, shrink.after) == (gap.rms, pytest.approx(gap.after))
    assert gap.rms > 5.0 * quiet.gap["X"]["u"].rms
    assert gap.after < 2.0 * quiet.gap["X"]["u"].rms


def test_a_share_is_from_none_to_all_and_its_interval_holds_it() -> None:
    x = shrunk(2.0, 1.2, (1.01, 1.3), 1.1, "held-out blocks", None)
    assert (x.after, x.share, x.interval, x.promised) == (0.0, 1.0, (1.0, 1.0), 1.0)
    x = shrunk(2.0, -0.1, (-0.3, -0.05), 0.2, "validation", None)
    assert (x.after, x.share, x.interval) == (2.0, 0.0, (0.0, 0.0))
    x = shrunk(2.0, 0.75, (0.8, 0.9), 0.2, "validation", None)
    assert (x.after, x.interval) == (1.0, (0.75, 0.9))


def test_the_sentence_says_pitch_and_place() -> None:
    wave = [Size(f"ripple.{x}", 0.0, 3.0, "N", (2.9, 3.1)) for x in ("a", "b")]
    ripple = Ripple("X", period=0.03244, free_pitch=True)
    found = Named("ripple", "X", 0.9, {"period": 0.03244}, {}, {}, [], size=wave, listed=ripple)
    assert change_text(found) == ": amplitude 4.24 N (90 %: 4.14 to 4.34), pitch 32.44 mm"
    table = PositionTable("A", rotary=True, spacing=0.1, start=0.0, stop=0.4)
    heights = [Size(f"position_table.m{k}", 0.0, x, "N·m", (x, x)) for k, x in enumerate((0, 1, -3, 1, 0))]
    found = Named("position_table", "A", 0.9, {}, {}, {}, [], size=heights, listed=table)
    assert change_text(found) == ": lowest of 5 points -3 N·m (90 %: -3 to -3) at 11.46 °"


def test_a_place_is_no_fraction_of_a_name() -> None:
    at = Size("encoder_error.at 0.587184 rad", 0.0, 2e-4, "rad", (1e-4, 3e-4))
    assert size_text(at) == "at 33.64 ° 11.46 mdeg"
    assert name_words(at) == "at 33.64 °"


def diagnosed(signal: str, gap: Gap, effects: list[Named]) -> Diagnosis:
    gaps = {"X": {"u": Gap(1.0, 0.1, 1.0, 1.0, 1.0), signal: gap}}
    return Diagnosis("Said.", gaps, (), effects, (), {}, {}, "assumed", (), "change", {})  # type: ignore[arg-type]


@pytest.mark.parametrize("signal", ["e", "ql", "v"])
def test_every_open_signal_counts_in_the_verdict(signal: str) -> None:
    loud, quiet = Gap(9.0, 0.3, 0.1, 9.0, 1.0), Gap(1.2, 0.1, 0.1, 1.2, 1.0)
    push = Named("external_force", "X", 0.9, {}, {}, {}, [])
    for effects, before, after in (([], "none", "unexplained"), ([push], "explained", "partly_explained")):
        said = with_open_signals(diagnosed(signal, loud, effects))
        assert (said.verdict, dict(said.unexplained)) == (after, {"X": {signal: 1.0}})
        assert said.grade("X", signal) in OPEN
        assert "X" in said.sentence
        assert with_open_signals(diagnosed(signal, quiet, effects)).verdict == before


def test_a_drive_of_the_public_set_shows_one_gap_wherever_it_is_shown(data_dir: Path) -> None:
    found = pt.diagnose("emps", data_dir / "emps" / "DATA_EMPS.mat", closed_loop=False)
    assert invariants(found.to_dict()) == []
    assert found.remains  # a function of speed without a name
    (gap,) = (row["u"] for row in found.gap.values())
    (shrink,) = (row["u"] for row in found.shrink.values())
    assert sum(e.shrink["u"].share for e in found.effects) == pytest.approx(shrink.share)
    before, after = (f"{x:.3g}" for x in (gap.rms, found.effects[0].shrink["u"].after))
    assert f"from {before} to {after} N RMS" in headline(found)[0]
