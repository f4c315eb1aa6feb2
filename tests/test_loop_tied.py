"""A tied loop on an axis whose controller is known: rows agree, poles and the band above are right."""

from __future__ import annotations

import numpy as np
import pytest

from pinotwin.identification.loop_with_mass import tied, with_lag
from pinotwin.loop import LoopData, LoopModel, Servo, Structure, close, identify_loop

M, C, STEP = 55.9, 50.0, 0.0025
LAW = Servo((985e3, 39.9e6, 11.7e3, 11.724e3, 0.0, 0.0), form="pid", output_lag=3e-4, step=1e-6)


def recorded(noise: float) -> tuple[LoopData, LoopModel]:
    """Return 10 s of the axis, its disturbance below 40 Hz, and the loop that made it."""
    truth = close(LAW, M, C, axis="Y")
    rng = np.random.default_rng(4)
    t = np.arange(4000) * STEP
    f, phase = np.geomspace(0.3, 40.0, 25), rng.uniform(0, 2 * np.pi, (2, 25))
    d = 12.0 * np.sin(2 * np.pi * np.outer(t, f) + phase[0]).sum(axis=1)
    slow = f < 4.0
    qr = (0.02 / f[slow] * np.sin(2 * np.pi * np.outer(t, f[slow]) + phase[1][slow])).sum(axis=1)
    y = truth.simulate(qr, d, step=STEP)
    y = y + noise * rng.standard_normal(y.shape) * y.std(axis=0)
    return LoopData(STEP, qr, d, y, axis="Y"), truth


def gain(loop: LoopModel, output: str, hertz: float) -> complex:
    s = 2j * np.pi * hertz
    num, den = loop.numerator(output, "d")
    return complex(np.polyval(num, s) / np.polyval(den, s))


@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_tied_loop_is_right_above_the_band(noise: float) -> None:
    data, truth = recorded(noise)
    free = identify_loop(data, Structure())
    found = tied(data, with_lag(free), M, C)
    for hertz, limit in ((1.0, 0.02), (10.0, 0.02), (30.0, 0.03), (100.0, 0.15), (200.0, 0.3)):
        for output in "eu":
            true = gain(truth, output, hertz)
            assert abs(gain(found, output, hertz) - true) < limit * abs(true)
    true = gain(truth, "u", 150.0)  # the log ends at 40 Hz
    assert abs(gain(found, "u", 150.0) - true) < 0.7 * abs(gain(free, "u", 150.0) - true)
    exact = 1 - (M * (2j * np.pi * 150) ** 2 + C * 2j * np.pi * 150) * gain(found, "e", 150.0)
    assert gain(found, "u", 150.0) == pytest.approx(exact, rel=1e-6)
    assert max(found.poles.real) < 0.0
    assert found.fit is not None
    assert found.fit.nrmse["e"] < 0.02


def test_forms_that_cannot_be_tied_are_left_alone() -> None:
    data, truth = recorded(0.0)
    assert tied(data, truth, M, C) is truth  # feed-forward without poles
