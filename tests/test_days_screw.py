"""Motor and load of a ball screw over days: what its lead is off by every day is no change; what grows is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pinotwin as pt
from benchmarks.train.rows import stretches_of
from pinotwin.diagnosis.days.decision import Decision
from pinotwin.diagnosis.days.judge import evidence
from pinotwin.diagnosis.days.reference import reference
from pinotwin.diagnosis.days.row import Question
from pinotwin.log import Log
from tests.days_machine import RATE, Day, machine, run

STIFFNESS, FRICTION = 4e7, 25.0  # [N/m], [N]
LEAD, BOW, PLAY = 60e-6, 8e-6, 6e-6  # of every day: scale [1], curve along the stroke and lost motion [m]


def _day(
    command: int,
    noise: int,
    scale: float = 0.0,
    grows: float = 0.0,
    play: float = 0.0,
    moved: float = 0.0,
    floats: float = 0.0,
    give: float = 1.0,
    wave: float = 0.0,
    worn: float = 0.0,
    jumps: float = 0.0,
) -> Log:
    """Return a day's log with a scale on the load; what grows is 1 - exp(-t / 6 s), from a bearing at -0.4 m.

    A ``wave`` repeats every 16 mm of the scale; what is ``worn`` is 0.1 m long.
    A load ``jumps`` after 3 s and after 5 s. One that ``floats`` lies on the side to which friction and inertia push
    it, and anywhere between at rest.
    """
    log, rng = run(Day(command=command, noise=noise)), np.random.default_rng(noise)
    q, t = log["X.q"], log["t"]
    v = np.gradient(q, 1.0 / RATE)
    side = np.sign(v[np.maximum.accumulate(np.where(np.abs(v) > 1e-3, np.arange(len(v)), 0))])
    drive = (log["X.u"] - 0.5 * FRICTION * np.tanh(v / 1e-3)) / STIFFNESS
    twist = give * drive + 0.5 * (PLAY + play) * side + moved
    twist += jumps * ((t > 3.0) + 1.0 * (t > 5.0))
    twist += 0.5 * floats * _rests(drive, v, np.random.default_rng([noise, 1]))
    off = (LEAD + scale + 4e-6 * rng.standard_normal()) * q + BOW * (1.0 - (q / 0.25) ** 2)
    off += grows * (1.0 - np.exp(-t / 6.0)) * (q + 0.4) + 1e-6 * rng.standard_normal()
    off += wave * np.sin(2.0 * np.pi * q / 0.016) + worn * np.exp(-(((q - 0.05) / 0.05) ** 2))
    load = q - twist + off + 2e-7 * rng.standard_normal(len(q))
    return Log({**log, "X.ql": load}, source=f"day {command} {noise}")


def _rests(drive: np.ndarray, v: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return where a load is between -1 and 1: in motion on the side of its drive, at rest anywhere for a while."""
    out, at = np.sign(drive), 0.0
    still = np.abs(v) < 2e-3
    for k in np.flatnonzero(still):
        at = at if k and still[k - 1] else float(rng.uniform(-0.8, 0.8))
        out[k] = at
    return out


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> pt.Twin:
    folder = tmp_path_factory.mktemp("screw")
    machine(folder)
    return pt.identify(pt.Machine.load(folder), [_day(10 + k, 20 + k) for k in range(4)])


def _asked(twin: pt.Twin, **change: float) -> pt.Diagnosis:
    return pt.diagnose(twin, [_day(30, 40 + k, **change) for k in range(2)])


def test_a_lead_that_is_off_every_day_is_no_change(twin: pt.Twin) -> None:
    found = _asked(twin)
    assert (found.verdict, list(found.effects)) == ("none", [])


def test_a_scale_is_told_beside_that_of_healthy_days(twin: pt.Twin) -> None:
    found = _asked(twin, scale=-80e-6)
    assert [(e.effect, e.axis) for e in found.effects] == [("encoder_scale", "X")]
    assert found.effects[0].theta["error"] == pytest.approx(-80e-6, abs=15e-6)


def test_lost_motion_is_told_beside_that_of_healthy_days(twin: pt.Twin) -> None:
    found = _asked(twin, play=30e-6)
    assert [(e.effect, e.axis) for e in found.effects] == [("backlash", "X")]
    assert found.effects[0].theta["gap"] == pytest.approx(30e-6, rel=0.2)


@pytest.mark.parametrize("moved", [-25e-6, 2e-3])
def test_a_load_that_moved_before_the_log_began_is_told_from_where_it_stood_on_healthy_days(
    twin: pt.Twin, moved: float
) -> None:
    found = _asked(twin, moved=moved)
    assert [(e.effect, e.axis) for e in found.effects] == [("encoder_step", "X")]
    assert found.effects[0].theta["step"] == pytest.approx(-moved, rel=0.1)


def test_two_steps_are_one_cause_with_what_both_close(twin: pt.Twin) -> None:
    found = pt.diagnose(twin, _day(30, 40, jumps=2e-3))
    (step,) = found.effects
    assert (step.effect, step.axis, step.course["kind"]) == ("encoder_step", "X", "since")
    assert [s.after for s in step.size] == pytest.approx([-2e-3, -2e-3], rel=0.05)
    assert step.shrink["ql"].after < 0.1 * step.shrink["ql"].before
    assert "begins within the run" in found.sentence


def test_a_zero_that_is_set_anew_every_day_tells_nothing(twin: pt.Twin) -> None:
    logs = [_day(10 + k, 20 + k, moved=x) for k, x in enumerate((0.0, 1.3e-3, -0.8e-3, 0.4e-3))]
    found = _asked(pt.identify(twin.machine, logs), moved=-1e-3)
    assert (found.verdict, list(found.effects)) == ("none", [])


def test_a_load_that_floats_within_its_play_is_measured_between_its_ends(twin: pt.Twin) -> None:
    found = _asked(twin, floats=60e-6)
    assert [(e.effect, e.axis) for e in found.effects] == [("backlash", "X")]
    assert found.effects[0].theta["gap"] == pytest.approx(60e-6, rel=0.2)


def test_a_drive_that_gives_twenty_times_as_much_is_told_beside_quiet_rows(twin: pt.Twin) -> None:
    """What is loud in motion alone is a second maximum: rows at rest speak for no change."""
    found = _asked(twin, give=20.0)
    assert [(e.effect, e.axis) for e in found.effects] == [("drive_flexibility", "X")]
    first = found.effects[0]
    assert STIFFNESS / 40.0 < first.size[0].after < 0.1 * first.size[0].before


@pytest.mark.parametrize("grows", [-120e-6, 80e-6])
def test_a_screw_that_grows_is_told_wherever_its_bearing_is(twin: pt.Twin, grows: float) -> None:
    found = _asked(twin, grows=grows)
    assert (found.effects[0].effect, found.effects[0].axis) == ("encoder_scale", "X")
    assert np.sign(found.effects[0].theta["error"]) == np.sign(grows)
    assert "grows" in found.sentence


def test_what_the_motor_holds_at_rest_loads_no_spring(twin: pt.Twin) -> None:
    r = reference(twin, ["X"])
    assert r is not None
    (s,) = stretches_of(r, [_day(30, 40)])
    c = s.axes["X"]

    def left_open(force: float) -> float:
        held = s.low(force * (1.0 - c["going"]))
        more = {**c, "u": c["u"] + held, "left": c["left"] + held}
        return evidence(Question.of(r, [replace(s, axes={"X": more})], []))[0].open["X encoders"]

    assert left_open(200.0) == pytest.approx(left_open(0.0), abs=0.1)


def test_an_error_that_repeats_along_the_scale_is_told_with_its_pitch(twin: pt.Twin) -> None:
    found = pt.diagnose(twin, [_day(30, 40, wave=5e-6), _day(30, 41, wave=5e-6)])
    assert [(e.effect, e.axis) for e in found.effects] == [("encoder_error", "X")]
    assert found.effects[0].shape["period"] == pytest.approx(0.016, rel=0.01)
    assert abs(found.effects[0].size[0].after) == pytest.approx(5e-6, rel=0.1)


def test_a_worn_part_of_a_scale_is_told_with_its_place(twin: pt.Twin) -> None:
    found = pt.diagnose(twin, [_day(30, 40, worn=1e-5), _day(30, 41, worn=1e-5)])
    assert [(e.effect, e.axis) for e in found.effects] == [("encoder_error", "X")]
    place = next(x for x in found.where if x.kind == "position" and x.signal == "ql")
    assert place.range[0] < 0.05 < place.range[1]


def test_what_is_open_has_its_likeliest_cause_beside_it_though_that_is_too_unsure_to_be_named(
    twin: pt.Twin, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Decision, "limit", lambda *_: 0.0)  # nothing is sure enough
    found = _asked(twin, scale=-0.4e-3)
    assert (found.verdict, list(found.effects)) == ("unexplained", [])
    assert [(x.effect, x.axis) for x in found.possible] == [("encoder_scale", "X")]
    assert "ql" in found.unexplained["X"]
    assert "Possible, not sure: X scale of the second encoder" in found.sentence
    healthy = _asked(twin)
    assert (healthy.verdict, list(healthy.possible)) == ("none", [])
