"""The lead of a logged effort ahead of its position: found with its interval, put back, kept in the twin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.errors import MachineError
from pinotwin.log import Log
from tests.rig import YAML, good_log, write_machine

REACH = 1.96  # standard errors of a 95 % interval


def ahead(lead: float) -> Log:
    """Return a log without commands whose slide's effort is ``lead`` seconds ahead."""
    channels = {name: x for name, x in good_log().items() if not name.endswith(".qr")}
    t = channels["t"]
    channels["X.u"] = np.interp(t + lead, t, channels["X.u"])
    return Log(channels, "here.csv")


@pytest.mark.parametrize("lead", [0.0, 0.004, 0.0115])
def test_a_lead_is_found_and_its_interval_covers_it(tmp_path: Path, lead: float) -> None:
    machine = pt.Machine.load(write_machine(tmp_path / "rig"))
    twin = pt.identify(machine, ahead(lead))
    for axis, truth in (("X", lead), ("B", 0.0)):
        found = twin.quality["leads"][axis]
        assert abs(found["lead"] - truth) < REACH * found["standard_error"] + 1e-4
        assert found["applied"] == (truth > 0.0)
    again = pt.Twin.load(twin.save(tmp_path / "twin"))
    assert (again.machine.axis("X").lead is None) == (lead == 0.0)
    held = twin.quality["axes"]["X"]["held_out"]["nrmse"]
    assert held < 0.1
    np.testing.assert_allclose(again.motion(ahead(lead)).u, twin.motion(ahead(lead)).u)


def test_a_lead_may_be_given(tmp_path: Path) -> None:
    machine = pt.Machine.load(
        write_machine(tmp_path / "rig", yaml=YAML.replace("{joint: jx}", "{joint: jx, lead: 4 ms}"))
    )
    assert machine.axis("X").lead == pytest.approx(0.004)
    twin = pt.identify(machine, ahead(0.004))
    assert twin.quality["leads"]["X"] == {"lead": pytest.approx(0.004), "given": True}
    assert pt.Machine.load(machine.save(tmp_path / "copy")).axis("X").lead == pytest.approx(0.004)


def test_a_lead_is_a_time(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"axes\.X\.lead: expected a time such as 3.5 ms, found '4 mm'"):
        pt.Machine.load(
            write_machine(tmp_path / "rig", yaml=YAML.replace("{joint: jx}", "{joint: jx, lead: 4 mm}"))
        )


def test_the_leads_of_a_real_robot(data_dir: Path) -> None:
    """Staubli TX40: 2 to 4 ms by its readme; without them the error is 7.8 %."""
    folder = data_dir / "staubli_tx40"
    log = pt.read(folder / "pos_read_data.csv", folder / "curr_data.csv")
    twin = pt.identify(pt.Machine.load("tx40"), log)
    leads = twin.quality["leads"]
    assert all(row["applied"] and 0.001 < row["lead"] < 0.004 for row in leads.values())
    assert twin.quality["relative_error"] <= 0.068
