"""Nonsense in a log is named by its cause, in one line; sound logs, virtual and real, raise no such alarm."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.errors import LogError
from pinotwin.logs import Settings
from pinotwin.logs.plausible import unseen
from pinotwin.logs.prepare import prepare
from pinotwin.logs.prepared import Prepared
from pinotwin.logs.quality.results import Finding
from pinotwin.solve.lead import lag
from pinotwin.virtual import VirtualMachine, random_trajectory

Channels = dict[str, np.ndarray]

CAUSES = {
    "effort_sign",
    "effort_exchanged",
    "effort_late",
    "effort_early",
    "effort_scale",
    "effort_noise",
    "effort_stands",
    "effort_unsigned",
    "effort_weightless",
    "effort_frictionless",
    "command_is_position",
    "command_disagrees",
    "command_late",
    "clock_odd",
    "clock_unit",
    "position_unit",
    "position_scale",
    "position_exchanged",
    "position_sign",
}


@cache
def _recorded(name: str) -> Mapping[str, np.ndarray]:
    virtual = VirtualMachine.load(pt.machines()[name])
    return virtual.record(random_trajectory(virtual, 10.0, 3), seed=3).log


def recorded(name: str = "trunnion") -> Channels:
    return {k: np.array(x) for k, x in _recorded(name).items()}


def named(findings: Iterable[Finding]) -> set[tuple[str, str]]:
    return {(f.axis, f.code) for f in findings if f.code in CAUSES}


def causes(machine: pt.Machine, log: pt.Log) -> set[tuple[str, str]]:
    return named(pt.check(machine, log).findings)


def times(factor: float, *names: str) -> Callable[[Channels], None]:
    def spoil(c: Channels) -> None:
        for name in names:
            c[name] *= factor

    return spoil


def shifted(name: str, rows: int) -> Callable[[Channels], None]:
    return lambda c: c.update({name: np.roll(c[name], rows)})


def exchanged(a: str, b: str) -> Callable[[Channels], None]:
    return lambda c: c.update({a: c[b], b: c[a]})


def noise(name: str) -> Callable[[Channels], None]:
    return lambda c: c.update({name: np.random.default_rng(1).normal(size=len(c["t"]))})


def stands(name: str, level: float) -> Callable[[Channels], None]:
    return lambda c: c.update(
        {name: level + 0.02 * level * np.random.default_rng(1).normal(size=len(c["t"]))}
    )


SPOILED: list[tuple[str, Callable[[Channels], None], tuple[str, str]]] = [
    ("sign of one effort", times(-1, "A.u"), ("A", "effort_sign")),
    ("sign of a linear axis", times(-1, "Y.u"), ("Y", "effort_sign")),
    ("sign of all efforts", times(-1, "Y.u", "A.u", "C.u"), ("Y, A, C", "effort_sign")),
    ("sign of position and command", times(-1, "A.q", "A.qr"), ("A", "effort_sign")),
    ("efforts of Y and A exchanged", exchanged("Y.u", "A.u"), ("Y, A", "effort_exchanged")),
    ("efforts of A and C exchanged", exchanged("A.u", "C.u"), ("A, C", "effort_exchanged")),
    (
        "positions of A and C exchanged",
        lambda c: [exchanged(f"A.{x}", f"C.{x}")(c) for x in ("q", "qr")],
        ("A, C", "position_exchanged"),
    ),
    ("a position of another size", times(1.1, "Y.q"), ("Y", "position_scale")),
    ("20 ms late", shifted("Y.u", 10), ("Y", "effort_late")),
    ("20 ms early", shifted("A.u", -10), ("A", "effort_early")),
    ("noise", noise("C.u"), ("C", "effort_noise")),
    ("a drive at its limit all along", stands("C.u", 3.0), ("C", "effort_stands")),
    ("another unit", times(1 / 9, "Y.u"), ("Y", "effort_scale")),
    ("a thousand times", times(1000, "A.u"), ("A", "effort_scale")),
    ("unsigned, friction", lambda c: c.update({"Y.u": abs(c["Y.u"])}), ("Y", "effort_unsigned")),
    ("unsigned, gravity", lambda c: c.update({"A.u": abs(c["A.u"])}), ("A", "effort_unsigned")),
    ("command twice", lambda c: c.update({"Y.q": c["Y.qr"]}), ("Y", "command_is_position")),
    ("ms", times(1e3, "t"), ("", "clock_unit")),
    ("us", times(1e6, "t"), ("", "clock_unit")),
]


@pytest.mark.parametrize(("spoil", "cause"), [s[1:] for s in SPOILED], ids=[s[0] for s in SPOILED])
def test_the_cause_is_named(spoil: Callable[[Channels], None], cause: tuple[str, str]) -> None:
    channels = recorded()
    spoil(channels)
    findings = pt.check(pt.Machine.load("trunnion"), pt.Log(channels)).findings
    found = named(findings)
    assert cause in found
    assert {code for _, code in found} == {cause[1]}
    for finding in findings:
        assert "\n" not in finding.message
        assert len(finding.message) < 500


@pytest.mark.parametrize(("channel", "code"), [("A.u", "sentinel"), ("A.q", "spikes")])
def test_a_sentinel_is_named_and_nothing_that_follows_from_it(channel: str, code: str) -> None:
    channels = recorded()
    channels[channel][np.random.default_rng(2).choice(len(channels["t"]), 72, replace=False)] = -9999.0
    found = [f for f in pt.check(pt.Machine.load("trunnion"), pt.Log(channels)).findings if f.axis == "A"]
    assert [f.code for f in found if f.severity == "warning"] == [code]
    assert "-9999 (as in the file)" in found[0].message
    assert "72 " in found[0].message


def test_a_clock_in_another_unit_is_refused_before_any_work() -> None:
    channels = recorded()
    channels["t"] *= 1e3
    with pytest.raises(LogError, match="look like a clock in ms: set unit: ms for t"):
        prepare(pt.Machine.load("trunnion"), pt.Log(channels))


@pytest.mark.parametrize("name", ["emps", "flexure_rig", "laser_driller", "trunnion", "tx40"])
def test_sound_logs_of_the_bundled_machines_raise_no_alarm(name: str) -> None:
    if not (pt.machines()[name] / "virtual.yaml").is_file():
        pytest.skip("has no virtual machine")
    assert causes(pt.Machine.load(name), pt.Log(recorded(name))) == set()


def test_a_turning_joint_may_be_anywhere(tmp_path: Path) -> None:
    urdf = tmp_path / "turn.urdf"
    urdf.write_text(
        '<robot name="turn"><link name="base"/><link name="disc"><inertial><mass value="1"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        '<joint name="M" type="continuous"><parent link="base"/><child link="disc"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )
    t = np.arange(4000) / 500.0
    q = 1000.0 * np.sin(t)
    u = -1000.0 * np.sin(t) + 20.0 * np.sign(np.cos(t)) + np.random.default_rng(0).normal(size=len(t))
    found = Prepared(pt.Machine.load(urdf), pt.Log({"t": t, "M.q": q, "M.u": u})).doubts
    assert [f for f in found if f.code in CAUSES] == []


ROOT = Path(__file__).resolve().parents[1]
REAL: list[tuple[str, tuple[str, ...]]] = [
    ("emps", ("emps/DATA_EMPS.mat",)),
    ("tx40", ("staubli_tx40/pos_read_data.csv", "staubli_tx40/curr_data.csv")),
    (str(ROOT / "examples/machines/kr300"), ("kuka_kr300/FF_A_08ms.mat",)),
    *(("{data}/kuka_lwr4", (f"kuka_lwr4/measurements_{k}.csv",)) for k in (1, 2, 3)),
    ("{data}/franka_panda", ("franka_panda/exciting_traj.csv",)),
    *(
        (str(ROOT / "examples/machines/cnc_mill"), (f"cnc_mill_smart/experiment_{k:02d}.csv",))
        for k in range(1, 13)
    ),
]


@pytest.mark.parametrize(("machine", "files"), REAL, ids=[r[1][0] for r in REAL])
def test_real_logs_raise_no_alarm(data_dir: Path, machine: str, files: tuple[str, ...]) -> None:
    log = pt.read(*(data_dir / f for f in files))
    assert causes(pt.Machine.load(machine.format(data=data_dir)), log) == set()


def not_told(machine: str, channels: Channels) -> str:
    findings = pt.check(pt.Machine.load(machine), pt.Log(channels)).findings
    return " ".join(f.message for f in findings if f.code == "not_told")


def test_what_a_motion_would_not_show_is_said() -> None:
    """C of the trunnion is nearly all friction: what was done to its effort cannot be told, and that is said."""
    for spoil in (lambda c: None, times(1 / 9, "C.u"), shifted("C.u", 10)):
        channels = recorded()
        spoil(channels)
        said = not_told("trunnion", channels)
        assert "a wrong effort unit on C" in said
        assert "effort of C that is 20 ms late" in said
        assert "of A" not in said


def test_the_axes_of_a_long_chain_are_not_exchanged_pair_by_pair() -> None:
    machine, log = pt.Machine.load("trunnion"), Prepared(pt.Machine.load("trunnion"), pt.Log(recorded()))
    assert log.efforts is not None
    assert [f.code for f in unseen(machine, log.motion, log.efforts, most=2)] == ["not_tried"]
    assert "not_tried" not in {f.code for f in unseen(machine, log.motion, log.efforts)}


def test_axes_that_move_alike_cannot_be_told_apart() -> None:
    channels = recorded("laser_driller")
    assert not_told("laser_driller", channels) == ""
    channels.update({f"Y.{x}": channels[f"X.{x}"].copy() for x in ("q", "qr", "u")})
    said = not_told("laser_driller", channels)
    assert "exchanged efforts of X and Y" in said
    assert "exchanged positions of X and Y" in said


def test_what_decides_can_be_handed_over() -> None:
    channels = recorded()
    channels["Y.u"] = np.roll(channels["Y.u"], 20)  # 20 ms late
    log, machine = pt.Log(channels), pt.Machine.load("trunnion")
    codes = [
        {f.code for f in pt.check(machine, log, settings=Settings(late=late)).findings}
        for late in (0.012, 0.05)
    ]
    assert "effort_late" in codes[0]
    assert "effort_late" not in codes[1]


@pytest.mark.parametrize("late", [-7.3, 0.0, 12.6])
def test_a_lag_between_samples_is_found_where_not_every_shift_is_tried(late: float) -> None:
    n, rng = np.arange(4000.0), np.random.default_rng(1)
    cause = np.sin(0.011 * n) + np.sin(0.031 * n + 1.0)
    u = np.sin(0.011 * (n - late)) + np.sin(0.031 * (n - late) + 1.0) + 0.05 * rng.standard_normal(4000)
    rows = np.arange(50, 3950)
    found = lag(u, rows, np.linalg.qr(np.column_stack([cause, np.ones(4000)])[rows])[0], 50, most=41)
    assert abs(found.part - late) < min(0.2, 5.0 * found.error)
