"""What has changed since a twin of several days, on a machine with its own plant, friction and controller."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.bench.plants import public_machine, virtual
from pinotwin.bench.produce import path_of
from pinotwin.diagnosis.conclusion.explained import Closed
from pinotwin.diagnosis.days.answer import Answer
from pinotwin.diagnosis.days.causes import Place, when
from pinotwin.diagnosis.days.changed import changed
from pinotwin.diagnosis.days.courses import acting, onset, spells
from pinotwin.diagnosis.days.decision import FEATURES, GROUP_NAMES, Case
from pinotwin.diagnosis.days.evidence import cells
from pinotwin.diagnosis.days.forms import _polished
from pinotwin.diagnosis.days.judge import Named, evidence, named
from pinotwin.diagnosis.days.law import TERMS, Law
from pinotwin.diagnosis.days.mechanisms import READ, bodies
from pinotwin.diagnosis.days.places import instants
from pinotwin.diagnosis.days.reference import Reference, reference
from pinotwin.diagnosis.days.row import Question, Row
from pinotwin.diagnosis.days.rows import Asked
from pinotwin.diagnosis.days.score import Cells, padded, score
from pinotwin.diagnosis.days.stretch import Stretch, _clear
from pinotwin.diagnosis.days.whitening import Whitening
from pinotwin.effects import EFFECTS, Effect
from pinotwin.log import Log
from tests.days_machine import ARM, CARRIAGE, INERTIA, Day, machine, write
from tests.invariants import invariants


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("days")
    machine(folder)
    for k in range(3):
        write(folder, f"healthy_{k}", Day(command=10 + k, noise=20 + k))
    return folder


@pytest.fixture(scope="module")
def twin(folder: Path) -> pt.Twin:
    return pt.identify(pt.Machine.load(folder), [str(folder / f"healthy_{k}.csv") for k in range(3)])


def _asked(folder: Path, twin: pt.Twin, name: str, **change: Any) -> pt.Diagnosis:
    days = [Day(command=30, noise=40 + k, began=10.0 * k, **change) for k in range(2)]
    logs = [str(write(folder, f"{name}_{k}", day)) for k, day in enumerate(days)]
    sealed = str(write(folder, f"{name}_v", Day(command=31, noise=45, began=20.0, **change)))
    found = pt.diagnose(twin, logs, validate=sealed)
    assert invariants(found.to_dict()) == []
    return found


def test_of_a_healthy_day_nothing_is_named_and_it_is_said_what_would_have_shown(
    folder: Path, twin: pt.Twin
) -> None:
    found = _asked(folder, twin, "none")
    assert (found.verdict, list(found.effects)) == ("none", [])
    assert "would have been visible" in found.sentence
    friction = {x["axis"]: x["size"] for x in found.detectable if x["effect"] == "friction_scale"}
    assert set(friction) == {"X", "A"}
    assert all(0.05 < x < 1.0 for x in friction.values())


def test_friction_that_fell_is_one_factor_of_its_axis(folder: Path, twin: pt.Twin) -> None:
    found = _asked(folder, twin, "friction", friction={"X": 0.3})
    first = found.effects[0]
    assert first.axis == "X"
    assert first.effect in ("friction_scale", "coulomb", "viscous")
    if first.effect == "friction_scale":
        assert first.size[0].after == pytest.approx(0.3, abs=0.1)
    assert {e.axis for e in found.effects} == {"X"}
    logs = [x.log for x in found.prepared]
    for worth, verdict in [(0.001, found.verdict), (0.9, "none")]:
        again = pt.diagnose(twin, logs, worth=worth)
        assert again.verdict == verdict
        assert again.provenance["options"]["worth"] == worth
    assert found.gap["X"]["u"].is_open() is False  # by what was named
    assert again.grade("X") == "above misfit"  # and no more is said than that the residual is larger


@pytest.mark.parametrize(("axis", "slow"), [("X", 0.01), ("X", 0.04), ("A", 0.1)])
def test_friction_that_grew_near_rest_is_named_by_the_rows_at_which_the_axis_turns(
    folder: Path, twin: pt.Twin, axis: str, slow: float
) -> None:
    found = _asked(folder, twin, f"sticks_{slow}", sticks={axis: (1.0, slow)})
    assert [(e.effect, e.axis) for e in found.effects] == [("stribeck", axis)]
    assert found.effects[0].shape["v_s"] == pytest.approx(slow, rel=0.25)
    assert slow == 0.01 or found.effects[0].shrink["e"].share > 0.1  # simulated, and other friction scatters


@pytest.mark.parametrize("load", [1.5, -1.5])
def test_a_load_is_one_body_though_the_gains_of_its_controllers_follow(
    folder: Path, twin: pt.Twin, load: float
) -> None:
    found = _asked(folder, twin, f"load_{load}", load=load)
    assert found.effects[0].effect == "payload"
    assert found.effects[0].theta["m"] == pytest.approx(load, rel=0.1)


@pytest.mark.parametrize(("factor", "said"), [(1.0, []), (1.6, [("X", True)])])
def test_of_logs_without_a_command_plant_and_days_tell(
    folder: Path, twin: pt.Twin, factor: float, said: list[tuple[str, bool]]
) -> None:
    logs = []
    for k in range(2):
        log = pt.read(write(folder, f"bare_{k}", Day(command=33, noise=46 + k, friction={"X": factor})))
        logs.append(Log({c: log[c] for c in log.channels if not c.endswith(".qr")}, source=f"bare_{k}"))
    found = pt.diagnose(twin, logs)
    assert invariants(found.to_dict()) == []
    assert [(e.axis, e.effect in ("friction_scale", "coulomb", "viscous")) for e in found.effects] == said
    assert (found.verdict == "none") is (not said)


def test_a_position_gain_is_told_from_the_plant(folder: Path, twin: pt.Twin) -> None:
    found = _asked(folder, twin, "kp", kp={"A": 0.6})
    assert [(e.effect, e.axis) for e in found.effects][:1] == [("position_gain", "A")]
    size = found.effects[0].size[0]
    assert size.after / size.before == pytest.approx(0.6, abs=0.03)


def test_a_motor_that_gives_less_is_an_effort_scale_and_no_change_of_the_controller(
    folder: Path, twin: pt.Twin
) -> None:
    found = _asked(folder, twin, "motor", motor={"A": 0.8})
    assert [(e.effect, e.axis) for e in found.effects] == [("effort_scale", "A")]
    assert found.effects[0].size[0].after == pytest.approx(1.0 / 0.8 - 1.0, abs=0.03)


def test_an_effort_that_grows_from_nothing_through_the_runs_is_a_drift(folder: Path, twin: pt.Twin) -> None:
    found = _asked(folder, twin, "drift", drift={"X": 1.5})
    assert [(e.effect, e.axis) for e in found.effects] == [("offset", "X")]
    assert "grows with time" in found.sentence
    assert found.to_dict()["effects"][0]["course"]["kind"] == "growing"
    size = found.effects[0].size[0]
    assert size.after == pytest.approx(1.5 * 10.0, rel=0.15)


def _pulses(what: str, score: float, spread: float, worth: float) -> Row:
    return Row("cut", "X", "time", score, {}, 8.0, 1, 0.1, 0.01, 10.0, worth, [score], 1.0, spread, what=what)


@pytest.mark.parametrize(
    ("rows", "stand"),
    [
        ([_pulses("", 90.0, 12.0, 0.10)], 1),  # many small pulses
        ([_pulses("", 90.0, 4.0, 0.10)], 0),  # few
        ([_pulses("", 90.0, 4.0, 0.20)], 1),  # few, and twice the noise
        ([_pulses("", 90.0, 12.0, 0.10), _pulses("read", 200.0, 12.0, 0.10)], 0),  # the law shows them too
        ([_pulses("", 90.0, 12.0, 0.10), _pulses("read", -50.0, 12.0, 0.10)], 1),  # the law does not
    ],
)
def test_pulses_within_the_noise_of_the_effort_are_none_where_they_are_in_the_reading(
    rows: list[Row], stand: int
) -> None:
    assert len(Case.of(rows, {}, {"X": 0.08}).causes) == stand


@pytest.fixture(scope="module")
def known_days(twin: pt.Twin) -> Reference:
    found = reference(twin, ["X", "A"])
    assert found is not None
    return found


def test_what_one_of_the_own_days_shows_is_no_change(known_days: Reference) -> None:
    for day in range(3):
        logs = [s for s in known_days.logs if s.log == day]
        _, rows, _ = evidence(Question.of(known_days, logs))
        plain = [r.score for r in rows if r.group not in ("recording", "limit")]
        assert len(plain) > 5
        assert max(plain) <= 1e-9


def test_a_change_is_sought_among_the_effects_of_the_catalogue(known_days: Reference) -> None:
    every = Asked(Question.of(known_days, known_days.logs[:1])).tried.columns
    tried, couplings = every["X"][0], {k for x in every.values() for k in x[0] if "coupling" in k}
    forms = {"stribeck", "hysteresis", "position_table", "encoder_error:X"}
    assert forms | {"payload", "payload:X"} <= set(tried)
    assert couplings == {"inertial_coupling:X", "inertial_coupling:read"}  # of both axes one
    assert "presliding" not in tried  # dry friction by another law
    plain = Asked(Question.of(known_days, known_days.logs[:1]), search=False).tried.columns["X"][0]
    assert not forms & set(plain)
    assert set(plain) < set(tried)


def test_a_soft_drive_and_what_feels_it_through_the_inertia_are_one_cause(known_days: Reference) -> None:
    q = Question.of(known_days, [s for s in known_days.logs if s.log == 0])
    spring = EFFECTS["drive_flexibility"].on(known_days.twin.machine, "X").shaped([12.0, 0.05])
    lefts = [dict(left) for left in q.left]
    for s, left in zip(q.logs, lefts, strict=True):
        found = spring.columns(s.motion)
        for k, j in enumerate(found.joints):
            left[s.motion.names[j], "plant"] = left[s.motion.names[j], "plant"] + s.taken(
                found.values[:, k, 0]
            )
    best, *others = Asked(replace(q, left=lefts)).rows()
    assert (best.name, best.axis, set(best.acts)) == ("drive_flexibility", "X", {"X", "A"})
    assert best.theta * best.scale[-1] == pytest.approx(1.0, abs=0.15)
    assert all(x.score < 0.7 * best.score for x in others)


def test_a_body_is_named_on_the_link_that_carries_it() -> None:
    """A body on the cradle: no body on the table that the cradle carries does the same."""

    def day(seed: int, *on: tuple[str, str, float]) -> Log:
        return virtual("trunnion", on=on).record(path_of("trunnion", 8.0, seed), seed=seed).to_log()

    twin = pt.identify(public_machine("trunnion"), [day(1), day(2)], loop=False)
    found = pt.diagnose(twin, [day(3, ("inertial_coupling", "A", 0.1))])
    assert [(e.effect, e.axis) for e in found.effects] == [("payload", "A")]
    assert found.shrink["A"]["u"].share > 0.9
    moment = {s.name: s.after for s in found.effects[0].size}
    assert moment["payload.my"] / moment["payload.mz"] == pytest.approx(-0.8 / 0.5, rel=0.1)  # its lever


@pytest.mark.parametrize("when", [[(5.0, 9.0)], [(1.5, 3.5), (6.0, 7.5)], [(0.0, 9.0)]])
def test_when_a_cause_acts_is_told_by_its_own_columns(
    known_days: Reference, when: list[tuple[float, float]]
) -> None:
    s = known_days.logs[0]
    c = s.axes["X"]
    on = np.any([(s.t >= a) & (s.t < b) for a, b in when], axis=0)
    log = replace(s, axes={**s.axes, "X": {**c, "left": c["left"] + 1.5 * c["dry"] * on}})
    row = Row("friction_since", "X", "onset", 0.0, {}, 0.0, 1, 1.0, 0.1, 10.0, 0.2, [0.0], 1.0, 9.0)
    found = spells(known_days, [log], ("X", "plant"), row)
    if when == [(0.0, 9.0)]:
        assert found == []  # it always acts
        return
    assert [k for k, _, _ in found] == [0] * len(when)
    for (_, a, b), (begin, end) in zip(found, when, strict=True):
        assert a == pytest.approx(begin, abs=0.3)
        assert b == pytest.approx(end, abs=0.3)


@pytest.mark.parametrize(
    ("name", "since", "told"),
    [
        ("coulomb", [], {"kind": "always"}),
        ("friction_since", [4.0], {"kind": "since", "from": 4.0}),
        ("friction_at_start", [0.3, 0.02], {"kind": "after", "event": "start", "time_constant": 0.3}),
        ("torque_fades", [], {"kind": "growing", "from": 0.0}),
    ],
)
def test_a_cause_has_a_course_in_the_time_of_the_log(
    known_days: Reference, name: str, since: list[float], told: dict[str, object]
) -> None:
    s = known_days.logs[0]
    begin = float(s.motion.t[0])
    row, at = Row(name, "X", "onset", since=since), Place(known_days, "X", [s])
    assert when(row, at) == {k: begin + x if k == "from" else x for k, x in told.items()}
    assert (
        when(replace(row, spans=[(0, 1.0, 2.0)]), at) == {}
    )  # what comes at instants has its place in `where`


def test_a_change_that_no_row_tells_is_in_the_middle_of_them() -> None:
    told = np.r_[np.full(50, -1.0), np.zeros(100), np.full(50, 1.0)]
    assert np.flatnonzero(acting(told, 8.0))[0] == pytest.approx(100, abs=1)
    assert not acting(np.r_[-np.ones(50), np.full(5, 1.0), -np.ones(50)], 8.0).any()  # not worth its price


def test_a_further_cause_is_measured_beside_those_that_were_found(known_days: Reference) -> None:
    """What the first cause closed is no longer open: the next closes a part of the rest."""
    q = Question.of(known_days, [s for s in known_days.logs if s.log == 0])
    axes = [s.axes["X"] for s in q.logs]
    rest = [3.0 * np.sin(9.0 * s.t) for s in q.logs]
    made = [200.0 * c["v"] + y for c, y in zip(axes, rest, strict=True)]
    whole, last = (
        replace(q, left=[{**x, ("X", "plant"): x["X", "plant"] + y} for x, y in zip(q.left, z, strict=True)])
        for z in (made, rest)
    )
    acts = [{"plant": c["v"][:, None]} for c in axes]
    found = replace(_friction("viscous", 60.0), acts={"X": acts}, numbers=np.array([200.0]))
    alone, beside = Asked(whole), Asked(whole, [found])
    assert beside.open["X", "plant"] < 1.2 * Asked(last).open["X", "plant"] < 0.01 * alone.open["X", "plant"]
    assert beside.open["A", "plant"] == pytest.approx(alone.open["A", "plant"])


def test_what_gains_follow_is_as_large_as_its_effort(known_days: Reference) -> None:
    """A body whose gains explain a controller, and which weighs nothing, is none."""
    q = Question.of(known_days, [s for s in known_days.logs if s.log == 0])
    law = [
        {**x, ("X", "law"): x["X", "law"] + 0.5 * s.axes["X"]["u"]}
        for s, x in zip(q.logs, q.left, strict=True)
    ]
    assert not [r for r in Asked(replace(q, left=law)).rows() if r.name == "payload" and r.score > 0.0]


def test_instants_are_dearer_by_their_number_but_for_their_order() -> None:
    each = [instants(k) for k in range(1, 5)]
    assert each[0] == pytest.approx(8.0)
    assert np.diff(each) == pytest.approx(8.0 - np.log([2.0, 3.0, 4.0]))


def test_a_screen_names_one_cause_at_most(folder: Path, twin: pt.Twin) -> None:
    day = Day(command=30, noise=40, friction={"X": 0.3}, kp={"A": 0.6})
    log = str(write(folder, "two", day))
    assert len(pt.diagnose(twin, log).effects) > 1
    assert len(pt.diagnose(twin, log, quick=True).effects) == 1


def test_causes_that_a_log_cannot_tell_apart_are_named_as_one() -> None:
    rows = [_friction("friction_scale", 60.0), _friction("coulomb", 59.5), _friction("viscous", 20.0)]
    case = Case.of(rows, {}, {"X": 0.01})
    found = named(case, np.array([0.02, 0.04, 0.5, 0.4, 0.04]), 0)
    assert found.row.name == "friction_scale"
    assert found.probability == pytest.approx(0.94 / 0.98)
    assert [r.name for r in found.alike] == ["coulomb"]


def test_what_nothing_found_acts_on_is_as_open_as_before() -> None:
    at = {"X plant": 9.0, "A plant": 4.0}

    def open_to_nothing(touched: tuple[str, ...]) -> float:
        case = Case.of([_friction("coulomb", 50.0)], at, {"X": 0.01}, touched)
        return float(case.features({})[0, len(FEATURES) + len(GROUP_NAMES) + 1])

    whole, other, none = map(open_to_nothing, [(), ("X plant",), ("X plant", "A plant")])
    assert whole == pytest.approx(np.arcsinh(9.0 - 1.5))
    assert other == pytest.approx(np.arcsinh(4.0 - 1.5))
    assert none == 0.0


@pytest.mark.parametrize(
    ("second", "named_too"),
    [
        (0.045, True),
        (0.025, False),
        (0.005, False),
    ],  # of 5 % that are left: nearly all, half, less than a word
)
def test_a_small_cause_is_named_beside_a_large_one_if_it_closes_what_that_leaves(
    second: float, named_too: bool
) -> None:
    def closed(share: float) -> Closed:
        return Closed(np.ones(1), np.array([share]), share, "validation")

    large, small = (Named(_friction(k, 50.0), 0.9, []) for k in ("coulomb", "viscous"))
    answer: Any = SimpleNamespace(
        closed={"X": [(large, closed(0.95)), (small, closed(second))]},
        between={},
        named=[large, small],
        c=SimpleNamespace(worth=0.01),
    )
    assert Answer.adds(answer, large)
    assert Answer.adds(answer, small) == named_too


def _friction(name: str, score: float) -> Row:
    return Row(
        name, "X", "friction", score, {"plant": score}, 2.0, 1, 0.5, 0.01, 50.0, 0.2, [score], 1.0, 9.0
    )


def test_a_late_command_is_a_fault_of_the_recording(folder: Path, twin: pt.Twin) -> None:
    log = pt.read(folder / "none_0.csv")
    late = {k: np.asarray(log[k]) for k in log.channels}
    late["X.qr"] = np.r_[np.full(6, late["X.qr"][0]), late["X.qr"][:-6]]
    found = pt.diagnose(twin, pt.Log(late))
    assert list(found.effects) == []
    assert [(x["fault"], x["axis"]) for x in found.recording] == [("command_late", "X")]
    assert found.recording[0]["size"] == pytest.approx(0.024, abs=0.004)
    assert found.recording[0]["unit"] == "s"
    assert (found.recording[0]["from"], found.recording[0]["to"]) == (log["t"][0], log["t"][-1])
    assert found.verdict == "unexplained"


def test_a_frozen_effort_is_said_to_be_from_when_to_when(folder: Path, twin: pt.Twin) -> None:
    log = pt.read(folder / "none_0.csv")
    c = {k: np.asarray(log[k]) for k in log.channels}
    held, t = c["X.u"].copy(), c["t"]
    rows = (t > t[0] + 3.0) & (t < t[0] + 4.5)
    held[rows] = held[rows][0]
    found = pt.diagnose(twin, pt.Log(c | {"X.u": held}))
    assert [(x["fault"], x["axis"]) for x in found.recording] == [("frozen", "X")]
    assert found.recording[0]["from"] == pytest.approx(t[0] + 3.0, abs=0.02)
    assert found.recording[0]["to"] == pytest.approx(t[0] + 4.5, abs=0.02)


@pytest.mark.parametrize("situation", ["change", "structure"])
def test_evidence_and_limits_have_the_keys_of_the_contract(
    folder: Path, twin: pt.Twin, situation: str
) -> None:
    log = folder / "none_0.csv"
    found = pt.diagnose(twin if situation == "change" else twin.machine, log).to_dict()
    assert found["schema"] == 2
    assert found["evidence"] or situation == "structure"
    for x in found["evidence"]:
        assert {*x["score"]} == {"u", "law", "ql"}
        assert x["class"][0] == x["effect"]
        assert 0.0 <= x["p"] <= 1.0
        assert x["axis"] in twin.machine.names
    for x in found["detectable"]:
        assert {"effect", "axis", "size", "unit"} <= {*x}
    if situation == "change":
        assert sum(x["p"] for x in found["evidence"]) <= 1.0 + 1e-9


@pytest.mark.parametrize(
    ("axis", "limit", "level"),
    [("X", (110.0, 0.0, 0.0), 110.0), ("A", (5.5, 0.0, 4.0), 5.5), ("X", (170.0, 180.0, 0.0), 170.0)],
    ids=["always", "folded back", "falls with speed"],
)
def test_a_drive_at_its_limit_is_a_law_that_is_clipped(
    folder: Path, twin: pt.Twin, axis: str, limit: tuple[float, float, float], level: float
) -> None:
    found = _asked(folder, twin, "limit", limit={axis: limit})
    assert [(e.effect, e.axis) for e in found.effects] == [("saturation", axis)]
    assert found.effects[0].size[0].after == pytest.approx(level, rel=0.05)
    assert found.effects[0].confidence > 0.8


@pytest.mark.parametrize("band", [5e-4, 1e-3])
def test_a_controller_that_does_nothing_near_its_command_has_a_dead_band(
    folder: Path, twin: pt.Twin, band: float
) -> None:
    found = _asked(folder, twin, "idle", idle={"X": band})
    assert [(e.effect, e.axis) for e in found.effects][:1] == [("dead_band", "X")]
    assert found.effects[0].size[0].after == pytest.approx(band, rel=0.15)


@pytest.mark.parametrize(
    ("field", "off", "on", "effect", "before", "after"),
    [
        ("forward", None, {"X": 0.8}, "velocity_feedforward.share", 0.9, 0.8),
        ("forward", {"X": 0.0}, {"X": 0.9}, "velocity_feedforward.share", 0.0, 0.9),
        ("ki", {"X": 0.0}, {"X": 1.0}, "integral.ki", 0.0, 70000.0),
    ],
)
def test_a_number_of_the_controller_may_have_been_off(
    folder: Path,
    twin: pt.Twin,
    field: str,
    off: dict[str, float] | None,
    on: dict[str, float],
    effect: str,
    before: float,
    after: float,
) -> None:
    if off is not None:
        days = [Day(command=10 + k, noise=20 + k, **{field: off}) for k in range(3)]
        twin = pt.identify(twin.machine, [str(write(folder, f"off_{k}", day)) for k, day in enumerate(days)])
    found = _asked(folder, twin, f"{field}_{on}", **{field: on})
    assert [(e.effect, e.axis) for e in found.effects] == [(effect.partition(".")[0], "X")]
    size = found.effects[0].size[0]
    assert (size.name, found.verdict) == (effect, "explained")
    assert (size.before, size.after) == pytest.approx((before, after), rel=0.05, abs=0.03 * after)
    assert found.effects[0].shrink["e"].share > 0.98


def test_an_acceleration_feed_forward_that_was_off_is_an_inertia(folder: Path, twin: pt.Twin) -> None:
    found = _asked(folder, twin, "told", ahead=0.9)
    assert {(e.effect, e.axis) for e in found.effects} == {("acceleration_feedforward", k) for k in "XA"}
    sizes = {e.axis: e.size[0] for e in found.effects}
    for axis, inertia in (("X", CARRIAGE + ARM), ("A", INERTIA)):
        assert (sizes[axis].before / inertia, sizes[axis].after / inertia) == pytest.approx(
            (0.0, 0.9), abs=0.03
        )
        assert sizes[axis].unit == {"X": "kg", "A": "kg·m²"}[axis]


@pytest.mark.parametrize(
    ("share", "proportional", "integrated"),
    [(0.92, 1.0, True), (0.92, 0.25, True), (0.0, 1.0, True), (0.9, 1.0, False)],
)
def test_the_share_of_a_feed_forward_is_told_by_what_the_loop_integrates(
    share: float, proportional: float, integrated: bool
) -> None:
    kv, ki, kp = 60.0, 2400.0, 55.0
    gains = {"e": kv * kp + ki, "ie": ki * kp, "v": -kv, "vr": proportional * share * kv}
    gains["qr"] = ki * (share * integrated - 1.0)
    found = Law(np.array([gains.get(k, 0.0) for k in TERMS]))
    assert found.cascade == pytest.approx((kp, ki))
    assert found.ahead == pytest.approx((share, proportional * kv, ki * integrated), rel=1e-2, abs=1e-9)


def test_without_a_feed_forward_the_command_tells_the_integral_beside_gains_that_noise_has_moved() -> None:
    kp, kv, ki = 31.4, 13700.0, 287000.0
    gains = {"e": 1.006 * (kv * kp + ki), "ie": kp * ki, "v": -1.03 * kv, "qr": -ki}
    found = Law(np.array([gains.get(k, 0.0) for k in TERMS]))
    assert found.cascade == pytest.approx((kp, ki))


def test_an_effort_is_told_as_it_was_before_a_filter_of_first_order() -> None:
    lag, step = 2e-3, 1e-3
    t = step * np.arange(2000)
    late = np.exp(2j * np.pi * 20.0 * t) / (1.0 + 2j * np.pi * 20.0 * lag)
    law = Law(np.array([-lag if k == "du" else 0.0 for k in TERMS]))
    found = law.unfiltered(np.column_stack([late.real, late.imag]), step)
    assert found[1:-1, 0] == pytest.approx(np.cos(2.0 * np.pi * 20.0 * t)[1:-1], abs=2e-3)


@pytest.mark.parametrize(
    ("speed", "pull", "tells"),
    [(1.488e-3, 0.0, False), (1.3e-3, 0.0, True), (1.488e-3, 1.0, True), (1e-5, 0.0, True)],
    ids=["24 Hz below the third multiple of 1 kHz", "400 Hz", "passing", "slower than the log"],
)
def test_a_law_is_not_judged_where_steps_of_an_encoder_come_and_go_slowly(
    speed: float, pull: float, tells: bool
) -> None:
    c = {k: np.full(9, x) for k, x in {"q": 0.0, "vr": speed, "ar": pull}.items()}
    assert _clear(c, 1e-3, 5e-7).tolist() == [float(tells)] * 9
    assert _clear(c, 1e-3, 0.0).all()  # steps that nobody knows


def test_a_controller_that_acts_late_is_a_delay_though_its_effort_is_what_the_plant_needs(
    folder: Path, twin: pt.Twin
) -> None:
    found = _asked(folder, twin, "late", late={"X": 1})
    assert [(e.effect, e.axis) for e in found.effects] == [("delay", "X")]
    assert found.effects[0].size[0].after == pytest.approx(0.004, rel=0.15)


def test_a_command_that_jitters_is_no_limit(folder: Path, twin: pt.Twin) -> None:
    """Efforts elsewhere reach beyond any level at which they stand."""
    log, rng = pt.read(folder / "none_0.csv"), np.random.default_rng(0)
    rows = np.arange(len(log))
    late = np.abs(rng.normal(0.0, 0.3, len(log))) + (rng.random(len(log)) < 0.005)
    channels = {k: np.asarray(log[k]) for k in log.channels}
    channels |= {f"{k}.qr": np.interp(rows - late, rows, channels[f"{k}.qr"]) for k in "XA"}
    found = pt.diagnose(twin, pt.Log(channels))
    assert "saturation" not in {e.effect for e in [*found.effects, *found.possible]}


def test_a_command_rougher_than_the_drive_followed_is_a_fault_of_the_recording(
    folder: Path, twin: pt.Twin
) -> None:
    log, rng = pt.read(folder / "none_0.csv"), np.random.default_rng(0)
    channels = {k: np.asarray(log[k]) for k in log.channels}
    speed = np.abs(np.gradient(channels["X.qr"], channels["t"]))
    channels["X.qr"] = channels["X.qr"] + 6e-4 * speed * rng.normal(size=len(log))
    found = pt.diagnose(twin, pt.Log(channels))
    assert [(x["fault"], x["axis"]) for x in found.recording] == [("command_jitter", "X")]
    assert not found.effects


def test_rows_written_twice_are_a_fault_of_the_recording(folder: Path, twin: pt.Twin) -> None:
    log, rng = pt.read(folder / "none_0.csv"), np.random.default_rng(0)
    rows = np.sort(np.r_[: len(log), rng.choice(len(log), len(log) // 50, replace=False)])
    spoilt = pt.Log(
        {**{k: np.asarray(log[k])[rows] for k in log.channels}, "t": np.arange(len(rows)) * 0.002}
    )
    found = pt.diagnose(twin, spoilt)
    assert list(found.effects) == []
    assert [x["fault"] for x in found.recording] == ["rows_doubled"]
    same = replace(twin, data=[*twin.data, pt.identify(twin.machine, spoilt, loop=False).data[0]])
    assert not pt.diagnose(same, spoilt).recording  # the recorder of its own logs does so, too


@pytest.mark.parametrize(("ahead", "lag"), [(0.0, 0.0), (1e-3, 0.0), (0.0, 2e-3)])
def test_a_law_is_split_into_its_cascade(ahead: float, lag: float) -> None:
    """Also where the loop is closed on a load that runs ahead of its motor [m], and behind filters [s]."""
    rng, n = np.random.default_rng(1), 4000
    e, v, vr, a, ar, jr, qr = rng.standard_normal((7, n)) * np.array([[1e-3], [1], [1], [5], [5], [9], [1]])
    ie = np.cumsum(e) / 250.0
    kp, kv, ki = 40.0, 1800.0, 70000.0
    lead = ahead * rng.standard_normal(n)
    # kv (kp e + f vr - v) + ki int(kp e + f vr - v), and int v = q = qr - e - lead
    asked = kv * (kp * e + 0.9 * vr - v) + ki * (kp * ie + 0.9 * qr - (qr - e - lead))
    du = 1e5 * rng.standard_normal(n)
    columns = {"e": e, "ie": ie, "v": v, "a": a, "vr": vr, "ar": ar, "jr": jr, "qr": qr, "lead": lead}
    law = Law.fitted([columns | {"u": asked - lag * du, "du": du}])
    assert law.gains[-1] == pytest.approx(ki * (ahead > 0.0), rel=1e-6)
    assert law.gains[TERMS.index("du")] == pytest.approx(-lag, abs=1e-9)
    assert law.stable
    assert law.cascade == pytest.approx((kp, ki), rel=1e-6)


def test_a_misfit_grows_with_travel_and_speed_beyond_the_twins_own(twin: pt.Twin) -> None:
    r = reference(twin, ["X", "A"])
    assert r is not None
    s, left = r.logs[0], r.residuals(r.logs[0])
    low, high, speed = np.transpose([x.axes["X"]["reach"] for x in r.logs])
    travel = high.max() - low.min()

    def going(*reach: float) -> Stretch:
        return replace(s, axes={**s.axes, "X": {**s.axes["X"], "reach": np.array(reach)}})

    # as far as the twin's own, elsewhere
    wide = going(high.max() + travel, high.max() + 2.0 * travel, 0.0)
    assert r.beyond("X", r.logs) == 1.0
    assert r.beyond("X", [wide]) == pytest.approx(3.0)
    assert r.beyond("X", [s, going(0.0, 0.0, 5.0 * speed.max())]) == pytest.approx(5.0)
    own, beyond = ((cells(r, [x], [left], "X")["plant"].x[-1] ** 2).sum() for x in (s, wide))
    assert own / beyond == pytest.approx(9.0)


def test_whitening_recovers_an_autoregression() -> None:
    rng, x = np.random.default_rng(2), np.zeros(20000)
    for k in range(1, len(x)):
        x[k] = 0.8 * x[k - 1] + rng.standard_normal()
    w = Whitening.measured([x], [np.ones(len(x))])
    y = w(x[:, None])[:, 0]
    assert abs(float(y[1:] @ y[:-1]) / float(y @ y)) < 0.15  # a white floor of 5 % leaves some of the 0.8
    assert w.sigma**2 * len(y) == pytest.approx(float(y @ y), rel=0.05)


def test_rows_where_an_axis_turns_round_count_by_what_healthy_logs_leave_there() -> None:
    x, one = np.random.default_rng(3).standard_normal(20000), np.ones(20000)
    turns = (np.arange(len(x)) // 200) % 5 == 0
    c = {"moving": one - turns, "going": one, "one": one}
    w = Whitening.measured([x], [c["moving"]])
    counts = w.turns([np.where(turns, 3.0 * x, x)], [c]).counts(c, "plant")
    assert sorted(set(counts)) == [0.0, pytest.approx(1.0 / 3.0, rel=0.1), 1.0]
    assert (counts[turns][7:] < 0.5).all()
    none = w.turns([x], [{**c, "moving": one}])  # no own day has turned
    assert none.counts(c, "plant")[turns].max() < 1e-3


def test_a_form_is_searched_between_the_shapes_that_are_tried() -> None:
    axis = EFFECTS["drive_flexibility"].on(pt.Machine.load("emps"), "X")
    tried = [axis.shaped([f, d]) for f in (10.0, 20.0, 40.0) for d in (0.03, 0.1, 0.3)]
    truth = np.log([26.0, 0.06])

    def gain(effect: Effect) -> float:
        off = np.log(effect.shape_values()) - truth
        return 9.0 - float(off @ [[1.0, 0.4], [0.4, 1.0]] @ off)  # the one hangs on the other

    found = _polished(tried, max(tried, key=gain), gain)
    assert found.shape_values() == pytest.approx((26.0, 0.06), rel=0.15)


def test_what_is_in_the_reading_alone_leaves_the_simulated_machine_as_it_was(known_days: Reference) -> None:
    row = Row("friction_scale", "X", "friction", theta=0.5)
    for what, same in (("", False), (READ, True)):
        later, held = changed(known_days.twin, [(replace(row, what=what), "X")], known_days.laws)
        assert (later is known_days.twin, held) == (same, {"X"})


def test_what_a_body_shows_on_no_axis_is_none_of_its_numbers(known_days: Reference) -> None:
    columns = bodies(known_days, known_days.logs[0])["payload"]
    seen = np.any([x.any(axis=0) for x in columns.values()], axis=0)
    assert seen.tolist() == [True, True, False, True, True]  # the arm turns about y


def test_a_score_knows_the_number_and_its_error() -> None:
    rng, cells, size = np.random.default_rng(3), [], 60
    for _ in range(80):
        x = rng.standard_normal(size)
        y = 0.3 * x + rng.standard_normal(size)
        block = np.column_stack([np.zeros(size), np.ones(size) * 0.05, x, y])
        cells.append(block)
    k = np.arange(80)
    c = Cells(padded(cells), np.full(80, float(size)), 0 * k, k % 6, 0.0 * k, 1, {"x": np.array([2])})
    with_it, alone = score([(c, np.array([2]))], 1), score([(c, np.zeros(0, dtype=int))], 0)
    assert with_it.theta[0] == pytest.approx(0.3, abs=0.05)
    assert with_it.error[0] == pytest.approx(1.0 / np.sqrt(80 * size), rel=0.1)
    gain = float(with_it.held[0].sum() - alone.held[0].sum())
    assert gain == pytest.approx(0.5 * 80 * size * np.log1p(0.3**2), rel=0.15)


def test_a_score_finds_the_number_of_loud_cells_beside_quiet_ones_that_it_leaves_worse() -> None:
    """From nothing the quiet cells keep their weight, and hold the number at none."""
    rng, cells, size = np.random.default_rng(5), [], 60
    for k in range(80):
        x = rng.standard_normal(size) * (1.0 if k % 4 else 0.05)
        y = (300.0 * x if k % 4 else 0.0) + rng.standard_normal(size)
        block = np.column_stack([np.zeros(size), np.ones(size) * 0.05, x, y])
        cells.append(block)
    k = np.arange(80)
    c = Cells(padded(cells), np.full(80, float(size)), 0 * k, k % 6, 0.0 * k, 1, {"x": np.array([2])})
    assert score([(c, np.array([2]))], 1).theta[0] == pytest.approx(300.0, rel=0.01)


def test_a_large_cause_whose_form_is_a_tenth_off_outdoes_one_that_fits_half_of_the_cells() -> None:
    """What is left of it is many times the noise, and a tenth of what it does."""
    rng, cells, count, size = np.random.default_rng(6), [], 300, 2
    for k in range(count):
        x = 300.0 * rng.standard_normal(size)
        y = x + 30.0 * rng.standard_normal(size)
        half = y * (k % 20 < 11)
        block = np.column_stack(
            [np.zeros(size), np.ones(size) * 0.05, x, half, y + rng.standard_normal(size)]
        )
        cells.append(block)
    k = np.arange(count)
    c = Cells(padded(cells), np.full(count, float(size)), 0 * k, k % 6, 0.0 * k, 1, {})
    near, exact = (score([(c, np.array([at]))], 1) for at in (2, 3))
    assert near.held[0].sum() > exact.held[0].sum()
    rest = float(near.left[0].sum())  # told as it is
    assert rest == pytest.approx(count * size * 30.0**2, rel=0.2)


def test_an_onset_is_found_to_the_row() -> None:
    t = np.arange(0.0, 10.0, 0.008)
    course = np.sin(3.0 * t)
    left = course * (t > 6.4) + 0.05 * np.random.default_rng(4).standard_normal(len(t))
    assert onset(SimpleNamespace(t=t), course, left, np.zeros((len(t), 0))) == pytest.approx(6.4, abs=0.1)  # type: ignore[arg-type]
