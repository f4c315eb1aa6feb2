"""What kind of effort a log holds: gravity taken out, no sign, a model without friction."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.logs.prepared import Prepared

ROBOTS = Path(__file__).resolve().parents[2] / "shared" / "cases" / "robots"
KINDS = {"compensated": "effort_weightless", "unsigned": "effort_unsigned", "model": "effort_frictionless"}


@pytest.mark.skipif(not ROBOTS.exists(), reason="no shared cases here")
@pytest.mark.parametrize(
    ("file", "axes"),
    [
        ("l01_ok", {}),
        ("l02_gravity_compensated", {"effort_weightless": ["shoulder, elbow"]}),
        ("l03_unsigned", {"effort_unsigned": ["base_pan", "shoulder", "elbow"]}),
    ],
)
def test_the_shared_logs_are_named(file: str, axes: dict[str, list[str]]) -> None:
    found = pt.check(pt.Machine.load(ROBOTS / "arm2.yaml"), pt.read(ROBOTS / f"{file}.csv")).findings
    named = {code: [f.axis for f in found if f.code == code] for code in KINDS.values()}
    assert {code: who for code, who in named.items() if who} == axes


@cache
def _panda(folder: Path) -> tuple[pt.Machine, pt.Motion, np.ndarray]:
    """Return machine, motion and base parameters that explain its efforts beside friction."""
    machine = pt.Machine.load(folder / "machine.yaml")
    motion = Prepared(machine, pt.read(folder / "exciting_traj.csv")).motion
    rows = np.r_[*motion.segments][::20]
    w = machine.base.regressor(machine.model, motion.q[rows], motion.v[rows], motion.a[rows])
    friction = np.zeros((len(rows), machine.nv, 3 * machine.nv))
    for j in range(machine.nv):
        v = motion.v[rows, j]
        friction[:, j, 3 * j : 3 * j + 3] = np.column_stack([v, np.sign(v), np.ones(len(v))])
    columns = np.concatenate([w, friction], axis=2).reshape(len(rows) * machine.nv, -1)
    found = np.linalg.lstsq(columns, motion.u[rows].ravel(), rcond=1e-6)[0]
    return machine, motion, found[: w.shape[2]]


@pytest.mark.parametrize("kind", [None, *KINDS])
def test_kinds_made_of_a_real_log_are_named_and_the_log_itself_is_not(data_dir: Path, kind: str) -> None:
    machine, motion, beta = _panda(data_dir / "franka_panda")
    none = np.zeros_like(motion.q)
    weight = machine.base.regressor(machine.model, motion.q, none, none) @ beta
    model = machine.base.regressor(machine.model, motion.q, motion.v, motion.a) @ beta
    made = {"compensated": motion.u - weight, "unsigned": np.abs(motion.u), "model": model}
    u = made.get(kind, motion.u)
    channels = {
        f"{n}.{s}": x[:, j] for s, x in (("q", motion.q), ("u", u)) for j, n in enumerate(motion.names)
    }
    codes = {f.code for f in Prepared(machine, pt.Log({"t": motion.t, **channels})).findings}
    assert codes & set(KINDS.values()) == ({KINDS[kind]} if kind else set())
