"""Poles and gains of machines of another simulator (MuJoCo, its own controllers), against the law that it states.

The machines lie outside the repository, beside the real recordings; their seeds were looked at while the loops were
written, so this holds what works and is no estimate for other machines (docs/simulate.md has one).
"""

from __future__ import annotations

import importlib.util
import math
import sys

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.loop import Servo, close

DOMINANT = 0.05
"""A dominant pole may be off by this share of itself; so may a gain that is stated as determined."""
HELD = 0.8
"""Share of the 90 % intervals that must hold the truth: of ten to twenty, four in five is within their scatter."""


@pytest.fixture(scope="module")
def foreign(data_dir):
    """Return the other simulator as a module."""
    pytest.importorskip("mujoco")
    path = data_dir.parent / "foreign" / "foreign.py"
    if not path.is_file():
        pytest.skip(f"no machines of another simulator at {path}")
    spec = importlib.util.spec_from_file_location("foreign", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["foreign"] = module
    spec.loader.exec_module(module)
    return module


def laws(foreign, machine) -> dict[str, tuple[dict[str, float], Servo, float]]:
    """Return per axis the true gains by name, the law as a servo, and the inertia at home."""
    out = {}
    for joint in machine.actuated():
        c, inertia = machine.control, foreign.axis_inertia(machine, joint.name)
        true = foreign.Servo(c, joint, inertia, 0.0, 1.0, 1.0)
        gains = {"kp": true.kp, "kv": true.kv, "rate": true.ki / true.kv, "ffv": c.kvff, "ffa": true.M}
        lag = 1.0 / (2.0 * math.pi * c.velocity_filter) + 0.5 / c.rate
        shapes = {"velocity_lag": lag, "dead": 0.5 / c.rate}
        if c.current:
            shapes["output_lag"] = 1.0 / (2.0 * math.pi * c.current)
        out[joint.name] = gains, Servo.of_cascade(**gains, **shapes), inertia
    return out


@pytest.mark.parametrize("seed", [440])
def test_poles_and_gains_of_cascades_are_those_that_were_written_down(foreign, tmp_path, seed):
    name = f"random:{seed}"
    machine = foreign.machine(name)
    assert machine.control.kind == "cascade"
    case = foreign.make("none", name, seed)
    foreign.write_machine(machine, seed, tmp_path)
    foreign.write_csv(tmp_path / "train.csv", foreign.simulate(case, 18.0, case.seed, 0)[1])
    twin = pt.identify(pt.Machine.load(tmp_path), pt.read(tmp_path / "train.csv"))
    poles, held, said, both = [], [], {}, []
    for axis, (true, law, inertia) in laws(foreign, machine).items():
        viscous = next(j.viscous for j in machine.actuated() if j.name == axis)
        slowest = min(close(law, inertia, viscous).poles, key=abs)
        poles.append(min(abs(p - slowest) for p in twin.loops[axis].poles) / abs(slowest))
        servo = twin.servos[axis]
        found, determined = {**servo.named(), **servo.combined()}, servo.determined()
        true |= {"kp + rate": true["kp"] + true["rate"], "kp * rate": true["kp"] * true["rate"]}
        for gain, value in true.items():
            low, high = servo.intervals()[gain]
            held.append(low <= value <= high)
            if " " in gain:
                both.append((determined[gain], abs(found[gain] / value - 1.0)))
            else:
                said[axis, gain] = determined[gain], abs(found[gain] / value - 1.0)
    assert max(poles) < DOMINANT
    gains = [off for determined, off in said.values() if determined]
    assert len(gains) >= 0.5 * len(said), "too little was said of this machine"
    assert np.mean(np.array(gains) < DOMINANT) >= HELD
    assert np.mean([off < DOMINANT for _, off in said.values()]) >= HELD
    assert all(determined and off < DOMINANT for determined, off in both)
    assert np.mean(held) >= HELD
