"""The identified loop as a system: simulation, stepping form, python-control forms, intervals."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest
from scipy import signal, stats

from pinotwin.errors import DataError, TwinError
from pinotwin.loop import LoopData, LoopModel, Section, Structure, command_rates, identify_loop
from pinotwin.loop.layout import lay_out
from pinotwin.loop.projection import Projection, Scales
from pinotwin.loop.sections import continuous, discretise
from tests.loop_axes import HERTZ, advance, answers, cascade, flexure, record

STEP = 1e-3


def random_model(rng, structure=None, shape=(1, 2), step=STEP):
    """A model whose residues obey the ties of its structure, otherwise arbitrary."""
    structure = structure or Structure(pole_pairs=2, feedforward_poles=(200.0, 300.0))
    layout = lay_out(structure, step, shape)
    theta = np.array(
        [rng.uniform(low, low + 0.8 * (high - low)) for low, high in zip(*layout.box, strict=True)]
    )
    sections = layout.shaped(theta)
    residues = np.zeros((shape[1], layout.residues))
    for k in range(shape[1]):
        c, Z = layout.ties(sections, k, np.ones(shape[0] + 1)).particular()
        residues[k] = c + Z @ rng.standard_normal(Z.shape[1])
    names = ("d", "d2", "d3")[: shape[0]]
    return LoopModel("Y", names, ("e", "u", "v")[: shape[1]], step, structure, sections, residues)


def inputs(rng, n, nd=1):
    vr = np.cumsum(rng.standard_normal(n)) * 0.01
    vr -= vr[0]
    d = np.cumsum(rng.standard_normal((n, nd)), axis=0)
    return vr, d - d[0]


def test_simulate_equals_scipy():
    """Every transfer function of the model, driven by scipy with straight lines between samples."""
    rng = np.random.default_rng(0)
    model = random_model(rng, shape=(2, 3))
    vr, d = inputs(rng, 800, 2)
    t = STEP * np.arange(800)
    y = model.simulate(np.cumsum(vr) * STEP, d, vr=vr)
    for k, output in enumerate(model.outputs):
        total = np.zeros(800)
        for j, name in enumerate(model.inputs):
            num, den = model.numerator(output, name)
            if name == "qr":
                num = num[:-1]  # over s, since vr is what runs straight
            w = vr if name == "qr" else d[:, j]
            total += signal.lsim(signal.TransferFunction(num, den), w, t)[1]
        assert np.max(np.abs(total - y[:, k])) < 1e-6 * np.max(np.abs(y[:, k]))


def test_simulate_equals_python_control_state_space():
    rng = np.random.default_rng(1)
    model = random_model(rng)
    vr, d = inputs(rng, 500)
    system = model.to_control(None, None)
    assert system.input_labels == ["d", "vr", "ar"]
    assert system.output_labels == ["e", "u"]
    found = control.forced_response(system, STEP * np.arange(500), np.stack([d[:, 0], vr, 0 * vr])).outputs
    y = model.simulate(0 * vr, d, vr=vr, ar=0 * vr)
    assert np.max(np.abs(found.T - y)) < 1e-9 * np.max(np.abs(y))


def test_transfer_state_space_and_poles_agree():
    rng = np.random.default_rng(2)
    model = random_model(rng, shape=(2, 3))
    system = model.to_control(None, None)
    assert system.input_labels == ["d", "d2", "vr", "ar"]
    w = np.geomspace(1.0, 1000.0, 7)
    for output in model.outputs:
        for name in model.inputs:
            one = model.transfer(output, name)
            assert one.input_labels == [name]
            whole = model.to_control(name, output)(1j * w)
            assert np.max(np.abs(one(1j * w) - whole)) < 1e-8 * np.max(np.abs(whole))
    assert np.allclose(
        np.sort_complex(np.unique(np.round(system.poles(), 6))),
        np.sort_complex(np.unique(np.round(model.poles, 6))),
    )
    with pytest.raises(DataError, match="no output 'w'; "):
        model.transfer("w", "d")
    with pytest.raises(DataError, match="no input 'q'; did you mean 'qr'"):
        model.transfer("e", "q")


def test_discrete_equivalent_is_exact():
    rng = np.random.default_rng(3)
    model = random_model(rng)
    vr, d = inputs(rng, 300)
    system = model.to_control(None, None).sample(STEP, "foh")
    w = np.column_stack([d[:, 0], vr, 0 * vr])
    found = signal.dlsim((system.A, system.B, system.C, system.D, STEP), w)[1]
    modal = model.modal()
    x = modal.equilibrium(np.zeros(2))
    for k in range(300):
        assert answers(modal, x, w[k, :2]) == pytest.approx(found[k], rel=1e-9, abs=1e-12)
        x = advance(modal, x, w[k, :2], w[min(k + 1, 299), :2])
    continuous_system = model.to_control(None, None)
    fine = 50
    at = np.arange(fine * 300) / fine
    held = np.column_stack([np.interp(at, np.arange(300), c) for c in w.T])
    last = (299 * fine) + 1
    t = STEP / fine * np.arange(last)
    y = control.forced_response(continuous_system, t, held[:last].T).outputs.T[::fine]
    assert np.max(np.abs(y - found)) < 1e-9 * np.max(np.abs(y))


def test_derivatives_of_the_outputs_are_exact():
    """q' and q'' of Eq. 4.12 without numerical differentiation, against fine differences."""
    rng = np.random.default_rng(5)
    model = random_model(rng)
    h, n = 1e-5, 3000
    t = h * np.arange(n)
    d = np.column_stack([np.sin(40 * t) + np.cos(91 * t)])
    vr = np.sin(70 * t) + 0.2
    y = model.simulate(0 * t, d, vr=vr, ar=70 * np.cos(70 * t), step=h)
    modal = model.modal(h)
    x = modal.equilibrium(np.array([d[0, 0], vr[0]]))
    k = 1500
    w = np.column_stack([d, vr])
    for i in range(k):
        x = advance(modal, x, w[i], w[i + 1])
    dw = np.array([40 * np.cos(40 * t[k]) - 91 * np.sin(91 * t[k]), 70 * np.cos(70 * t[k])])
    ddw = np.array([-1600 * np.sin(40 * t[k]) - 8281 * np.cos(91 * t[k]), -4900 * np.sin(70 * t[k])])
    first = (y[k + 1] - y[k - 1]) / (2 * h)
    second = (y[k + 1] - 2 * y[k] + y[k - 1]) / h**2
    for order, expected, tolerance in ((1, first, 1e-5), (2, second, 1e-3)):
        C, D, E, F = modal.derivative(order)
        found = np.einsum("yki,ki->y", C, x) + D @ w[k] + E @ dw + F @ ddw
        assert found == pytest.approx(expected, rel=tolerance)
    # Seen from its own disturbance the error has relative degree 2: e' is free of d itself.
    assert abs(modal.derivative(1)[1][0, 0]) < 1e-9 * np.abs(modal.derivative(1)[0][0]).max()


def test_cold_start_is_at_rest_under_the_first_inputs():
    model = random_model(np.random.default_rng(6))
    y = model.simulate(np.full(50, 0.3), np.full(50, 7.0))
    assert np.allclose(y, y[0])
    assert y[0, 1] == pytest.approx(7.0)  # the motor holds the load


def test_split_run_equals_whole_run():
    rng = np.random.default_rng(7)
    model = random_model(rng)
    vr, d = inputs(rng, 400)
    whole = model.simulate(0 * vr, d, vr=vr)
    modal = model.modal()
    w = np.column_stack([d, vr])
    x = modal.equilibrium(w[0])
    for k in range(200):
        x = advance(modal, x, w[k], w[k + 1])
    rest = model.simulate(0 * vr[200:], d[200:], x, vr=vr[200:])
    assert np.allclose(rest, whole[200:], rtol=1e-10, atol=1e-10)


def test_feedforward_without_poles_has_no_state_space_in_qr():
    structure = Structure(real_poles=1, feedforward_poles=())
    model = random_model(np.random.default_rng(8), structure)
    with pytest.raises(DataError, match="feed-forward differentiates qr"):
        model.to_control("qr", "u")
    assert model.to_control(None, None).input_labels == ["d", "vr", "ar"]
    num, den = model.numerator("u", "qr")
    assert (len(num), len(den)) == (6, 4)  # s² more than a proper fraction: ka s² + kv s + ...
    s = 2j * np.pi * 11.0
    direct = model.to_control(None, None)(s)
    expected = direct[1, 1] * s + direct[1, 2] * s * s
    assert np.polyval(num, s) / np.polyval(den, s) == pytest.approx(expected, rel=1e-9)


def test_command_rates_are_exact_for_cubics():
    t = 0.01 * np.arange(40)
    v, a = command_rates(1 + 2 * t - 3 * t**2 + t**3, 0.01)
    assert np.allclose(v, 2 - 6 * t + 3 * t**2)
    assert np.allclose(a, -6 + 6 * t)
    assert len(command_rates(np.array([1.0]), 0.01)[0]) == 1


@pytest.mark.parametrize("values", [(90.0,), (60.0, 0.05), (60.0, 1.0), (60.0, 1.4), (5e3, 1.0)])
def test_discretisation_equals_scipy_and_its_derivatives_differences(values):
    section = Section("p", len(values), values)
    A, B = continuous(section)
    n = len(values)
    found = discretise([section], STEP)
    Ad, Bd, _, Dd, _ = signal.cont2discrete(
        (A[:n, :n], B[:n, None], np.eye(n), np.zeros((n, 1))), STEP, "foh"
    )
    # scipy's form is moved by the slope weight: x = C z + D w with C = identity.
    assert np.allclose(found.A[0, 0, :n, :n], Ad)
    assert np.allclose(found.B[0, 1, 0, :n], Dd[:, 0])
    assert np.allclose(found.B[0, 0, 0, :n], (Bd - Ad @ Dd)[:, 0])
    for i in range(n):
        ends = []
        for sign in (1, -1):
            moved = list(values)
            moved[i] *= math.exp(sign * 1e-5)
            ends.append(discretise([Section("p", n, tuple(moved))], STEP))
        for after, before, exact in (
            (ends[0].A[0, 0], ends[1].A[0, 0], found.A[0, 1 + i]),
            (ends[0].B[0, :, 0], ends[1].B[0, :, 0], found.B[0, :, 1 + i]),
        ):
            slope = (after - before) / 2e-5
            assert np.allclose(exact[:, :n], slope[:, :n], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    "structure",
    [
        Structure(),
        Structure(pole_pairs=2),
        Structure(numerators="source"),
        Structure(real_poles=1, feedforward_poles=()),
        Structure(feedforward_poles="search"),
        Structure(real_poles=4, feedforward_poles=(300.0,)),
        Structure(real_poles=2, pole_pairs=1),
    ],
)
@pytest.mark.parametrize("kind", ["rigid", "flexure"])
def test_gradient_equals_finite_differences(structure, kind):
    truth = cascade() if kind == "rigid" else flexure()
    qr, vr, ar, d, y = record(truth, 1, 2.5, fine=2)
    y = y + 0.1 * y.std(axis=0) * np.random.default_rng(0).standard_normal(y.shape)
    data = LoopData(STEP, qr, d, y, (slice(40, 900), slice(1000, 2400)), vr, ar)
    layout = lay_out(structure, STEP, (d.shape[1], y.shape[1]))
    projection = Projection(data, layout, Scales.of(data))
    low, high = layout.box
    theta = np.random.default_rng(1).uniform(0.8 * low + 0.2 * high, 0.3 * low + 0.7 * high)
    misfit = projection.evaluate(theta)
    gradient = misfit.jacobian.T @ misfit.residual
    slopes = np.empty_like(gradient)
    for i in range(len(theta)):
        costs = []
        for sign in (1, -1):
            moved = theta.copy()
            moved[i] += sign * 3e-5
            costs.append(0.5 * np.sum(projection.evaluate(moved).residual ** 2))
        slopes[i] = (costs[0] - costs[1]) / 6e-5
    cost = 0.5 * np.sum(misfit.residual**2)
    assert gradient == pytest.approx(slopes, rel=1e-4, abs=1e-6 * cost)


def test_misfit_is_that_of_the_full_length_problem():
    """The reduced rows hold exactly the misfit that a dense least squares over all rows finds."""
    qr, vr, ar, d, y = record(cascade(), 1, 2.5, fine=2)
    structure = Structure(real_poles=1, feedforward_poles=())
    data = LoopData(STEP, qr, d, y, vr=vr, ar=ar)
    layout = lay_out(structure, STEP, (1, 2))
    scales = Scales.of(data)
    theta = np.log([HERTZ * 30, HERTZ * 12, 0.5])
    found = np.sum(Projection(data, layout, scales).evaluate(theta).residual ** 2)
    # The same by hand: e over D: b1 s + b2 of d, three terms of vr; u with its fixed constant.
    p, wn, zeta = np.exp(theta)
    D = np.polymul([1.0, p], [1.0, 2 * zeta * wn, wn * wn])
    t = STEP * np.arange(len(vr))
    # Free responses of the three modes, anywhere from the states of the companion form.
    basis = lambda w: signal.lsim(signal.TransferFunction([1.0], D), w, t)[2]  # noqa: E731
    xd, xv = basis(d[:, 0]), basis(vr)
    companion = signal.TransferFunction([1.0], D).to_ss()
    free = np.stack([signal.lsim(companion, 0 * t, t, X0=np.eye(3)[i])[2] for i in range(3)])
    F = np.column_stack([free[i][:, j] for i in range(3) for j in range(3)])
    F = np.linalg.svd(F, full_matrices=False)[0][:, :3]
    total = 0.0
    columns = np.column_stack([xd[:, 1:], xv, F])
    target = y[:, 0] / scales.outputs[0]
    total += np.sum((target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]) ** 2)
    columns = np.column_stack([xd[:, :2], xv, vr, ar, F])
    target = (y[:, 1] - D[-1] * xd[:, 2]) / scales.outputs[1]
    total += np.sum((target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]) ** 2)
    assert found == pytest.approx(total, rel=1e-6)


def test_intervals_cover_the_truth():
    """Over 40 noise draws, white and coloured, poles scatter as stated and 95 % intervals hold them.

    Of 240 intervals at 95 % a binomial count is within 216 and 237 in 99.8 % of such tests. A scatter of 40 draws is
    known to 11 %, so 30 % are 2.7 of its standard errors.
    """
    truth = cascade()
    log = record(truth, 4, 3.0, straight=True)
    qr, vr, ar, d, y = log
    structure = Structure(feedforward_poles=(250.0, 250.0))
    slow = truth.poles[np.abs(truth.poles) < HERTZ * 100]
    pair = slow[slow.imag > 0][0]
    real = -slow[slow.imag == 0].real
    expected = {
        "p1": float(real[0]) / HERTZ,
        "wn1": float(abs(pair)) / HERTZ,
        "zeta1": float(-pair.real / abs(pair)),
    }
    start = np.log([expected["p1"] * HERTZ, expected["wn1"] * HERTZ, expected["zeta1"]])
    hits = []
    for colour in (0.0, 0.9):
        found = []
        rng = np.random.default_rng(11)
        for _ in range(40):
            noise = signal.lfilter(
                [math.sqrt(1 - colour**2)], [1, -colour], rng.standard_normal(y.shape), axis=0
            )
            data = LoopData(STEP, qr, d, y + 0.02 * y.std(axis=0) * noise, vr=vr, ar=ar)
            fit = identify_loop(data, structure, starts=start[None]).fit
            hits += [p.interval[0] <= expected[p.name] <= p.interval[1] for p in fit.parameters]
            found.append([(np.log(p.value), np.log(p.interval[1] / p.interval[0])) for p in fit.parameters])
        values, widths = np.moveaxis(np.array(found), 2, 0)
        assert widths.mean(axis=0) / 3.92 == pytest.approx(values.std(axis=0), rel=0.3), colour
    low, high = stats.binom.interval(0.998, len(hits), 0.95)
    assert low <= np.sum(hits) <= high


def test_broken_dictionaries_are_refused():
    model = random_model(np.random.default_rng(0))
    values = model.to_dict()
    with pytest.raises(TwinError, match="key 'sections' is missing"):
        LoopModel.from_dict({k: v for k, v in values.items() if k != "sections"})
    with pytest.raises(TwinError, match="residues have shape"):
        LoopModel.from_dict({**values, "residues": [[1.0], [2.0]]})
