"""KR300 and the CNC mill load through a YAML alone, and `check` says what they cannot tell."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pinotwin as pt

MACHINES = Path(__file__).resolve().parents[1] / "examples" / "machines"


def said(result) -> str:
    return "\n".join(f"{f.severity} {f.channel} {f.message}" for f in result.findings)


def test_kr300_loads_and_is_told_what_it_can_identify(data_dir):
    machine = pt.Machine.load(MACHINES / "kr300")
    log = pt.read(data_dir / "kuka_kr300" / "FF_A_08ms.mat")
    result = pt.check(machine, log)
    assert result.ok
    assert result.quality is not None
    assert abs(result.quality.clock.rate - 250.0) < 1.0
    assert all(axis.moves for axis in result.quality.axes.values())
    assert "base parameters can be identified" in said(result)
    assert result.excited.condition > 50  # one short trajectory parts few of them well


def test_cnc_mill_is_told_what_ten_hertz_and_three_digits_cannot_identify(data_dir):
    machine = pt.Machine.load(MACHINES / "cnc_mill")
    log = pt.read(data_dir / "cnc_mill_smart" / "experiment_01.csv")
    text = said(pt.check(machine, log))
    assert "10 Hz is too slow to identify inertia" in text
    assert "3 significant digits" in text
    assert "Z.u is always zero" in text.replace("Z.u: is", "Z.u is")
    assert "not excite" in text


def test_sentinel_rows_of_the_mill_are_reported(data_dir):
    machine = pt.Machine.load(MACHINES / "cnc_mill")
    machine = dataclasses.replace(machine, data=dataclasses.replace(machine.data, leave_out=()))
    for k, count in ((2, 2), (5, 3)):  # in one that of the spindle, too
        text = said(pt.check(machine, pt.read(data_dir / "cnc_mill_smart" / f"experiment_{k:02d}.csv")))
        assert "X.q jumps to 198" in text
        assert "Y.q jumps to 158" in text
        assert text.count("a sentinel value; leave the") == count


def test_another_day_of_the_mill_is_no_change(data_dir):
    machine = pt.Machine.load(MACHINES / "cnc_mill")
    twin = pt.identify(machine, data_dir / "cnc_mill_smart" / "experiment_11.csv")
    found = pt.diagnose(twin, data_dir / "cnc_mill_smart" / "experiment_12.csv")
    assert (found.verdict, found.effects) == ("none", [])
