"""Case 1 of Wang (2023), Section 5.3.1: linear drives with one to three modes, types (a), (b), (c).

A chain of masses on springs (Eq. 5.1); the motor pushes the first, the encoder and the disturbance sit
on mass L. Behind a P-PI controller the LTI part has one more pole pair per mode.
"""

from __future__ import annotations

import numpy as np
import pytest

from pinotwin.loop import Structure, identify_loop
from tests.loop_axes import HERTZ, Truth
from tests.test_loop_identify import gains_agree, match, noisy, record


def chain(masses, hertz, measured, kv, kp=20.0, ti=0.08, zeta=0.03, ff=400.0):
    """Closed loop of a chain; ``hertz`` of each spring with the two masses that it joins."""
    n = len(masses)
    size = 2 * n + 3  # e, n speeds, n - 1 stretches, integral, filtered vr and its rate
    A, B, unit = np.zeros((size, size)), np.zeros((size, 3)), np.eye(size)
    e, i, f, g = unit[0], unit[2 * n], unit[2 * n + 1], unit[2 * n + 2]
    speed, stretch = unit[1 : n + 1], unit[n + 1 : 2 * n]
    inner = kp * e - speed[measured] + 0.95 * f
    u = kv * inner + kv / ti * i + 0.9 * sum(masses) * g
    push = np.zeros((n, size))
    push[0] += u
    push[measured] -= 40.0 * speed[measured]
    for k, h in enumerate(hertz):
        m = masses[k] * masses[k + 1] / (masses[k] + masses[k + 1])
        w = HERTZ * h
        force = m * w * w * stretch[k] + 2 * zeta * w * m * (speed[k] - speed[k + 1])
        push[k] -= force
        push[k + 1] += force
        A[n + 1 + k] = speed[k] - speed[k + 1]
    A[0], B[0, 1] = -speed[measured], 1.0
    A[1 : n + 1] = push / np.asarray(masses)[:, None]
    B[1 + measured, 0] = -1.0 / masses[measured]
    A[2 * n], A[2 * n + 1] = inner, g
    p = HERTZ * ff
    A[2 * n + 2], B[2 * n + 2, 1] = -p * p * f - 2 * p * g, p * p
    return Truth(A, B, np.stack([e, u]), np.zeros((2, 3)))


TYPES = {
    "a: screw, encoder on the load": chain((6.0, 26.0), (45.0,), 1, 450.0, kp=10.0, ti=0.2, zeta=0.08),
    "b: table bends, encoder at the motor": chain((25.0, 6.0), (24.0,), 0, 1900.0),
    "c: base and table, two modes": chain((12.0, 10.0, 10.0), (24.0, 34.0), 0, 1900.0),
    "three modes": chain((16.0, 9.0, 8.0, 8.0), (18.0, 26.0, 33.0), 0, 1500.0),
}


HIDDEN = "three modes"
"""Here the end of the chain hardly moves the encoder: the fit is at the noise without its mode."""


@pytest.mark.parametrize("kind", TYPES)
def test_every_mode_is_found(kind):
    truth = TYPES[kind]
    assert np.max(truth.poles.real) < 0.0
    modes = (len(truth.poles) - 5) // 2
    log = record(truth, 3, seconds=12.0)
    model = identify_loop(
        noisy(log, np.random.default_rng(1), 0.0005),
        Structure(pole_pairs=1 + modes, feedforward_poles=(400.0, 400.0)),
    )
    slow = sorted(truth.poles[np.abs(truth.poles) < HERTZ * 100], key=abs)
    if kind == HIDDEN:
        slow = slow[:-2]
    assert np.max(match(model.poles, slow)) < 0.03
    gains_agree(model, truth, 0.05)
