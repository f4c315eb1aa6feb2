"""The controller recovered from sampled loops, and the loop that it makes with a plant."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.io
from scipy.linalg import expm

from pinotwin.errors import DataError, InputError
from pinotwin.loop import Controller, LoopData, couple, identify_controller
from pinotwin.loop.grey import GRID, GRID_ROWS, _by_delay, _misfit, _Rows
from pinotwin.loop.law import law_columns, signals_of
from tests.loop_axes import command, disturbance, pid

STEP = 1e-3


def sampled_cascade(law, seconds=4.0, seed=0, late=0, M=20.0, C=50.0, grid=0.0):
    """The log of a sampled P-PI around M v' + C v = u - d; u held, d straight in between."""
    rng = np.random.default_rng(seed)
    qr, vr, ar = command(seconds, STEP, rng)
    d = disturbance(vr, qr, rng, STEP)
    A = np.array([[0.0, 1.0], [0.0, -C / M]])
    big = np.zeros((4, 4))
    big[:2, :2], big[1, 2], big[2, 3] = A * STEP, STEP / M, 1.0
    E = expm(big)
    x, before, seen, total = np.zeros(2), 0.0, 0.0, 0.0
    e, u = np.zeros(len(qr)), np.zeros(len(qr))
    a = np.exp(-STEP / law.filter_time) if law.filter_time else 0.0
    wanted = np.zeros(len(qr))
    for k in range(len(qr)):
        q = np.round(x[0] / grid) * grid if grid else x[0]
        e[k] = qr[k] - q
        seen = a * seen + (1 - a) * (q - before) / STEP
        before = q
        inner = law.kp * e[k] + law.ffv * vr[k] - seen
        total += STEP * inner
        wanted[k] = law.kv * (inner + law.integral * total) + law.ffa * ar[k]
        u[k] = wanted[k - late] if k >= late else 0.0
        slope = d[min(k + 1, len(qr) - 1)] - d[k]
        x = E[:2, :2] @ x + E[:2, 2] * (u[k] - d[k]) - E[:2, 3] * slope
    return LoopData(STEP, qr, d, np.column_stack([e, u]), vr=vr, ar=ar)


CASCADE = Controller("p_pi", kp=40.0, kv=2000.0, integral=12.0, ffv=0.95, ffa=15.0, filter_time=8e-4)


@pytest.mark.parametrize("late", [0, 1, 3])
def test_cascade_recovered_exactly(late):
    found = identify_controller(sampled_cascade(CASCADE, late=late), kind="p_pi")
    assert found.delay == pytest.approx(late * STEP, abs=0.05 * STEP)
    for name in ("kp", "kv", "integral", "ffv", "ffa"):
        assert getattr(found, name) == pytest.approx(getattr(CASCADE, name), rel=0.01), name
    # Filter and delay of the velocity trade with one another; their sum is what counts.
    assert found.seen_late == pytest.approx(0.5 * STEP + CASCADE.seen_late, rel=0.05)
    assert found.r2 > 0.99999


def test_whole_delays_of_a_law_are_rows_further_back():
    """What the grid's short cut leaves is what the law with the delay leaves."""
    s = signals_of(sampled_cascade(CASCADE, late=2))
    rows, shape = _Rows.of(s, GRID_ROWS), np.array([0.0, 0.5, 3.0, 20.0])
    for delay, left in zip(GRID[0], _by_delay(law_columns(s, "p_pi", shape), rows), strict=True):
        late = shape + np.array([delay, 0.0, 0.0, 0.0])
        assert left == pytest.approx(float(np.sum(_misfit(s, "p_pi", late, rows)[0] ** 2)), rel=1e-9)


def test_cascade_recovered_from_a_quantised_and_noisy_log():
    rng = np.random.default_rng(0)
    inside = 0
    for seed in range(4):
        data = sampled_cascade(CASCADE, seed=seed, late=1, grid=1e-7)
        noisy = data.outputs + np.array([0.0, 2.0]) * rng.standard_normal(data.outputs.shape)
        found = identify_controller(
            LoopData(STEP, data.qr, data.d, noisy, vr=data.vr, ar=data.ar), kind="p_pi"
        )
        assert found.kp * found.kv == pytest.approx(CASCADE.kp * CASCADE.kv, rel=0.02)
        assert found.kv == pytest.approx(CASCADE.kv, rel=0.02)
        error = found.kp * found.kv * np.hypot(found.errors["kp"] / found.kp, found.errors["kv"] / found.kv)
        inside += abs(found.kp * found.kv - CASCADE.kp * CASCADE.kv) < 3 * error
    assert inside >= 3


def test_the_kind_is_told_from_the_data():
    """A cascade with little feed-forward integrates the speed; no PID on the error does that."""
    law = Controller("p_pi", kp=40.0, kv=2000.0, integral=20.0, ffv=0.3)
    assert identify_controller(sampled_cascade(law)).kind == "p_pi"


def test_pid_recovered_from_its_law():
    rng = np.random.default_rng(2)
    _, vr, ar = command(4.0, STEP, rng)
    qr = np.cumsum(vr) * STEP
    e = np.cumsum(rng.standard_normal(len(qr))) * 1e-6
    e -= np.convolve(e, np.ones(200) / 200, mode="same")
    de = np.diff(e, prepend=2 * e[0] - e[1]) / STEP
    u = 5e4 * e + 8e5 * STEP * np.cumsum(e) + 900.0 * de + 30.0 * vr + 11.0 * ar + 4.0
    u = np.concatenate([np.full(2, u[0]), u[:-2]])
    data = LoopData(STEP, qr, vr, np.column_stack([e, u]), vr=vr, ar=ar)
    found = identify_controller(data)
    assert found.kind == "pid"
    expected = {"kp": 5e4, "integral": 8e5, "kd": 900.0, "ffv": 30.0, "ffa": 11.0, "delay": 2e-3}
    for name, value in expected.items():
        assert getattr(found, name) == pytest.approx(value, rel=1e-3), name
    assert found.offset == pytest.approx(4.0, rel=1e-2)
    assert found.ti == pytest.approx(5e4 / 8e5, rel=1e-3)


def test_emps_gains(data_dir):
    """EMPS: vir = kp kv (qg - qm) - kv dq with kp = 160.18, kv = 243.45 (Janot et al. 2019)."""
    path = data_dir / "emps" / "DATA_EMPS.mat"
    if not path.exists():
        pytest.skip(f"{path} is not at hand")
    raw = {k: np.squeeze(x) for k, x in scipy.io.loadmat(path).items() if not k.startswith("_")}
    qg, qm, vir = (np.asarray(raw[k], dtype=float) for k in ("qg", "qm", "vir"))
    outputs = np.column_stack([qg - qm, vir])
    found = identify_controller(LoopData(1e-3, qg, np.sign(np.gradient(qg)), outputs, axis="X"))
    assert found.kind == "p_pi"
    assert found.kp * found.kv == pytest.approx(160.18 * 243.45, rel=0.005)
    assert found.kv == pytest.approx(243.45, rel=0.005)
    assert found.rms < 3.8e-3
    assert found.integral == pytest.approx(0.0, abs=0.05)
    assert abs(found.ffv) < 0.01


def test_coupled_pid_is_the_hand_written_loop():
    truth = pid(M=12.0, C=30.0, kp=60e3, ki=9e5, kd=1.6e3, ffv=25.0, ffa=11.0)
    law = Controller("pid", kp=60e3, integral=9e5, kd=1.6e3, ffv=25.0, ffa=11.0)
    model = couple(law, 12.0, 30.0, hold=False)
    hertz = np.array([0.5, 4.0, 20.0, 90.0])
    for k, output in enumerate(("e", "u")):
        for source, name in ((0, "d"), ("qr", "qr")):
            num, den = model.numerator(output, name)
            s = 2j * np.pi * hertz
            expected = truth.response(k, source, hertz)
            assert np.polyval(num, s) / np.polyval(den, s) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("late", [0, 2])
def test_coupled_cascade_predicts_the_sampled_loop(late):
    """What-if: gains found at one setting predict the loop at another."""
    found = identify_controller(sampled_cascade(CASCADE, late=late), kind="p_pi")
    for factor in (1.0, 1.25):
        other = Controller(**{**CASCADE.to_dict(), "kv": factor * CASCADE.kv})
        data = sampled_cascade(other, seed=5, late=late)
        model = couple(found.scaled(kv=factor), 20.0, 50.0)
        y = model.simulate(data.qr, data.d, vr=data.vr, ar=data.ar)
        error = np.sqrt(np.mean((y - data.outputs) ** 2, axis=0) / np.mean(data.outputs**2, axis=0))
        assert np.max(error) < 0.05


def test_control_form_is_the_law():
    law = Controller("p_pi", kp=40.0, kv=2000.0, integral=12.0, ffv=0.9, ffa=15.0, filter_time=1e-3)
    system = law.control()
    assert system.input_labels == ["e", "v", "vr", "ar"]
    s = 2j * np.pi * 30.0
    pi = 2000.0 * (1 + 12.0 / s)
    assert law.seen_late == pytest.approx(1e-3 / (np.e - 1.0))  # a / (1 - a) samples
    expected = [pi * 40.0, -pi / (1 + law.seen_late * s), pi * 0.9, 15.0]
    assert system(s).ravel() == pytest.approx(expected)
    delayed = Controller(**{**law.to_dict(), "delay": 2e-3}).control()(s).ravel()
    assert delayed == pytest.approx(np.array(expected) * np.exp(-2e-3 * s), rel=1e-4)
    assert Controller.from_dict(law.to_dict()) == law


def test_bad_requests_are_refused():
    law = Controller("p_pi", kp=40.0, kv=2000.0)
    with pytest.raises(DataError, match="the loop is unstable"):
        couple(law.scaled(kp=1000.0), 20.0)
    with pytest.raises(InputError, match="no gain 'kq'"):
        law.scaled(kq=2.0)
    with pytest.raises(InputError, match="kind 'pd'"):
        Controller("pd", kp=1.0)
