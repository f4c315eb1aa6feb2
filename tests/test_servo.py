"""The coupled loop: law, kernels, search. The truths here are simulated or written out, none is fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import pinotwin as pt
from pinotwin.columns import bind
from pinotwin.identification.coupled import axis_problem, choice, command_velocity, own_friction
from pinotwin.identification.servo.output_error import Found
from pinotwin.identification.servo.problem import AS_FOUND, AxisProblem
from pinotwin.identification.servo.structure import afresh, doubtful, look, settle
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.loop import Servo, close, command_rates, margins
from pinotwin.loop.margins import command_peak, stable
from pinotwin.machine.sections import parse_columns
from pinotwin.simulation import feedforward, simulate
from pinotwin.simulation.law import LONGEST, biquad
from pinotwin.simulation.plant import plant_of
from pinotwin.simulation.tables import tabulate
from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual.random_machine import write_random_machine
from tests.simulated import known_twin, plain_machine, smooth_command
from tests.slide import slide

M, B = 40.0, 60.0


def find(p: AxisProblem, friction=(), allowed=lambda factors: True) -> Found | None:
    found = look(p, friction, allowed)
    return None if found is None else settle(p, found)


def cascade(kp=60.0, kv=5000.0, rate=40.0, ffv=0.93, ffa=30.0, **shapes) -> Servo:
    seen = 1.0 - rate * shapes.get("velocity_lag", 0.0)
    gains = (kv * (kp + rate), kv * kp * rate, kv * seen, kv * ffv, kv * rate * (ffv - 1.0), ffa)
    return Servo(gains, **shapes)


def drive(qr, step, *, kp=60.0, kv=5000.0, rate=40.0, ffv=0.93, ffa=30.0, lag=3e-4, friction=15.0):
    """e and u of a P-PI drive at 8 kHz around M, B and a Coulomb level, written as a drive does it.

    Velocity by a filtered difference, the integral of the velocity error by sums, stick by clamping.
    """
    h = 1.25e-4
    sub = round(step / h)
    t = step * np.arange(len(qr))
    spline = CubicSpline(t, qr)
    fine = h * np.arange((len(qr) - 1) * sub + 1)
    r, vr, ar = (spline(fine, k) for k in range(3))
    seen, total, q, v, alpha = 0.0, 0.0, float(qr[0]), 0.0, h / (lag + 0.5 * h)
    last, rows = q, []
    for k in range(len(fine)):
        seen += alpha * ((q - last) / h - seen)
        last, e = q, r[k] - q
        wanted = kp * e + ffv * vr[k] - seen
        u = kv * wanted + total + ffa * ar[k]
        total += kv * rate * wanted * h
        if k % sub == 0:
            rows.append((e, u))
        v += h * (u - B * v) / M
        v -= float(np.clip(v, -h * friction / M, h * friction / M))
        q += h * v
    return np.array(rows)


def single(log: Log, servo: Servo, friction: float = 15.0) -> AxisProblem:
    """One axis of M, B and a Coulomb level, its windows on a command; measured channels are still empty."""
    machine = plain_machine("trunnion")
    effects = [(e, np.array([friction])) for e in machine.axes["Y"].effects if e.name == "coulomb"]
    top = np.array([1.0, 1.0, 1.0])
    tables = own_friction(tabulate(machine, effects, np.array([-top, top]), top).lookup, 0)
    t, qr = log.t, log["Y.qr"]
    step = float(t[1] - t[0])
    n = len(t) // 3
    windows = tuple(slice(k * n, (k + 1) * n) for k in range(3))
    zero = np.zeros(len(t))
    return AxisProblem(step, qr, np.gradient(qr, step), qr, zero, zero, zero, M, B, tables, windows)


def with_measurement(problem: AxisProblem, servo: Servo, rng, noise: float) -> AxisProblem:
    """Fill in what the axis would have shown, from one long run, with noise on the effort and the position."""
    whole = replace(problem, windows=(slice(0, len(problem.qr)),))
    y = whole.response(servo)
    assert y is not None
    e, u = np.zeros(len(problem.qr)), np.zeros(len(problem.qr))
    e[problem.skip :], u[problem.skip :] = y.T
    q = problem.qr - e
    v = np.gradient(q, problem.step)
    q = np.round(q / 1e-7) * 1e-7
    u = u + noise * np.std(u) * rng.normal(size=len(u))
    found = replace(problem, q=q, v=v, u=u, windows=problem.windows[1:])
    return replace(found, sizes=np.sqrt(np.mean(found.measured**2, axis=0)))


def test_the_law_of_a_cascade_is_that_of_its_named_gains():
    servo = cascade()
    named = servo.cascade()
    for name, value in (
        ("kp", 60.0),
        ("kv", 5000.0),
        ("rate", 40.0),
        ("ffv", 0.93),
        ("ffa", 30.0),
        ("weight", 1.0),
    ):
        assert named[name] == pytest.approx(value, rel=1e-9)
    loop = close(servo, M, B)
    s = 2j * np.pi * 7.0
    C, P = 5000.0 * (1.0 + 40.0 / s), 1.0 / (s * (M * s + B))
    for (y, x), expected in {
        ("e", "d"): P / (1.0 + P * C * (60.0 + s)),
        ("e", "qr"): (1.0 + P * C * (s - 0.93 * s) - P * 30.0 * s**2) / (1.0 + P * C * (60.0 + s)),
    }.items():
        assert np.divide(*(np.polyval(p, s) for p in loop.numerator(y, x))) == pytest.approx(
            expected, rel=1e-9
        )


def test_a_drives_own_arithmetic_is_the_law_of_its_named_gains():
    """Written as sums and differences at 8 kHz, its integral sees the late velocity as well.

    Without that term e would be 1.4 % off here, and kp and 1/ti a fifth.
    """
    log = smooth_command(plain_machine("trunnion"), 6.0, 500.0)
    problem = single(log, cascade())
    whole = replace(
        problem, windows=(slice(0, len(problem.qr)),), vr=command_rates(problem.qr, problem.step)[0]
    )
    true = drive(problem.qr, problem.step)[whole.skip :]
    servo = Servo.of_cascade(60.0, 5000.0, 40.0, 0.93, 30.0, velocity_lag=3e-4)
    said = whole.response(servo)
    assert np.sqrt(np.mean((said - true) ** 2, axis=0) / np.mean(true**2, axis=0)) == pytest.approx(
        0.0, abs=4e-3
    )


def test_named_gains_and_back():
    for rate, ffv, weight in ((40.0, 0.93, 1.0), (20.0, 0.7, 0.4), (90.0, 0.9, 1.0)):
        servo = Servo.of_cascade(60.0, 5000.0, rate, ffv, 30.0, weight, velocity_lag=4e-4)
        true = {"kp": 60.0, "kv": 5000.0, "rate": rate, "ffv": ffv, "ffa": 30.0, "weight": weight}
        assert any(found == pytest.approx(true, rel=1e-9) for found in servo.cascades())


def test_gains_of_a_drive_come_with_intervals_that_hold_them():
    """kp, kv, 1/ti, ffv and ffa within 5 % and within their intervals, from a quantised and noisy log."""
    log = smooth_command(plain_machine("trunnion"), 12.0, 500.0)
    problem = single(log, cascade())
    rng = np.random.default_rng(4)
    e, u = drive(problem.qr, problem.step, ffv=0.85).T
    q = np.round((problem.qr - e) / 1e-7) * 1e-7
    u = u + 0.01 * np.std(u) * rng.normal(size=len(u))
    vr = command_rates(problem.qr, problem.step)[0]
    problem = replace(problem, q=q, u=u, v=np.gradient(q, problem.step), vr=vr)
    problem = replace(problem, sizes=np.sqrt(np.mean(problem.measured**2, axis=0)))
    found = find(problem)
    assert found is not None
    told = found.servo.intervals()
    for name, value in (("kp", 60.0), ("kv", 5000.0), ("rate", 40.0), ("ffv", 0.85), ("ffa", 30.0)):
        assert found.servo.named()[name] == pytest.approx(value, rel=0.05), name
        assert told[name][0] < value < told[name][1], name
        assert told[name][1] - told[name][0] < 0.3 * value, name


def test_kp_and_1_over_ti_that_cannot_be_told_apart_are_said_to_be_tied():
    """With complete feed-forward of velocity the law is symmetric in the two: the intervals hold both ways round."""
    servo = cascade(ffv=1.0, velocity_lag=3e-4, output_lag=1.5e-4, dead=1e-4)
    log = smooth_command(plain_machine("trunnion"), 12.0, 500.0)
    rng = np.random.default_rng(6)
    problem = with_measurement(replace(single(log, servo), fine=LONGEST), servo, rng, 0.02)
    found = find(replace(problem, q=problem.q + 1e-6 * rng.normal(size=len(problem.q))))
    assert found is not None
    told = found.servo.intervals()
    assert told["kp"][0] < 60.0 < told["kp"][1]
    assert told["rate"][0] < 40.0 < told["rate"][1]
    other = found.servo.other  # the two exchanged
    assert (other["kp"], other["rate"]) == (pytest.approx(40.0, rel=0.1), pytest.approx(60.0, rel=0.1))
    assert told["kp"][1] - told["kp"][0] > 20.0


SHAPES = ({}, {"velocity_lag": 4e-4, "output_lag": 2e-4, "dead": 3e-4}, {"notch": (110.0, 0.08, 0.6)})


@pytest.mark.parametrize("shapes", SHAPES)
def test_the_closed_loop_moves_the_known_mass(shapes):
    """u - d = M a + B v, after the dead time: read from the transfer functions at several frequencies."""
    servo = cascade(**shapes)
    loop = close(servo, M, B)
    for f in (1.0, 15.0, 80.0):
        s = 2j * np.pi * f
        e, u = (np.divide(*(np.polyval(p, s) for p in loop.numerator(y, "d"))) for y in "eu")
        late = np.exp(-s * servo.dead)
        assert u * late - 1.0 == pytest.approx(-(M * s**2 + B * s) * e, rel=2e-3)


def test_the_notch_is_the_one_written_down():
    h, (f, zeros, poles) = 1.25e-4, (90.0, 0.1, 0.6)
    b = biquad((f, zeros, poles), h)
    for at in (20.0, 90.0, 200.0):
        z = np.exp(2j * np.pi * at * h)
        found = (b[0] + b[1] / z + b[2] / z**2) / (1.0 + b[3] / z + b[4] / z**2)
        s, w = 2j * np.pi * at, 2.0 * np.pi * f
        truth = (s**2 + 2 * zeros * w * s + w**2) / (s**2 + 2 * poles * w * s + w**2)
        assert found == pytest.approx(truth, rel=0.02)


@pytest.mark.parametrize(
    ("shapes", "rate", "within"),
    [
        ({"velocity_lag": 3e-4, "output_lag": 1.5e-4, "dead": 1e-4}, 500.0, 0.03),
        ({"velocity_lag": 5e-4, "output_lag": 2e-4, "dead": 1e-4, "notch": (95.0, 0.08, 0.6)}, 250.0, 0.08),
    ],
)
def test_gains_come_back_from_noisy_data(shapes, rate, within):
    rng = np.random.default_rng(5)
    servo = cascade(**shapes)
    log = smooth_command(plain_machine("trunnion"), 12.0, rate)
    problem = with_measurement(single(log, servo), servo, rng, 0.01)
    found = find(problem)
    assert found is not None
    assert found.errors == pytest.approx((0.0, 0.01), abs=0.004)
    assert found.servo.gains[0] == pytest.approx(servo.gains[0], rel=within)
    other = single(smooth_command(plain_machine("trunnion"), 6.0, rate, seed=8), servo)
    said, true = other.response(found.servo), other.response(servo)
    assert np.sqrt(np.mean((said - true) ** 2, axis=0) / np.mean(true**2, axis=0)) == pytest.approx(
        0.0, abs=0.02
    )


def test_friction_is_refined_only_as_far_as_the_plant_allows():
    """A plant with 10 % too little viscous and 5 % too much dry friction: both come back, or are refused."""
    servo = cascade(velocity_lag=3e-4, output_lag=1.5e-4, dead=1e-4)
    true = single(smooth_command(plain_machine("trunnion"), 12.0, 500.0), servo, friction=40.0)
    problem = with_measurement(true, servo, np.random.default_rng(2), 0.005).with_plant(
        (1.0, 0.9, 1.05, 1.0, 1.0)
    )
    found, kept = (look(problem, ("viscous", "dry"), lambda factors, x=x: x) for x in (True, False))
    assert found is not None
    assert kept is not None
    assert found.factors[1] == pytest.approx(1.0 / 0.9, rel=0.05)
    assert found.factors[2] == pytest.approx(1.0 / 1.05, rel=0.02)
    assert found.errors[0] < kept.errors[0]
    assert kept.factors == AS_FOUND


def test_usual_tunings_find_a_controller_without_least_squares():
    """The search afresh knows nothing but the inertia, and still ends at the drive that made the log."""
    servo = cascade(velocity_lag=3e-4, output_lag=1.5e-4, dead=1e-4)
    log = smooth_command(plain_machine("trunnion"), 12.0, 500.0)
    problem = with_measurement(single(log, servo), servo, np.random.default_rng(3), 0.01)
    train, judge = problem.split()
    best = afresh(train)[0]
    assert best.errors == pytest.approx((0.0, 0.01), abs=0.01)
    assert best.servo.gains[0] == pytest.approx(servo.gains[0], rel=0.05)
    assert not doubtful(judge, best)
    assert doubtful(judge, replace(best, servo=best.servo.scaled(all=0.3)))


def test_a_cascade_is_recognised_by_its_ties():
    servo = cascade(ffv=0.6, velocity_lag=3e-4, output_lag=1.5e-4, dead=1e-4)
    log = smooth_command(plain_machine("trunnion"), 12.0, 500.0)
    found = find(with_measurement(single(log, servo), servo, np.random.default_rng(3), 0.01))
    assert found is not None
    assert found.servo.form == "cascade"
    for name, value in (("kp", 60.0), ("kv", 5000.0), ("rate", 40.0), ("ffv", 0.6), ("ffa", 30.0)):
        assert found.servo.cascade()[name] == pytest.approx(value, rel=0.05), name


@pytest.mark.parametrize("ahead", [(0.0, 0.0), (0.0, 30.0), (0.6, 20.0)])
def test_feed_forward_of_a_law_without_an_integral_is_found_where_there_is_any(ahead):
    """Behind its command e, v and vr go nearly in one ratio; neither may take the others' part."""
    truth = Servo.of_cascade(60.0, 5000.0, 0.0, *ahead, velocity_lag=5e-4, output_lag=1e-4)
    log = smooth_command(plain_machine("trunnion"), 12.0, 1000.0)
    found = find(with_measurement(single(log, truth), truth, np.random.default_rng(1), 0.01))
    assert found is not None
    assert found.servo.form == "proportional"
    for name in ("kp", "kv", *(("ffv",) if ahead[0] else ()), *(("ffa",) if ahead[1] else ())):
        assert found.servo.named()[name] == pytest.approx(truth.cascade()[name], rel=0.05), name
    if not any(ahead):
        assert found.servo.gains[3:] == (0.0, 0.0, 0.0)
        assert all(low <= truth.named()[k] <= high for k, (low, high) in found.servo.intervals().items())


def test_a_law_without_an_integral_is_found_as_such():
    servo = Servo((3e5, 0.0, 5000.0, 100.0, 0.0, 0.0), velocity_lag=2e-4, form="proportional", offset=4.0)
    log = smooth_command(plain_machine("trunnion"), 12.0, 1000.0)
    found = find(with_measurement(single(log, servo), servo, np.random.default_rng(1), 0.01))
    assert found is not None
    assert found.servo.form == "proportional"
    assert found.servo.gains[0] == pytest.approx(3e5, rel=0.02)
    assert found.servo.offset == pytest.approx(4.0, abs=1.0)


class TestKernels:
    def test_one_axis_alone_and_in_a_machine_step_alike(self, tmp_path):
        """The scalar kernel against the general one, on a machine of one axis with dry friction."""
        folder = slide(tmp_path)
        machine, virtual = pt.Machine.load(folder), VirtualMachine.load(folder)
        log = virtual.record(random_trajectory(virtual, 4.0, 1), seed=1).to_log()
        twin = pt.identify(machine, log)
        raw = prepare(machine, log, cutoff=0.0, decimate=1)
        vr = command_velocity(raw)
        problem = axis_problem(twin, raw, raw, vr, np.zeros(len(raw)), plant_of(twin, raw.qr, vr).tables, "X")
        rows = np.concatenate([np.arange(s.start, s.stop) for s in raw.segments])
        asked = Log({"t": log.t[rows], "X.qr": log["X.qr"][rows]}, "command")
        said = simulate(twin, asked, controller="coupled")
        whole = replace(
            problem,
            fine=LONGEST,
            windows=(slice(rows[0], rows[-1] + 1),),
            q=raw.qr[:, 0] - said["X.e"][0],
            v=vr[:, 0],
            u=np.full(len(raw), said["X.u"][0]),
        )
        y = whole.response(twin.servos["X"])
        for k, name in enumerate(("X.e", "X.u")):
            x = said[name][whole.skip :]
            assert np.sqrt(np.mean((y[:, k] - x) ** 2)) < 1e-6 * np.sqrt(np.mean(x**2))

    def test_an_axis_at_rest_holds_and_the_integrator_winds_up(self):
        """An error smaller than what breaks friction loose stays as it is; the effort grows by k_i e t."""
        t = np.arange(4001) / 4000.0
        command = np.where(t > 0.9, 0.1, 0.0)  # moves after the window
        servo = cascade(kp=5.0, rate=2.0)
        problem = single(Log({"t": t, "Y.qr": command}, "rest"), servo)
        held = replace(problem, vr=0.0 * t, q=np.full(len(t), -1e-6), windows=(slice(0, 3600),))
        y = held.response(servo)
        e, u = y.T
        assert np.ptp(e) == 0.0
        growth = (u[-1] - u[0]) / (servo.gains[1] * 1e-6 * (t[3599] - t[held.skip]))
        assert growth == pytest.approx(1.0, rel=1e-3)

    def test_saturation_stops_the_integrator(self):
        log = smooth_command(plain_machine("trunnion"), 3.0, 1000.0)
        free = single(log, cascade())
        y = free.response(cascade())
        limit = 0.5 * float(np.abs(y[:, 1]).max())
        limited = free.response(cascade(limit=limit, output_lag=1e-4))
        assert limited is None or np.abs(limited[:, 1]).max() <= limit * (1 + 1e-9)

    def test_any_gains_keep_the_energy_of_friction_down(self):
        """Twenty random axes with large dry friction: none chatters, at 4 kHz, whatever the Coulomb level."""
        rng = np.random.default_rng(0)
        log = smooth_command(plain_machine("trunnion"), 2.0, 500.0)
        for _ in range(20):
            w = 2 * np.pi * rng.uniform(3.0, 12.0)
            ffv, ffa = rng.uniform(0.0, 1.0), M * rng.uniform(0.0, 1.0)
            servo = cascade(kp=0.8 * w, kv=2.4 * w * M, rate=0.6 * w, ffv=ffv, ffa=ffa)
            y = single(log, servo, friction=float(10.0 ** rng.uniform(0.0, 2.5))).response(servo)
            assert y is not None
            steps = np.diff(y[:, 1])
            assert np.mean(steps[1:] * steps[:-1] < 0.0) < 0.03  # an effort that chatters turns at every step


def test_a_twin_knows_how_it_is_simulated():
    """Coupled and black differ only in how friction turns: over a width there, stuck and loose here."""
    twin = known_twin(plain_machine("trunnion"))
    log = smooth_command(twin.machine, 1.0, 500.0)
    said, black = (simulate(twin, log, controller=c) for c in (twin.servos, "black"))
    for name in twin.machine.axes:
        x, y = said[f"{name}.u"], black[f"{name}.u"]
        assert np.sqrt(np.mean((x - y) ** 2) / np.mean(y**2)) < 0.1
    with pytest.raises(pt.errors.TwinError, match="no controllers"):
        simulate(replace(twin, servos={}), log, controller="coupled")
    servo = cascade(notch=(80.0, 0.1, 0.6), dead=1e-4, limit=300.0)
    assert Servo.from_dict(servo.to_dict()) == servo


@pytest.mark.parametrize("seed", [11, 12])
def test_no_random_machine_leaves_its_command(tmp_path, seed):
    folder = write_random_machine(tmp_path / "machine", seed)
    virtual = VirtualMachine.load(folder)
    logs = [virtual.record(random_trajectory(virtual, 8.0, path), seed=path).to_log() for path in (1, 2)]
    twin = pt.identify(pt.Machine.load(folder), logs[0])
    said = twin.simulate(logs[1])
    for name in twin.machine.axes:
        travel = float(np.ptp(logs[1][f"{name}.qr"]))
        assert np.abs(said[f"{name}.e"]).max() < 0.05 * travel
        assert np.isfinite(said[f"{name}.u"]).all()


def test_a_slow_log_gets_no_loop_and_one_line(tmp_path):
    virtual = VirtualMachine.load(slide(tmp_path))
    log = virtual.record(random_trajectory(virtual, 60.0, 1), seed=1).to_log()
    every = round(1.0 / 10.0 / float(np.median(np.diff(log.t))))
    slow = Log({name: x[::every] for name, x in log.channels.items()}, "slow")
    twin = pt.identify(pt.Machine.load(slide(tmp_path)), slow)
    assert not twin.loops
    assert sum("Hz, at least" in line for line in twin.quality["warnings"]) == 1


def test_margins_are_where_the_closed_loop_becomes_unstable():
    """Gains raised by the gain margin, and dead time by the delay margin, bring a pole to the axis."""
    servo = cascade(velocity_lag=4e-4, output_lag=2e-4, dead=5e-4)
    found = margins(servo, M, B)
    assert found.gain == pytest.approx(13.19, rel=0.01)
    assert close(servo.scaled(all=0.97 * found.gain), M, B).poles.real.max() < 0.0
    with pytest.raises(pt.errors.DataError, match="unstable"):
        close(servo.scaled(all=1.03 * found.gain), M, B)
    assert close(replace(servo, dead=servo.dead + 0.9 * found.delay), M, B).poles.real.max() < 0.0
    with pytest.raises(pt.errors.DataError, match="unstable"):
        close(replace(servo, dead=servo.dead + 1.1 * found.delay), M, B)


def test_a_law_that_throws_its_axis_off_is_told_from_one_that_holds_it():
    """The error for a command of size 1 is that of the simulated loop; an absurd feed-forward makes it large."""
    servo = cascade(velocity_lag=4e-4, output_lag=2e-4, dead=5e-4, ffv=0.5, ffa=0.0)
    loop, f = close(servo, M, B), np.array([0.5, 3.0, 12.0])
    t = np.arange(0.0, 12.0, 5e-4)
    for x in f:
        w = 2.0 * np.pi * x
        qr, vr, ar = np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t)
        e = replace(loop, step=5e-4).simulate(qr, 0.0 * t, vr=vr, ar=ar)[len(t) // 2 :, 0]
        assert np.sqrt(2.0 * np.mean(e**2)) == pytest.approx(
            command_peak(servo, M, B, np.array([x])), rel=0.01
        )
    assert command_peak(servo, M, B, f) < 3.0
    assert command_peak(replace(servo, gains=(*servo.gains[:5], 1e3 * M)), M, B, f) > 10.0
    assert stable(servo, M, B)
    assert not stable(servo.scaled(all=1.03 * margins(servo, M, B).gain), M, B)


def test_the_effort_ahead_of_time_is_that_of_axes_that_follow_their_command():
    """Axes without a controller do just that in a simulation, which finds their effort by its own kernel."""
    twin = known_twin(plain_machine("trunnion"))
    log = smooth_command(twin.machine, 2.0, 1000.0)
    servo = twin.servos["Y"].scaled(ffv=1.0 / 0.9)
    ahead, said = feedforward(twin, log), simulate(replace(twin, servos={}), log, controller={"Y": servo})
    for name in ("A", "C"):
        x, y = ahead[f"{name}.u"], said[f"{name}.u"]
        assert np.sqrt(np.mean((x - y) ** 2) / np.mean(y**2)) < 0.05, name


def test_the_form_is_chosen_on_a_log_under_the_names_of_its_controller():
    """A log of another time column than t, in ms, ended `identify` after its work was done."""
    names = [f"{axis}.{k}" for axis in "YAC" for k in ("qr", "q", "u")]
    own = {"t": {"column": "Zeit", "unit": "ms"}} | {k: {"column": f"kanal {k}"} for k in names}
    machine = replace(plain_machine("trunnion"), columns=parse_columns(own))
    twin = replace(known_twin(machine), servos={"Y": cascade()})
    command = smooth_command(machine, 3.0, 250.0)
    said = twin.simulate(command, controller="black")
    log = Log({**command.channels, **{k: said[k] for k in names if not k.endswith("qr")}})
    raw = Log({"Zeit": 1e3 * log.t} | {f"kanal {k}": log[k] for k in names})
    found = choice(twin, bind(raw, machine.columns), ("black",))
    assert found["to"] == pytest.approx(log.t[-1])
    assert found["tracking"] == pytest.approx(choice(twin, log, ("black",))["tracking"])
    assert found["use"] == "black"


def test_an_encoders_steps_wind_the_integral_up_at_rest():
    """An axis stands 0.3 steps from its command; the law sees it a whole step off or none, and winds up on that."""
    servo = cascade(velocity_lag=3e-4)
    log = smooth_command(plain_machine("trunnion"), 3.0, 500.0)
    qr = np.append(np.full(len(log.t) - 1, 7e-6), 1e-3)  # the last row is outside the window
    problem = single(Log({"t": log.t, "Y.qr": qr}), servo, friction=400.0)
    problem = replace(problem, windows=(slice(0, len(qr) - 5),), q=qr, vr=np.zeros(len(qr)))
    plain, stepped = (problem.response(replace(servo, encoder=(x, 0.0))) for x in (0.0, 1e-5))
    assert plain is not None
    assert stepped is not None
    assert np.ptp(plain[:, 1]) < 1e-6
    t = problem.step * np.arange(len(stepped))
    assert np.polyfit(t, stepped[:, 1], 1)[0] == pytest.approx(servo.gains[1] * (7e-6 - 1e-5), rel=0.01)
