"""Cases of others, read in place: what each README expects of readers, of `check`, of an identified lead."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

import pinotwin as pt

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases"
DRIVES, ROBOTS, ROBUST = (CASES / name for name in ("drives", "robots", "robust"))
pytestmark = pytest.mark.skipif(not CASES.exists(), reason="no shared cases here")


@pytest.mark.parametrize(
    ("file", "channels", "step"),
    [
        (DRIVES / "tncscope_own.sco", {"v ist/Y", "v soll/Y", "s ist/Y", "s soll/Y", "I ist/Y"}, 3000.0),
        *(
            (
                DRIVES / f"halscope_{kind}.log",
                {"joint.0.motor-pos-cmd", "joint.0.motor-pos-fb", "joint.0.f-error", "pid.x.output"},
                1e-3,
            )
            for kind in ("dot", "comma")
        ),
        (DRIVES / "iso_time.csv", {"X_SetPos", "X_ActPos", "X_Current"}, None),
        (ROBUST / "iso_z.csv", {"Y.q", "Y.u", "A.q", "A.u"}, 4e-3),
    ],
    ids=lambda x: getattr(x, "name", ""),
)
def test_a_log_of_others_is_read(file: Path, channels: set[str], step: float | None) -> None:
    log = pt.read(file)
    assert set(log.channels) - {"t", "timestamp"} == channels
    assert step is None or log.t[1] - log.t[0] == pytest.approx(step)


@pytest.mark.parametrize(
    ("file", "said"), [("ros2_mcap_folder", "is damaged or cut off"), ("mcap_crc_wrong.mcap", "crc")]
)
def test_a_spoilt_bag_is_refused(file: str, said: str) -> None:
    with pytest.raises(pt.LogError, match=said):
        pt.read(ROBUST / file)


@pytest.mark.parametrize("folder", ["friction_level", "lost_motion", "velocity_ff", "feedback_sign"])
def test_whole_logs_of_a_stiff_drive_have_no_late_command_or_wrong_sign(folder: str) -> None:
    machine = pt.Machine.load(DRIVES / folder)
    for file in sorted((DRIVES / folder).glob("*.csv")):
        assert not [f.code for f in pt.check(machine, file).findings if f.severity != "info"]


def test_lost_motion_between_motor_and_scale_is_stated() -> None:
    found = pt.check(pt.Machine.load(DRIVES / "lost_motion"), DRIVES / "lost_motion" / "one_b.csv").findings
    assert any("lost motion between the directions 49.9 µm" in f.message for f in found)


@pytest.mark.parametrize("file", ["l01_ok.csv", "l05_two_publishers.jsonl"])
def test_friction_that_turns_at_once_is_no_lead(file: str) -> None:
    machine, log = pt.Machine.load(ROBOTS / "arm2.yaml"), pt.read(ROBOTS / file)
    assert "effort_lead" not in {f.code for f in pt.check(machine, log).findings}
    twin = pt.identify(machine, log, loop=False)
    assert not any(row["applied"] for row in twin.quality["leads"].values())
    if file == "l01_ok.csv":
        low, high = twin.parameters["shoulder.viscous.b"].interval(0.95)
        assert low < 8.0 < high


def test_an_effort_in_amperes_is_not_asked_for_its_weight(tmp_path: Path) -> None:
    spec = yaml.safe_load((ROBOTS / "arm2.yaml").read_text()) | {"urdf": str(ROBOTS / "arm2.urdf")}
    spec["columns"] = {f"{name}.u": {"column": f"{name}.u", "unit": "A"} for name in spec["axes"]}
    (tmp_path / "machine.yaml").write_text(yaml.safe_dump(spec))
    log = pt.read(ROBOTS / "l02_gravity_compensated.csv")
    codes = {f.code for f in pt.check(pt.Machine.load(tmp_path), log).findings}
    assert "effort_unit" in codes
    assert "effort_weightless" not in codes
