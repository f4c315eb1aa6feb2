"""A force on the table of the virtual trunnion, foretold by a twin that was identified from a log."""

from __future__ import annotations

import numpy as np

from pinotwin.identification import identify
from pinotwin.machine import Machine
from pinotwin.trajectories.moves import Trajectory, random_trajectory
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual.truth import Pulse
from tests.conftest import ROOT
from tests.test_examples import example

rig_moves = example("rig_moves")

START = 1.5


def test_external_pulse_within_six_percent() -> None:
    """e and u of both axes after a 50 ms, 300 N push, against their RMS, from the rest before it."""
    vm = VirtualMachine.load(ROOT / "urdf" / "trunnion")
    log = vm.record(random_trajectory(vm, 7.0, 3), seed=1).to_log()
    twin = identify(Machine.load("trunnion"), log)
    aside = rig_moves.tilted(vm, 0.5)
    path = Trajectory(2.2, {name: aside.profiles[name] for name in vm.axes})
    push = Pulse("C_link", START, 0.05, (0.0, 300.0, -300.0), (-12.0, 0.0, 0.0))
    measured = vm.record(path, seed=5, external=[push]).to_log()
    assert "C_link.fy" in measured
    predicted = twin.simulate(measured)
    before, after = abs(measured.t - START + 0.05) < 0.05, measured.t >= START
    for axis in "YA":
        e = measured[f"{axis}.qr"] - measured[f"{axis}.q"]
        for true, x in (
            (e, predicted[f"{axis}.e"]),
            (measured[f"{axis}.u"], predicted[f"{axis}.u"]),
        ):
            y, x = true - true[before].mean(), x - x[before].mean()
            error = np.sqrt(np.mean((x - y)[after] ** 2) / np.mean(y[after] ** 2))
            assert error < 0.06, (axis, error)
