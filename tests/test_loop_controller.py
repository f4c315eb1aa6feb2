"""The loop that a controller makes with a plant."""

from __future__ import annotations

import numpy as np
import pytest

from pinotwin.errors import DataError
from pinotwin.loop import Servo, close
from tests.loop_axes import pid


def test_a_closed_pid_is_the_hand_written_loop():
    truth = pid(M=12.0, C=30.0, kp=60e3, ki=9e5, kd=1.6e3, ffv=25.0, ffa=11.0)
    model = close(Servo((60e3, 9e5, 1.6e3, 1.625e3, 0.0, 11.0), form="pid"), 12.0, 30.0)
    hertz = np.array([0.5, 4.0, 20.0, 90.0])
    for k, output in enumerate(("e", "u")):
        for source, name in ((0, "d"), ("qr", "qr")):
            num, den = model.numerator(output, name)
            s = 2j * np.pi * hertz
            expected = truth.response(k, source, hertz)
            assert np.polyval(num, s) / np.polyval(den, s) == pytest.approx(expected, rel=1e-6)


def test_a_loop_that_does_not_stand_is_refused():
    law = Servo.of_cascade(40.0, 2000.0, 12.0, 0.9, 15.0, dead=1e-3)
    with pytest.raises(DataError, match="the loop is unstable"):
        close(law.scaled(kp=1000.0), 20.0)
