"""Controllers and loops as python-control systems, and what scaled gains do."""

from __future__ import annotations

from dataclasses import replace

import control
import matplotlib
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinotwin.errors import InputError
from pinotwin.loop import Servo, close
from pinotwin.simulation import simulate
from tests.simulated import known_twin, plain_machine, smooth_command

matplotlib.use("Agg")
M, B = 40.0, 60.0
CASCADE = Servo.of_cascade(60.0, 5000.0, 40.0, 0.9, 30.0, velocity_lag=3e-4, output_lag=2e-4, dead=1e-4)
FORMS = {
    "cascade": CASCADE,
    "general": Servo.of_cascade(60.0, 5000.0, 20.0, 0.7, 30.0, 0.4, velocity_lag=4e-4),
    "proportional": Servo.of_cascade(60.0, 5000.0, 0.0, 0.5, 30.0, velocity_lag=4e-4, dead=1e-4),
    "pid": Servo((3e5, 5e6, 5000.0, 5300.0, 0.0, 30.0), 3e-4, form="pid"),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_named_gain_scales_that_gain_alone(form: str) -> None:
    servo = FORMS[form]
    named = servo.named()
    for name, value in named.items():
        if name == "weight" and form in ("cascade", "proportional"):
            continue  # 1 is imposed there: the law becomes another form
        found = servo.scaled(**{name: 1.01})
        expected = pytest.approx({**named, name: 1.01 * value}, rel=1e-6, abs=1e-12)
        again = [{**c, **{k: found.named()[k] for k in named if k not in c}} for c in found.cascades()]
        assert found.named() == expected or any(c == expected for c in again), name
        assert found.form == servo.form


@given(st.sampled_from(sorted(FORMS)), st.floats(0.2, 3.0), st.floats(0.2, 3.0))
def test_factors_of_one_and_their_inverse_bring_the_law_back(form: str, first: float, second: float) -> None:
    servo = FORMS[form]
    assert servo.scaled().gains == servo.gains
    factors = {"kp": first, "ffa": second}
    there = servo.scaled(**factors)
    # by the gains: which of two roots is kp may change on the way
    back = {"e": servo.gains[0] / there.gains[0], "ar": 1.0 / second}
    assert there.scaled(**back).gains[0] == pytest.approx(servo.gains[0])
    assert there.scaled(**back).gains[5] == pytest.approx(servo.gains[5])


def test_gains_of_a_law_scale_as_before() -> None:
    found = CASCADE.scaled(e=0.5, all=2.0, ar=3.0)
    assert found.gains == pytest.approx(np.array(CASCADE.gains) * (1.0, 2.0, 2.0, 1.0, 1.0, 3.0))


def test_a_law_whose_roots_are_not_real_keeps_what_is_not_scaled() -> None:
    g = CASCADE.gains
    odd = replace(CASCADE, gains=(g[0], 3.0 * g[1], *g[2:]))
    assert odd.scaled(ffa=2.0).gains == pytest.approx((g[0], 3.0 * g[1], *g[2:5], 2.0 * g[5]))


@pytest.mark.parametrize(
    ("name", "near"), [("kpp", "kp"), ("Kv", "kv"), ("ti", "ki"), ("velocity", "velocity_lag")]
)
def test_a_name_that_it_does_not_have_is_refused_with_the_nearest(name: str, near: str) -> None:
    servo = FORMS["pid"] if near == "ki" else CASCADE
    with pytest.raises(InputError, match=f"no gain '{name}'.*{near}"):
        servo.scaled(**{name: 1.1})


@pytest.mark.parametrize("factor", [float("nan"), float("inf"), None, "1.2"])
def test_a_factor_that_is_no_number_is_refused(factor: object) -> None:
    with pytest.raises(InputError, match=r"kp=.* is no number"):
        CASCADE.scaled(kp=factor)  # type: ignore[arg-type]


def test_a_what_if_changes_the_simulation_as_its_name_says() -> None:
    machine = plain_machine("trunnion")
    twin = known_twin(machine)
    servos = {a: Servo.of_cascade(60.0, 5000.0 if a == "Y" else 50.0, 40.0, 0.5, 0.0) for a in "YAC"}
    twin = replace(twin, servos=servos)
    log = smooth_command(machine, 3.0, 500.0)
    usual = np.std(simulate(twin, log, controller="coupled")["Y.e"])
    ratios = {}
    for name in ("kp", "kv", "rate", "ffv", "velocity_lag"):
        other = replace(twin, servos={**servos, "Y": servos["Y"].scaled(**{name: 0.5})})
        ratios[name] = np.std(simulate(other, log, controller="coupled")["Y.e"]) / usual
    assert ratios["kp"] == pytest.approx(2.0, rel=0.1)  # e is (1 - ffv) v / kp but for friction
    assert ratios["ffv"] == pytest.approx(0.75 / 0.5, rel=0.1)
    assert abs(ratios["kv"] - 1.0) > 0.005
    assert abs(ratios["rate"] - 1.0) > 0.005
    assert ratios["velocity_lag"] == 1.0  # there is none


@pytest.mark.parametrize("form", FORMS)
def test_a_controller_is_a_control_system(form: str) -> None:
    servo = FORMS[form]
    system = servo.to_control()
    assert system.input_labels == ["e", "v", "vr", "ar"]
    assert system.output_labels == ["u"]
    s = 2j * np.pi * 17.0
    k_e, k_i, k_v, k_vr, k_w, k_ar = servo.gains
    lags = 1.0 / (1.0 + s * servo.output_lag)
    expected = lags * np.array([k_e + k_i / s, -k_v / (1.0 + s * servo.velocity_lag), k_vr + k_w / s, k_ar])
    assert system(s)[0] == pytest.approx(expected, rel=1e-9)
    one = servo.to_control("e")
    assert one.input_labels == ["e"]
    assert len(control.stability_margins(one)) == 6
    control.bode_plot(one, omega=np.geomspace(1.0, 1e3, 20))
    with pytest.raises(InputError, match="no signal 'qr': inputs e, v, vr, ar, output u"):
        servo.to_control("qr")


@pytest.mark.parametrize("form", FORMS)
def test_a_loop_is_a_control_system_with_named_signals(form: str) -> None:
    loop = close(FORMS[form], M, B, axis="Y")
    s = 2j * np.pi * 9.0
    whole = loop.to_control(None, None)
    assert whole.input_labels == ["d", "vr", "ar"]
    error = loop.to_control("qr", "e")
    assert (error.input_labels, error.output_labels) == (["qr"], ["e"])
    assert error(s) == pytest.approx(complex(loop.transfer("e", "qr")(s)), rel=1e-6)
    assert loop.to_control("qr", "q")(s) == pytest.approx(1.0 - error(s), rel=1e-9)
    assert loop.to_control("d", "q")(s) == pytest.approx(-complex(loop.transfer("e", "d")(s)), rel=1e-6)
    assert loop.to_control("d", "u")(s) == pytest.approx(complex(loop.transfer("u", "d")(s)), rel=1e-6)
    assert loop.to_control("vr", "u")(s) == pytest.approx(whole(s)[1, 1], rel=1e-9)
    assert len(control.stability_margins(loop.to_control("qr", "q"))) == 6
    control.bode_plot(error, omega=np.geomspace(1.0, 1e3, 20))


@pytest.mark.parametrize(
    ("signals", "match"),
    [
        (("q", "e"), "Y: no signal 'q' there; did you mean 'qr'.*inputs d, qr, vr, ar; outputs e, u, q"),
        (("qr", "v"), "Y: no signal 'v' there.*outputs e, u, q"),
        (("vr", "q"), "q needs input qr or d"),
        (("qr", "u"), "feed-forward differentiates qr.*'vr'"),
        (("qr", None), "so that u has no state space from it"),
    ],
)
def test_a_signal_that_a_loop_does_not_have_names_those_that_it_has(
    signals: tuple[str, str | None], match: str
) -> None:
    with pytest.raises(InputError, match=match):
        close(CASCADE, M, B, axis="Y").to_control(*signals)
