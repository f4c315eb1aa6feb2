"""What became of a log while it was recorded: `check` names it, and says nothing of logs that are whole."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.logs.effort_alone import late_by
from pinotwin.logs.prepare import prepare
from pinotwin.logs.quality.recorded import recorded_findings
from pinotwin.logs.settings import Settings
from pinotwin.virtual import VirtualMachine, random_trajectory

KINDS = {
    "late": "command_late",
    "clock": "clock_odd",
    "frozen": "frozen",
    "lost": "rows_lost",
    "doubled": "rows_doubled",
    "held": "rows_held",
    "strange": "effort_strange",
    "drawn": "interpolated",
    "jitter": "command_jitter",
}


@cache
def _log(seed: int) -> pt.Log:
    machine = VirtualMachine.load(pt.machines()["trunnion"])
    return machine.record(random_trajectory(machine, 20.0, seed), seed=seed).to_log()


def _spoiled(log: pt.Log, kind: str, seed: int) -> pt.Log:  # noqa: C901, one case a kind
    """Return a log of which one kind of fault has been made; of one axis where it is of one."""
    c = {k: log[k].copy() for k in log.channels}
    n, rng, axis = len(c["t"]), np.random.default_rng(seed), "Y"
    step = float(np.median(np.diff(c["t"])))
    some = rng.choice(np.arange(1, n), n // 50, replace=False)
    rows = np.arange(n)
    match kind:
        case "late":
            c[f"{axis}.qr"] = np.r_[np.full(8, c[f"{axis}.qr"][0]), c[f"{axis}.qr"][:-8]]
        case "frozen":
            c[f"{axis}.u"][int(0.4 * n) : int(0.6 * n)] = c[f"{axis}.u"][int(0.4 * n)]
        case "clock":
            c["t"] = 1.01 * c["t"]
        case "lost":
            rows = np.setdiff1d(rows, some)
        case "doubled":
            rows = np.sort(np.r_[rows, some])
        case "held":
            rows = rows // 3 * 3
        case "strange":
            c[f"{axis}.u"] = np.roll(c[f"{axis}.u"], n // 2)
        case "jitter":
            late = rows - 0.1 * np.abs(rng.normal(size=n))
            c |= {k: np.interp(late, rows, x) for k, x in c.items() if k == f"{axis}.qr"}
        case "drawn":
            c = {k: x if k == "t" else np.interp(c["t"], c["t"][::5], x[::5]) for k, x in c.items()}
    if kind in ("lost", "doubled"):
        c = {k: x[rows] for k, x in c.items()} | {"t": step * np.arange(len(rows))}
    if kind == "held":
        c = {k: x if k == "t" or k.endswith(".qr") else x[rows] for k, x in c.items()}
    return pt.Log(c)


@pytest.mark.parametrize("kind", ["lost", "doubled", "held", "drawn", "jitter", "frozen"])
def test_of_a_recording_at_fault_a_question_of_structure_names_no_cause(kind):
    """What `check` proves comes before anything that the model may lack."""
    found = pt.diagnose("trunnion", _spoiled(_log(3), kind, 1), quick=True)
    assert KINDS[kind] in [x["fault"] for x in found.recording]
    assert not found.effects
    assert not found.possible
    assert found.verdict == "unexplained"
    assert found.sentence.startswith("The recording is at fault")
    assert all(np.array_equal(x.before, x.after) for x in found.traces)  # no page draws a cause


def test_of_a_whole_recording_nothing_is_said():
    assert not pt.diagnose("trunnion", _log(3), quick=True).recording


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_of_the_recording_is_named(kind):
    codes = [f.code for f in pt.check("trunnion", _spoiled(_log(3), kind, 1)).findings]
    assert KINDS[kind] in codes
    others = set(codes) & set(KINDS.values()) - {KINDS[kind]}
    assert not others


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_whole_log_has_none(seed):
    codes = {f.code for f in pt.check("trunnion", _log(seed)).findings}
    assert not codes & set(KINDS.values())


@pytest.mark.parametrize("step", [0.03, 0.1])
def test_a_log_too_slow_for_its_motion_has_no_scattered_command(step):
    log = _log(3)
    every = round(step / float(np.median(np.diff(log.t))))
    rows = pt.Log({k: log[k][::every] for k in log.channels})
    assert "command_jitter" not in [f.code for f in recorded_findings(rows, ["Y", "A", "C"])]


def test_a_coarse_effort_that_stands_at_constant_speed_is_not_frozen():
    t = np.arange(0.0, 20.0, 2e-3)
    v = np.clip(2.0 * np.sin(0.8 * t), -1.0, 1.0)  # constant speed for most of the time
    q = np.cumsum(v) * 2e-3
    u = 3.0 * np.gradient(v, t) + 2.0 * np.sign(v) + 0.02 * np.random.default_rng(1).normal(size=len(t))
    log = pt.Log({"t": t, "X.qr": q, "X.q": np.round(q, 6), "X.u": np.round(u, 1)})
    assert [f.code for f in recorded_findings(log, ["X"])] == []


SPOILT = Path(__file__).resolve().parents[2] / "shared" / "cases" / "robust" / "trunnion"


@pytest.mark.skipif(not SPOILT.exists(), reason="no shared cases here")
def test_the_log_that_spoils_are_made_of_is_whole():
    codes = {f.code for f in pt.check(pt.Machine.load(SPOILT), SPOILT / "valid.csv").findings}
    assert not codes & set(KINDS.values())


@pytest.mark.skipif(not SPOILT.exists(), reason="no shared cases here")
@pytest.mark.parametrize("rows", [1, 4, 12])
def test_a_late_command_is_named_with_its_rows(rows):
    log = pt.read(SPOILT / "valid.csv")
    late = np.r_[np.full(rows, log["Y.qr"][0]), log["Y.qr"][:-rows]]
    found = pt.check(
        pt.Machine.load(SPOILT), log.with_channels({**{k: log[k] for k in log.channels}, "Y.qr": late})
    )
    said = [f.message for f in found.findings if f.code == "command_late"]
    assert [f"({rows} rows)" in text for text in said] == [True]


def test_a_later_command_that_fits_hardly_better_is_no_late_one():
    """The law of the controller is known in part: noise on the effort, and a command that is half a row late."""
    log, rng = _log(3), np.random.default_rng(2)
    shift, rows = 0.5, np.arange(len(log))
    noise = 0.3 * np.std(log["A.u"]) * rng.normal(size=len(log))
    late = {"A.qr": np.interp(rows - shift, rows, log["A.qr"]), "A.u": log["A.u"] + noise}
    machine = pt.Machine.load("trunnion")
    motion = prepare(machine, log.with_channels({**{k: log[k] for k in log.channels}, **late}))
    plain, strict = Settings(lead_gain=0.0), Settings()
    assert (late_by(motion, 1, plain), late_by(motion, 1, strict)) == (1, 0)


def test_a_log_of_a_fifth_of_a_second_is_refused():
    machine, log = pt.Machine.load("trunnion"), _log(3)
    found = pt.check(machine, few := log.rows(slice(500, 600)))
    assert [f.code for f in found.findings if f.severity == "error"] == ["log_short"]
    with pytest.raises(pt.DataError, match=r"lasts 0.2 s: .*record longer"):
        pt.identify(machine, few)
