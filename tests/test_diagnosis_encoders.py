"""The second encoder: elasticity, lost motion and pitch straight from motor against load, with known truth."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.diagnosis import diagnose
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.machine import Machine

K, ROTOR, LOAD = 2.0e6, 30.0, 65.0  # N/m, kg, kg
NOISE = 5e-8  # m


def bump(x):
    """Return a worn place of a screw, 4 cm wide."""
    return np.exp(-(((x - 0.05) / 0.03) ** 2))


def run(seed, gap=0.0, pitch=0.0, k=K, load=True, seconds=16.0):
    """Return a log of a slide on a spring: the load's path is given, the motor's follows from it."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1e-3)
    w = 2.0 * np.pi * np.concatenate([rng.uniform(0.1, 2.0, 4), rng.uniform(4.0, 9.0, 3)])
    size = np.concatenate([[0.08, 0.03, 0.02, 0.02], [4e-4, 3e-4, 2e-4]])
    angle = np.outer(t, w) + rng.uniform(0.0, 2.0 * np.pi, len(w))
    x, v = np.sin(angle) @ size, np.cos(angle) @ (size * w)
    a = -np.sin(angle) @ (size * w**2)
    force = LOAD * a
    twist = force / k + 0.5 * gap * np.tanh(v / 1e-4) + pitch * bump(x)
    motor = a + np.sin(angle) @ (size * w**4) * LOAD / k  # the load's inertia bends the spring
    u = force + ROTOR * motor + 30.0 * v + rng.normal(0.0, 0.5, len(t))
    out = {"t": t, "X.q": x + twist + rng.normal(0.0, NOISE, len(t)), "X.u": u}
    if load:
        out["X.ql"] = x + rng.normal(0.0, NOISE, len(t))
    return Log(out, source=f"{seed}.csv")


@pytest.fixture(scope="module")
def machine():
    return dataclasses.replace(Machine.load("emps"), columns={})


@pytest.fixture(scope="module")
def twin(machine):
    return identify(machine, run(1), loop=False)


def of(found, effect):
    return next((e for e in found.effects if e.effect == effect and "ql" in e.shrink), None)


def test_stiffness_comes_from_motor_against_load(machine):
    found = diagnose(machine, run(1), quick=True)
    spring = of(found, "drive_flexibility")
    size = spring.size[0]
    assert size.after == pytest.approx(K, rel=0.05)
    assert size.interval[0] < K < size.interval[1]
    assert size.interval[1] < 1.2 * size.interval[0]
    assert spring.shape["frequency"] == pytest.approx(np.sqrt(K / LOAD) / (2.0 * np.pi), rel=0.15)


def test_lost_motion_is_backlash_with_its_size(machine):
    found = diagnose(machine, run(1, gap=6e-5), quick=True)
    size = of(found, "backlash").size[0]
    assert size.after == pytest.approx(6e-5, rel=0.1)
    assert size.interval[0] < 6e-5 < size.interval[1] < size.interval[0] + 1e-5


def test_the_pitch_error_is_a_table_along_the_stroke(machine):
    found = diagnose(machine, run(1, pitch=4e-5), quick=True)
    table = of(found, "encoder_error")
    places = [float(s.name.split()[1]) for s in table.size[1:]]
    truth = 4e-5 * bump(np.array(places))
    said = np.array([s.after for s in table.size[1:]])
    assert np.corrcoef(truth, said)[0, 1] > 0.97
    assert any(r.signal == "ql" and r.kind == "position" for r in found.where)


def test_it_has_a_signal_of_its_own(machine):
    found = diagnose(machine, run(1, gap=6e-5), quick=True)
    gap = found.gap["X"]["ql"]
    assert gap.after < 0.5 * gap.rms
    assert found.to_dict()["gap"]["X"]["ql"]["rms"] == pytest.approx(gap.rms)


def test_a_stiff_drive_is_not_called_flexible(machine):
    found = diagnose(machine, run(1, k=1e12), quick=True)
    assert not {e.effect for e in found.effects} & {"drive_flexibility", "joint_flexibility", "backlash"}


def test_of_a_twin_only_what_has_changed_is_named(twin):
    found = diagnose(twin, run(2), quick=True)
    assert found.verdict == "none"
    worn = diagnose(twin, run(2, gap=6e-5), quick=True)
    size = of(worn, "backlash").size[0]
    assert size.after - size.before == pytest.approx(6e-5, rel=0.1)
    assert of(worn, "drive_flexibility") is None
    assert "X backlash" in worn.sentence


def test_a_softer_drive_is_said_from_what_to_what(twin):
    size = of(diagnose(twin, run(2, k=0.4 * K), quick=True), "drive_flexibility").size[0]
    assert size.before == pytest.approx(K, rel=0.1)
    assert size.after == pytest.approx(0.4 * K, rel=0.1)


def bench(data_dir, name, machine, *, load):
    table = np.loadtxt(data_dir / "two_inertia" / f"multisine_{name}.csv", delimiter=",", skiprows=1).T
    rows = {"t": table[0], "X.u": table[2], "X.q": table[3]}
    return Log({**rows, **({"X.ql": table[4]} if load else {})}, source=name)


@pytest.fixture(scope="module")
def rotor(tmp_path_factory):
    folder = tmp_path_factory.mktemp("two")
    (folder / "m.urdf").write_text(
        '<robot name="two"><link name="b"/><link name="L"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" '
        'izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="X" type="continuous"><parent link="b"/>'
        '<child link="L"/><axis xyz="0 0 1"/><limit effort="100" velocity="100"/></joint></robot>'
    )
    (folder / "machine.yaml").write_text(
        "name: two\nurdf: m.urdf\naxes:\n  X: {joint: X, effects: [viscous, coulomb, offset]}\n"
    )
    return Machine.load(folder)


def test_a_real_drive_shows_its_mode_without_the_load_encoder(data_dir, rotor):
    first = diagnose(rotor, bench(data_dir, "A", rotor, load=False), quick=True).effects[0]
    assert first.effect == "drive_flexibility"
    assert first.shape["resonance"] == pytest.approx(76.0, abs=3.0)


def test_a_real_drive_shows_stiffness_and_damping_with_it(data_dir, rotor):
    stiffness = {}
    for name in "AB":
        found = diagnose(rotor, bench(data_dir, name, rotor, load=True), quick=True)
        stiffness[name], damping = of(found, "drive_flexibility").size[:2]
        assert damping.interval[0] < damping.after < damping.interval[1]
    a, b = stiffness["A"], stiffness["B"]
    assert a.interval[0] < b.after < a.interval[1]
    assert a.after == pytest.approx(565.0, rel=0.03)


def test_two_runs_of_one_real_drive_have_not_changed(data_dir, rotor):
    own = identify(rotor, bench(data_dir, "A", rotor, load=True), loop=False)
    found = diagnose(own, bench(data_dir, "B", rotor, load=True), quick=True)
    assert found.verdict == "none"
    assert found.effects == []


STRANGE = {
    "late by a second": lambda t, q, ql: np.interp(t - 1.0, t, ql),
    "early by a second": lambda t, q, ql: np.interp(t + 1.0, t, ql),
    "another axis adds to it": lambda t, q, ql: ql - 1.5 * 0.05 * np.sin(2.0 * np.pi * 0.37 * t),
    "moves less far": lambda t, q, ql: 0.39 * ql,
    "turned round": lambda t, q, ql: -ql,
    "ahead of the force": lambda t, q, ql: 2.0 * q - ql,
    "play of the wrong sign": lambda t, q, ql: ql + 4e-5 * np.sign(np.gradient(q)),
    "damping of the wrong sign": lambda t, q, ql: ql + 5e-3 * np.gradient(q - ql, t),
    "noise": lambda t, q, ql: ql + 1e-4 * np.random.default_rng(5).normal(size=len(t)),
    "in coarse steps": lambda t, q, ql: np.round(ql / 1e-4) * 1e-4,
}
POSITIVE = ("stiffness", "damping", "rotor", "gap")


@pytest.mark.parametrize("kind", STRANGE)
@pytest.mark.parametrize("change", [False, True], ids=["machine", "twin"])
def test_no_number_that_no_machine_has_is_said(machine, twin, kind, change):
    log = run(2)
    other = STRANGE[kind](log.t, log["X.q"], log["X.ql"])
    found = diagnose(
        twin if change else machine, Log({**log.channels, "X.ql": other}, source="odd.csv"), quick=True
    )
    for effect in (e for e in found.effects if "ql" in e.shrink):
        for size in (s for s in effect.size if s.name.rpartition(".")[2] in POSITIVE):
            assert size.after >= 0.0, size
            assert size.before >= 0.0, size
            assert 0.0 <= size.interval[0] <= size.after <= size.interval[1], size
    text = " ".join([*found.warnings, *found.advice])
    assert "is taken 1" not in text  # a second is no time between two encoders on one clock


@pytest.mark.parametrize("speed", [0.016, 0.1])
def test_play_at_one_speed_is_no_delay_between_the_encoders(machine, speed):
    """To and fro at one speed v, sign(v) and the effort of friction are nearly one column."""

    def log(gap, seed):
        rng = np.random.default_rng(seed)
        t = np.arange(0.0, 20.0, 2e-3)
        v = speed * np.clip(8.0 * np.sin(2.0 * np.pi * t / 5.0), -1.0, 1.0)
        x = np.cumsum(v) * 2e-3
        u = 95.0 * np.gradient(v, t) + 100.0 * np.tanh(v / 1e-4) + rng.normal(0.0, 2.0, len(t))
        q = x + 0.5 * gap * np.tanh(v / 1e-4) + rng.normal(0.0, NOISE, len(t))
        return Log(
            {"t": t, "X.q": q, "X.ql": x + rng.normal(0.0, NOISE, len(t)), "X.u": u}, source=f"{seed}.csv"
        )

    one = identify(machine, log(0.0, 1), loop=False)
    found = diagnose(one, log(5e-5, 2), quick=True)
    size = of(found, "backlash").size[0]
    assert size.after - size.before == pytest.approx(5e-5, rel=0.1)
    assert of(found, "drive_flexibility") is None
    assert of(diagnose(one, log(0.0, 3), quick=True), "backlash") is None


def test_lost_motion_of_a_screw_is_named(data_dir, tmp_path):
    case = data_dir.parent / "cases" / "drives" / "lost_motion"
    if not case.exists():
        pytest.skip("the cases beside the data are not here")
    machine = Machine.load(case)
    twin = identify(machine, pt.read(case / "one_h.csv"), loop=False)
    found = diagnose(twin, pt.read(case / "one_b.csv"), quick=True)
    assert [e.effect for e in found.effects] == ["backlash"]
    assert found.effects[0].size[0].after == pytest.approx(5e-5, rel=0.02)
