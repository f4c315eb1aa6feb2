"""The gap that a diagnosis states is ``u - twin.effort`` of the twin that anybody can evaluate, on real logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.diagnosis.conclusion.residuals import gap_table, noise_levels
from pinotwin.diagnosis.data.comparison import compare

LOGS = {
    "emps": ("emps", ("emps/DATA_EMPS.mat",)),
    "tx40": ("tx40", ("staubli_tx40/pos_read_data.csv", "staubli_tx40/curr_data.csv")),
    "lwr4": ("kuka_lwr4/machine.yaml", ("kuka_lwr4/measurements_1.csv",)),
    "panda": ("franka_panda/machine.yaml", ("franka_panda/exciting_traj.csv",)),
}


@pytest.mark.parametrize("name", LOGS)
def test_the_stated_gap_is_that_of_the_twin(name: str, data_dir: Path, tmp_path: Path) -> None:
    where, files = LOGS[name]
    machine = pt.Machine.load(data_dir / where if "/" in where else where)
    log = pt.read(*(data_dir / f for f in files))
    twin = pt.Twin.load(pt.identify(machine, log, loop=False).save(tmp_path))
    c = compare(twin, [log], [])
    stated = gap_table(c, {}, noise_levels(c)[0])
    motion = twin.motion(log)
    effort = twin.effort(motion)
    assert set(stated) <= set(machine.axes)
    assert len(stated) >= 1
    for axis, row in stated.items():
        j = motion.index(axis)
        rows = motion.moving(j)
        left = float(np.sqrt(np.mean((motion.u - effort)[rows, j] ** 2)))
        assert row["u"].rms == pytest.approx(left, rel=1e-9), axis
