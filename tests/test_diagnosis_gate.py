"""What the logs can be asked: findings of ``check`` keep a diagnosis from questions that have no answer."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from pinotwin.cli.main import main
from pinotwin.diagnosis import diagnose
from pinotwin.diagnosis.candidates.patterns import Hum, patterns
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.diagnosis.data.gate import BARS, INSTANTS, gate
from pinotwin.effects import EFFECTS
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.logs.prepared import Prepared
from pinotwin.logs.write import write_log
from pinotwin.machine import Machine
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.conftest import ROOT
from tests.rig import write_machine


def record(urdf_dir, path, *inject):
    virtual = VirtualMachine.load(urdf_dir / "emps", inject=inject)
    return virtual.record(random_trajectory(virtual, 8.0, path), seed=path).to_log()


@pytest.fixture(scope="module")
def machine():
    return dataclasses.replace(Machine.load("emps"), columns={})


@pytest.fixture(scope="module")
def log(urdf_dir):
    return record(urdf_dir, 7)


@pytest.fixture(scope="module")
def twin(machine, log):
    return identify(machine, log, loop=False)


@pytest.fixture(scope="module")
def other(urdf_dir):
    return record(urdf_dir, 8)


def slow(log):
    """Return the log as a shop-floor gateway has it: 10 Hz, positions to the millimetre."""
    step = round(0.1 / float(np.median(np.diff(log.t))))
    rows = {name: x[::step] for name, x in log.channels.items()}
    for name in ("X.q", "X.qr"):
        rows[name] = np.round(rows[name], 3)
    return Log(rows, source="slow.csv")


def changed(log, **channels):
    return Log({**log.channels, **{k.replace("_", "."): x for k, x in channels.items()}}, source="odd.csv")


def test_every_code_that_bars_something_is_one_that_check_gives():
    said = "".join(p.read_text() for p in (ROOT / "pinotwin" / "logs").rglob("*.py"))
    assert [code for code in BARS if f'"{code}"' not in said] == []
    assert {name for bar in BARS.values() for name in bar.effects} <= set(EFFECTS)


def test_a_good_log_can_be_asked_everything(machine, log):
    found = gate(machine, [Prepared(machine, log)])
    assert not found.effects
    assert not found.questions
    assert not found.silent
    assert all(found.admits(name, "X") for name in EFFECTS)


def test_what_happens_between_two_samples_is_not_looked_for(machine, log):
    found = gate(machine, [Prepared(machine, slow(log))])
    assert not any(found.admits(name, "X") for name in INSTANTS)
    assert found.admits("viscous", "X")
    assert not found.asks("servo", "X")
    assert not found.asks("tracking", "X")
    assert any("10 Hz" in text for text in found.warnings)


def test_no_cause_is_named_on_an_axis_in_another_unit_or_one_that_fell(machine, log):
    found = gate(machine, [Prepared(machine, changed(log, X_q=1000.0 * log["X.q"]))])
    assert found.nameless.keys() == {"X"}
    assert not found.asks("tracking", "X")


def test_one_coarse_log_among_good_ones_bars_and_is_named(machine, log):
    found = gate(machine, [Prepared(machine, log), Prepared(machine, slow(log))])
    assert not found.admits("presliding", "X")
    assert any(text.startswith("slow.csv: ") for text in found.warnings)


def test_a_slow_log_is_diagnosed_without_what_it_cannot_show(machine, log):
    found = diagnose(machine, slow(log), quick=True)
    assert not {e.effect for e in found.effects} & set(INSTANTS)
    assert "cannot show" in found.sentence
    assert any("10 Hz" in text for text in found.to_dict()["warnings"])


def test_no_pattern_swings_faster_than_half_the_rate(machine, log):
    tried = [e.frequency for e in patterns(compare(machine, [slow(log)], [])) if isinstance(e, Hum)]
    assert tried
    assert max(tried) < 5.0


def test_a_command_of_another_unit_is_not_held_against_the_servo(machine, log):
    found = gate(machine, [Prepared(machine, changed(log, X_qr=1e3 * log["X.qr"]))])
    assert not found.asks("tracking", "X")
    assert found.admits("presliding", "X")


def test_the_size_of_an_effort_is_no_effort(twin, other):
    found = diagnose(twin, changed(other, X_u=np.abs(other["X.u"])), quick=True)
    assert found.verdict == "unexplained"
    assert found.effects == []
    assert "X is not judged" in found.sentence
    assert "magnitude" in found.remains["X"]
    assert found.gap["X"]["u"].rms > 0.0


def test_a_current_counted_the_other_way_is_a_factor_below_zero(twin, other):
    found = diagnose(twin, changed(other, X_u=-0.9 * other["X.u"]), quick=True)
    assert [(e.effect, e.axis) for e in found.effects] == [("effort_scale", "X")]
    assert found.effects[0].theta["share"] == pytest.approx(-1.9, abs=0.01)
    assert "to -0.9 times its value" in found.sentence
    assert any("wrong sign" in w for w in found.warnings)


def test_without_a_twin_a_current_counted_the_other_way_is_not_judged(machine, other):
    found = diagnose(machine, changed(other, X_u=-other["X.u"]), quick=True)
    assert found.effects == []
    assert "wrong sign" in found.sentence


def set_anew(log):
    """Return the log with a counter that is set anew nine times, by 5 cm forth and back."""
    rows = np.linspace(0.1, 0.9, 9) * len(log)
    away = 0.05 * (np.searchsorted(rows, np.arange(len(log)), side="right") % 2)
    return changed(log, X_q=log["X.q"] + away, X_qr=log["X.qr"] + away)


def wrapped(log):
    """Return the log with a counter of 20 cm that starts again."""
    return changed(log, X_q=log["X.q"] % 0.2, X_qr=log["X.qr"] % 0.2)


@pytest.mark.parametrize(("spoil", "why"), [(set_anew, "leaps in"), (wrapped, "wraps around")])
def test_of_an_axis_whose_position_leaps_no_cause_is_named(twin, other, spoil, why):
    """The twin's effort at such a leap is a hundred times the real one: an effort of another scale was named."""
    found = diagnose(twin, spoil(other), quick=True)
    assert found.effects == []
    assert found.possible == []
    assert found.verdict == "unexplained"
    assert why in found.remains["X"]
    assert f"No cause is named on X: X.q {why}" in found.sentence


def test_of_a_machine_with_an_unstable_loop_no_cause_is_named(twin, other):
    rings = np.ptp(other["X.u"]) * np.sin(2.0 * np.pi * 60.0 * other.t)
    found = diagnose(twin, changed(other, X_u=rings), quick=True)
    assert (found.verdict, found.effects, found.possible) == ("unexplained", [], [])
    assert "No cause is named on X: X.u swings" in found.sentence


def test_the_twin_knows_an_effort_that_check_doubts(twin, other, monkeypatch):
    """A push against the motion may look like friction that drives: the twin says whose effort it is."""
    doubted = gate(twin.machine, [Prepared(twin.machine, changed(other, X_u=-other["X.u"]))])
    assert "X" in doubted.silent
    monkeypatch.setattr("pinotwin.diagnosis.data.comparison.gate", lambda machine, logs, sized: doubted)
    assert "X" not in compare(twin, [other], []).gate.silent


def test_an_axis_that_stood_still_in_one_of_the_logs_is_no_error(urdf_dir):
    """The twin's own logs moved an axis that the new ones do not: there is nothing to compare."""
    virtual = VirtualMachine.load(urdf_dir / "laser_driller")
    run = virtual.record(random_trajectory(virtual, 6.0, 3), seed=3).to_log()
    bare = dataclasses.replace(Machine.load("laser_driller"), columns={})
    own = identify(bare, run, loop=False)
    still = {n: np.full_like(x, x[0]) if n in ("X.q", "X.qr") else x for n, x in run.channels.items()}
    found = diagnose(own, Log(still, source="still.csv"), quick=True)
    assert "X" not in found.gap
    assert any("X hardly moves" in text for text in found.advice)


def test_the_command_prints_what_makes_the_log_doubtful(machine, log, tmp_path, capsys):
    dataclasses.replace(machine, spec={**machine.spec, "columns": {}}).save(tmp_path / "m")
    write_log(tmp_path / "slow.csv", dict(slow(log).channels))
    words = ["diagnose", str(tmp_path / "m"), str(tmp_path / "slow.csv"), "--quick"]
    assert main([*words, "--out", str(tmp_path / "d"), "--json", str(tmp_path / "d.json")]) == 0
    assert "warning: t: 10 Hz is too slow" in capsys.readouterr().out
    assert any("10 Hz" in text for text in json.loads((tmp_path / "d.json").read_text())["warnings"])


def test_an_axis_that_its_twin_never_met_is_not_judged(tmp_path):
    rig = Machine.load(write_machine(tmp_path / "rig"))
    t = np.arange(0.0, 12.0, 0.002)
    w = 2 * np.pi * np.array([0.5, 2.1])
    noise = np.random.default_rng(1)

    def run(still):
        waves = 0.1 * np.sin(np.outer(t, w) + np.array([0.3, 1.0]))
        q, a = waves.sum(axis=1), -waves @ w**2
        B = np.zeros_like(q) if still else q[::-1]
        u = {"X.u": 30.0 * a + noise.normal(0, 1, t.size), "B.u": 0.5 * B + noise.normal(0, 0.05, t.size)}
        return Log({"t": t, "X.q": q, "B.q": B, **u}, source="run.csv")

    twin = identify(rig, run(still=True), loop=False)
    found = diagnose(twin, run(still=False))
    assert "B" not in found.gap
    assert "B" not in {e.axis for e in found.effects}
    assert any("B: not judged, it moved in no log of its twin" in text for text in found.warnings)
