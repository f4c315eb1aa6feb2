"""Poles and numerators recovered from closed loops that are written down by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pinotwin.errors import DataError, InputError
from pinotwin.loop import LoopData, LoopModel, Structure, identify_loop
from pinotwin.loop.identify import slopes
from pinotwin.loop.layout import lay_out
from pinotwin.loop.projection import Projection, Scales
from pinotwin.loop.search import polish
from tests.loop_axes import HERTZ, answers, ball_screw, cascade, flexure, pid, record

STEP = 1e-3


def noisy(log, rng, level=0.01, **other):
    qr, vr, ar, d, y = log
    noise = level * y.std(axis=0) * rng.standard_normal(y.shape)
    return LoopData(STEP, qr, d, y + noise, vr=vr, ar=ar, **other)


@pytest.fixture(scope="module")
def cascade_log():
    return record(cascade())


@pytest.fixture(scope="module")
def screw_log():
    return record(ball_screw())


def match(found, true):
    """Relative distance of each true pole to the nearest one found."""
    return np.array([np.min(np.abs(found - p)) / abs(p) for p in true])


def gains_agree(model, truth, tolerance, hertz=(1.0, 3.0, 8.0, 15.0, 30.0)):
    for k, output in enumerate(model.outputs):
        for j, source in enumerate([*range(truth.disturbances), "qr"]):
            true = truth.response(k, source, hertz)
            num, den = model.numerator(output, model.inputs[j])
            s = 2j * np.pi * np.asarray(hertz)
            found = np.polyval(num, s) / np.polyval(den, s)
            assert np.max(np.abs(found - true)) < tolerance * np.max(np.abs(true)), (output, source)


@pytest.mark.parametrize("seed", range(3))
def test_poles_and_transfer_functions_of_a_cascade(cascade_log, seed):
    truth = cascade()
    data = noisy(cascade_log, np.random.default_rng(seed))
    model = identify_loop(data, Structure(feedforward_poles=(250.0, 250.0)))
    dominant = truth.poles[np.abs(truth.poles) < HERTZ * 100]
    assert len(dominant) == 3
    assert np.max(match(model.poles, dominant)) < 0.03
    gains_agree(model, truth, 0.05)
    assert max(model.fit.nrmse.values()) < 0.012


def test_pid_with_feedforward_without_poles():
    truth = pid()
    model = identify_loop(
        noisy(record(truth, 3), np.random.default_rng(1)),
        Structure(real_poles=1, feedforward_poles=()),
    )
    assert np.max(match(model.poles, truth.poles)) < 0.03
    gains_agree(model, truth, 0.05)


@pytest.mark.parametrize("seed", range(2))
def test_vibratory_mode_of_a_ball_screw_order_7(screw_log, seed):
    truth = ball_screw()
    data = noisy(screw_log, np.random.default_rng(seed), 0.005)
    model = identify_loop(data, Structure(pole_pairs=2, feedforward_poles=(400.0, 400.0)))
    slow = truth.poles[np.abs(truth.poles) < HERTZ * 100]
    assert len(slow) == 5
    assert np.max(match(model.poles, slow)) < 0.03
    gains_agree(model, truth, 0.05)


@pytest.mark.parametrize(("level", "tolerance"), [(0.0, 1e-3), (5e-3, 0.1)])
def test_three_by_three_flexure_order_7(level, tolerance):
    truth = flexure()
    names = {"output_names": ("e", "u", "v_delta"), "disturbance_names": ("d_A", "d_delta")}
    log = record(truth, 5, straight=level == 0.0)
    data = noisy(log, np.random.default_rng(0), level, **names)
    model = identify_loop(data, Structure(pole_pairs=2, feedforward_poles=(1200.0, 1200.0)))
    assert model.inputs == ("d_A", "d_delta", "qr")
    slow = truth.poles[np.abs(truth.poles) < HERTZ * 100]
    assert np.max(match(model.poles, slow)) < 0.03
    gains_agree(model, truth, tolerance)


@pytest.mark.parametrize(
    ("truth", "structure"),
    [
        (cascade(), Structure()),
        (pid(), Structure(real_poles=1, feedforward_poles=())),
        (ball_screw(), Structure(pole_pairs=2)),
        (flexure(), Structure(pole_pairs=2)),
    ],
)
def test_exact_structure_is_that_of_the_true_loop(truth, structure):
    """Markov parameters and gains at zero of the hand-written loop obey the declared forms."""
    n = len(truth.A)
    for k in range(len(truth.C)):
        for j in range(truth.disturbances + 1):
            command = j == truth.disturbances
            form = structure.command(k) if command else structure.disturbance(k, j)
            b, c = truth.B[:, j], truth.C[k]
            size = np.linalg.norm(c) * np.linalg.norm(b) + 1e-30
            if form.degree == 2:
                assert abs(c @ b) < 1e-9 * size
            if form.gain is not None:
                gain = truth.D[k, j] - c @ np.linalg.solve(truth.A, b)
                scale = abs(c) @ abs(np.linalg.solve(truth.A, b)) + 1.0
                assert gain == pytest.approx(form.gain, abs=1e-9 * scale)
            assert n >= structure.feedback_order


def test_gain_of_the_effort_to_its_disturbance_is_exactly_one(cascade_log):
    for structure in (Structure(), Structure(numerators="source"), Structure(real_poles=2)):
        model = identify_loop(noisy(cascade_log, np.random.default_rng(9), 0.05), structure)
        num, den = model.numerator("u", "d")
        assert num[-1] == den[-1]
        assert len(num) == structure.feedback_order
        for output in ("e", "u"):
            assert model.numerator(output, "qr")[0][-1] == 0.0
        assert len(model.numerator("e", "d")[0]) == structure.feedback_order - 1
        # The residues say so too, to rounding, not only the polynomial.
        x = model.modal().equilibrium(np.array([1.0, 0.0]))
        assert answers(model.modal(), x, np.zeros(2))[1] == pytest.approx(1.0, abs=1e-9)


def test_source_structure_counts_as_in_the_thesis():
    """Eq. 4.17, 4.18 and 5.9: free numerator coefficients of the disturbance and command paths."""
    for pairs, counts in ((1, (2, 5, 2, 5)), (2, (4, 7, 4, 7))):
        for numerators in ("exact", "source"):
            structure = Structure(pole_pairs=pairs, numerators=numerators)
            found = free_counts(structure, (1, 2))
            assert found == counts
    assert free_counts(Structure(pole_pairs=2), (2, 3)) == (4, 3, 7, 4, 4, 7, 3, 4, 5)


def free_counts(structure, shape):
    layout = lay_out(structure, STEP, shape)
    counts = []
    for k in range(shape[1]):
        ties = layout.ties(layout.sections, k, np.ones(shape[0] + 1))
        for j in range(shape[0] + 1):
            own = np.zeros(layout.residues, dtype=bool)
            for slot in layout.slots:
                own[slot.at : slot.at + slot.order] |= slot.input == j
            tied = np.linalg.matrix_rank(ties.N[own])
            counts.append(int(own.sum() - tied))
    return tuple(counts)


def test_feedforward_poles_above_nyquist():
    """250 Hz poles on data sampled at 250 Hz (thesis 4.3.2): discretised exactly."""
    truth = cascade(M=40.0, kp=30.0, kv=2400.0, ti=0.08, ff=250.0)
    structure = Structure(feedforward_poles=(250.0, 250.0))
    qr, vr, ar, d, y = record(truth, 2, 12.0, 4e-3, 40, straight=True)
    model = identify_loop(LoopData(4e-3, qr, d, y, vr=vr, ar=ar), structure)
    slow = truth.poles[np.abs(truth.poles) < HERTZ * 100]
    assert np.max(match(model.poles, slow)) < 1e-4
    assert max(model.fit.nrmse.values()) < 1e-5
    assert np.sum(np.isclose(model.poles, -HERTZ * 250.0)) == 2
    gains_agree(model, truth, 1e-3)
    # Where friction reverses within a sample the log itself is ambiguous; the loop is still found.
    qr, vr, ar, d, y = record(truth, 2, 12.0, 4e-3, 40)
    model = identify_loop(LoopData(4e-3, qr, d, y, vr=vr, ar=ar), structure)
    assert np.max(match(model.poles, slow)) < 0.06


def test_overdamped_loop_needs_no_complex_pair():
    truth = cascade(kp=8.0, kv=4000.0, ti=0.4)
    slow = truth.poles[np.abs(truth.poles) < HERTZ * 100]
    assert np.all(slow.imag == 0)
    data = noisy(record(truth, 6), np.random.default_rng(0), 0.003)
    structure = Structure(feedforward_poles=(250.0, 250.0))
    model = identify_loop(data, structure, bounds={"zeta1": (0.1, 9.0)})
    gains_agree(model, truth, 0.05)


def test_segments_with_unknown_start(cascade_log):
    """A log cut anywhere, in mid-move, gives the same poles as the whole."""
    qr, vr, ar, d, y = cascade_log
    cuts = (slice(137, 2500), slice(2611, 5003), slice(5101, 8000))
    data = LoopData(STEP, qr, d, y, cuts, vr, ar)
    model = identify_loop(data, Structure(feedforward_poles=(250.0, 250.0)))
    slow = cascade().poles[np.abs(cascade().poles) < HERTZ * 100]
    assert np.max(match(model.poles, slow)) < 0.01
    assert max(model.fit.nrmse.values()) < 2e-3


def test_never_unstable_on_hard_data(cascade_log):
    rng = np.random.default_rng(0)
    qr, vr, ar, d, y = cascade_log
    cases = {
        "short": slice(200, 500),
        "noise": slice(0, 3000),
        "saturated": slice(0, 3000),
        "one move": slice(100, 400),
    }
    for name, rows in cases.items():
        z = y[rows].copy()
        if name == "noise":
            z = rng.standard_normal(z.shape) * z.std(axis=0)
        if name == "saturated":
            z[:, 1] = np.clip(z[:, 1], -0.3 * z[:, 1].std(), 0.3 * z[:, 1].std())
        for pairs in (1, 2):
            data = LoopData(STEP, qr[rows], d[rows], z, vr=vr[rows], ar=ar[rows])
            model = identify_loop(data, Structure(pole_pairs=pairs))
            assert np.all(model.poles.real < 0.0)
            assert np.all(np.isfinite(model.residues))


def test_what_is_left_is_told_by_no_slope(cascade_log):
    data = noisy(cascade_log, np.random.default_rng(5))
    model = identify_loop(data, Structure())
    rows = np.r_[*data.segments]
    left = (data.outputs - model.simulate(data.qr, data.d, vr=data.vr, ar=data.ar))[rows]
    left /= np.sqrt(np.mean(data.outputs[rows] ** 2, axis=0))
    S = slopes(data, model)
    assert len(S) == left.size
    told = np.abs(S.T @ left.ravel()) / np.linalg.norm(S, axis=0) / np.linalg.norm(left)
    assert np.max(told) < 0.01


def test_a_search_from_its_own_end_stays_there(cascade_log):
    """One start is where another search ended: all rows at once, in a few evaluations."""
    data = noisy(cascade_log, np.random.default_rng(0))
    found = identify_loop(data)
    theta = [np.log(x) for part in found.sections if part.free for x in part.values]
    again = identify_loop(data, starts=np.array([theta]))
    assert again.fit.evaluations < 8 < found.fit.evaluations
    assert again.fit.ends == (1.0,)
    assert np.max(np.abs(again.poles / found.poles - 1.0)) < 1e-3


def test_a_search_from_anywhere_ends_below_its_start(cascade_log):
    data = noisy(tuple(x[:1500] for x in cascade_log), np.random.default_rng(0), 0.1)
    layout = lay_out(Structure(), STEP, (1, 2))
    projection = Projection(data, layout, Scales.of(data))
    low, high = layout.box
    rng = np.random.default_rng(3)
    for _ in range(10):
        start = rng.uniform(low, high)
        end = polish(projection, start, 1e-4, 15)
        assert end.cost < 0.5 * np.sum(projection.evaluate(start).residual ** 2)
        assert end.cost == pytest.approx(0.5 * np.sum(projection.evaluate(end.x).residual ** 2))
        assert np.all((low <= end.x) & (end.x <= high))


def test_idle_and_short_logs_are_refused(cascade_log):
    qr, vr, ar, d, y = cascade_log
    still = LoopData(STEP, np.ones(500), d[:500], y[:500], axis="C")
    with pytest.raises(DataError, match="C: the command never moves in this log"):
        identify_loop(still)
    with pytest.raises(DataError, match="40 samples in unbroken segments, at least 64"):
        identify_loop(LoopData(STEP, qr[:40], d[:40], y[:40]))
    with pytest.raises(DataError, match="channel 'u' is constant"):
        identify_loop(LoopData(STEP, qr, d, np.column_stack([y[:, 0], 0 * qr]), vr=vr, ar=ar))
    broken = y.copy()
    broken[100, 1] = np.nan
    with pytest.raises(DataError, match="outputs has NaN"):
        LoopData(STEP, qr, d, broken)
    LoopData(STEP, qr, d, broken, (slice(0, 100), slice(101, 4000)))
    with pytest.raises(InputError, match="no searched parameter 'wn9'"):
        identify_loop(LoopData(STEP, qr, d, y), bounds={"wn9": (1, 2)})
    with pytest.raises(InputError, match="at least 2 is needed"):
        Structure(real_poles=1, pole_pairs=0, feedforward_poles=(100.0,))
    with pytest.raises(InputError, match=r"unknown key 'pairs'.*pole_pairs"):
        Structure.from_dict({"pairs": 2})


def test_bounds_are_reported(cascade_log):
    data = noisy(cascade_log, np.random.default_rng(0))
    model = identify_loop(data, bounds={"wn1": (30.0, 60.0)})
    assert "wn1" in [p.name for p in model.fit.parameters if p.at_bound]
    row = next(r for r in model.pole_table() if r["name"] == "wn1")
    assert row["at_bound"] == "lower"
    assert row["interval"] is None
    assert "ended on its lower bound" in model.fit.notes[0]


def test_dictionary_round_trip_is_exact(screw_log):
    data = noisy(screw_log, np.random.default_rng(0), axis="X")
    model = identify_loop(data, Structure(pole_pairs=2))
    text = json.dumps(model.to_dict(), allow_nan=False)
    again = LoopModel.from_dict(json.loads(text))
    assert again.to_dict() == model.to_dict()
    assert np.array_equal(again.residues, model.residues)
    y = model.simulate(data.qr, data.d, vr=data.vr, ar=data.ar)
    assert np.array_equal(y, again.simulate(data.qr, data.d, vr=data.vr, ar=data.ar))


def test_identification_is_deterministic(cascade_log):
    data = noisy(cascade_log, np.random.default_rng(0))
    assert identify_loop(data).to_dict() == identify_loop(data).to_dict()


@pytest.mark.parametrize(
    "structure", [Structure(), Structure(pole_pairs=2), Structure(feedforward_poles="search")]
)
@pytest.mark.parametrize("bounds", [None, {"p1": (1.0, 900.0), "wn1": (1.0, 900.0)}])
def test_no_searched_pole_lies_above_nyquist(cascade_log, structure, bounds):
    data = noisy(cascade_log, np.random.default_rng(3), 0.05)
    nyquist = 0.5 / data.step
    for p in identify_loop(data, structure, bounds=bounds).fit.parameters:
        assert p.unit == "-" or p.value <= p.bounds[1] <= nyquist
        assert p.error is not None or p.at_bound is not None


def test_bounds_above_nyquist_are_refused(cascade_log):
    with pytest.raises(InputError, match=r"bounds of p1: .* the log shows nothing above 500 Hz"):
        identify_loop(noisy(cascade_log, np.random.default_rng(3)), bounds={"p1": (600.0, 900.0)})
