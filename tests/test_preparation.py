"""Preparation: one filter for every channel, derivatives, breaks of the log, rows that are used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pinotwin.errors import DataError, LogError
from pinotwin.log import Log
from pinotwin.logs.check import check
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from tests.rig import YAML, good_log, write_machine

RATE = 1000.0
N = 6000


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return Machine.load(write_machine(tmp_path_factory.mktemp("rig") / "rig"))


def multisine(n: int = N) -> tuple[np.ndarray, ...]:
    """Return time, position, velocity and acceleration of known harmonics up to 8 Hz."""
    t = np.arange(n) / RATE
    q, v, a = np.zeros(n), np.zeros(n), np.zeros(n)
    for amplitude, f, phase in ((0.1, 0.5, 0.3), (0.03, 2.1, 1.0), (0.004, 8.0, 2.0)):
        w = 2 * np.pi * f
        q += amplitude * np.sin(w * t + phase)
        v += amplitude * w * np.cos(w * t + phase)
        a -= amplitude * w**2 * np.sin(w * t + phase)
    return t, q, v, a


def log_of(q: np.ndarray, **more: np.ndarray) -> Log:
    t = np.arange(len(q)) / RATE
    channels = {"t": t, "X.q": q, "B.q": 2.0 * q, "X.u": 30.0 * q, "B.u": -4.0 * q}
    channels |= {name.replace("_", ".", 1): x for name, x in more.items()}
    return Log(channels, "here.csv")


def noise(seed: int) -> np.ndarray:
    """Return broad-band noise with enough memory to be a motion, not an encoder's trembling."""
    white = np.random.default_rng(seed).normal(size=N)
    return white + 5.0 * np.sin(np.arange(N) / 50.0)


def inside(motion: Motion) -> np.ndarray:
    return np.concatenate([np.arange(s.start, s.stop) for s in motion.segments])


def test_derivatives_of_a_known_motion(rig: Machine) -> None:
    t, q, v, a = multisine()
    motion = prepare(rig, log_of(q), cutoff=100.0)
    rows = inside(motion)
    np.testing.assert_array_equal(motion.t, t)
    assert motion.step == pytest.approx(1e-3)
    assert motion.cutoff == 100.0
    # The cut at the edges leaves one hundredth of the filter's start-up, the inside none of it.
    for part, edge in ((rows, 0.01), (rows[100:-100], 0.0)):
        for found, truth, error in ((motion.q, q, 1e-4), (motion.v, v, 5e-4), (motion.a, a, 1e-3)):
            atol = max(error, edge) * np.abs(truth).max()
            np.testing.assert_allclose(found[part, 0], truth[part], atol=atol)
            np.testing.assert_allclose(found[part, 1], 2 * truth[part], atol=2 * atol)


def test_every_channel_goes_through_the_same_filter(rig: Machine) -> None:
    # The same noise in every channel: with one filter they stay proportional to the last digit in the
    # whole band, so that no channel is delayed against another.
    x = noise(2)
    motion = prepare(rig, log_of(x, X_qr=3 * x, B_qr=5 * x, arm_fx=7 * x), cutoff=60.0)
    np.testing.assert_allclose(motion.q[:, 1], 2 * motion.q[:, 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(motion.u[:, 0], 30 * motion.q[:, 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(motion.qr[:, 0], 3 * motion.q[:, 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(motion.vr[:, 1], 5 * motion.v[:, 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(motion.ar[:, 1], 5 * motion.a[:, 0], rtol=1e-9, atol=1e-6)
    assert motion.external is not None  # a force along the slide's axis
    np.testing.assert_allclose(motion.external[:, 0], 7 * motion.q[:, 0], rtol=1e-9, atol=1e-9)


def test_the_filter_has_no_delay(rig: Machine) -> None:
    t = np.arange(N) / RATE
    pulse = np.exp(-(((t - 3.0) / 0.02) ** 2))
    motion = prepare(rig, log_of(pulse), cutoff=20.0)
    smooth = motion.q[:, 0]
    assert np.argmax(smooth) == 3000
    np.testing.assert_allclose(smooth[3001:3400], smooth[2999:2600:-1], atol=1e-9)


def test_efforts_may_stay_unfiltered(tmp_path: Path) -> None:
    machine = Machine.load(write_machine(tmp_path / "rig", yaml=YAML + "data: {filter_effort: false}\n"))
    x = noise(2)
    motion = prepare(machine, log_of(x), cutoff=60.0)
    np.testing.assert_array_equal(motion.u[:, 0], 30.0 * x)


def test_zero_cutoff_means_no_filter(rig: Machine) -> None:
    x = noise(3)
    motion = prepare(rig, log_of(x), cutoff=0.0)
    np.testing.assert_array_equal(motion.q[:, 0], x)
    assert motion.cutoff == np.inf
    assert motion.decimation == 1


@pytest.mark.parametrize("broken", ["gap", "backward", "nan", "inf", "nan effort", "nan stamp"])
def test_a_break_splits_the_log_and_nothing_leaks_over_it(rig: Machine, broken: str) -> None:
    _, q, v, a = multisine()
    q = q + 1.0
    log = {name: x.copy() for name, x in log_of(q).channels.items()}
    row = 2500
    if broken == "gap":
        log["t"][row:] += 5.0
    elif broken == "backward":
        log["t"][row:] -= 1.0
    elif broken == "nan stamp":
        log["t"][row : row + 3] = np.nan
    else:
        value = np.inf if broken == "inf" else np.nan
        log["X.u" if broken == "nan effort" else "X.q"][row : row + 3] = value
    kept = np.isfinite(log["t"])
    motion = prepare(rig, Log(log), cutoff=50.0)
    first, second = motion.segments
    assert first.stop <= row < second.start
    rows = inside(motion)
    q, v, a = q[kept], v[kept], a[kept]
    np.testing.assert_allclose(motion.q[rows, 0], q[rows], atol=1e-3 * np.ptp(q))
    np.testing.assert_allclose(motion.v[rows, 0], v[rows], atol=2e-3 * np.ptp(v))
    np.testing.assert_allclose(motion.a[rows, 0], a[rows], atol=1e-2 * np.ptp(a))


@pytest.mark.parametrize("hole", ["rows", "stamps", "values"])
def test_single_missing_samples_are_bridged_and_counted(rig: Machine, hole: str) -> None:
    t, q, v, a = multisine()
    lost = np.arange(50, N - 50, 97)
    log = {name: x.copy() for name, x in log_of(q + 1.0).channels.items()}
    if hole == "rows":
        log = {name: np.delete(x, lost) for name, x in log.items()}
    else:
        log["t" if hole == "stamps" else "X.q"][lost] = np.nan
    motion = prepare(rig, Log(log, "here.csv"), cutoff=50.0)
    assert len(motion.segments) == 1
    assert len(motion) == N
    assert f"{len(lost)} missing" in " ".join(motion.notes)
    rows = inside(motion)[200:-200]
    np.testing.assert_allclose(motion.t, t, atol=1e-9)
    np.testing.assert_allclose(motion.v[rows, 0], v[rows], atol=2e-3 * np.ptp(v))
    np.testing.assert_allclose(motion.a[rows, 0], a[rows], atol=5e-3 * np.ptp(a))


@pytest.mark.parametrize("clock", ["even", "held", "uneven"])
def test_the_motion_tells_scattered_stamps_from_uneven_sampling(rig: Machine, clock: str) -> None:
    """The position is sampled evenly, or evenly but read unevenly, or unevenly as the stamps say."""
    rng = np.random.default_rng(4)
    even = np.arange(N) / RATE
    stamps = (1.01 * even if clock == "held" else even) + 0.2e-3 * rng.uniform(-1.0, 1.0, N)
    sampled = {"even": even, "held": np.floor(stamps * RATE) / RATE, "uneven": stamps}[clock]
    phase = np.array([0.3, 1.0, 2.0])
    size, w = np.array([0.1, 0.03, 0.004]), 2 * np.pi * np.array([0.5, 2.1, 8.0])
    q = np.sin(np.outer(sampled, w) + phase) @ size
    log = {"t": stamps, "X.q": q, "B.q": 2.0 * q, "X.u": 30.0 * q, "B.u": -4.0 * q}
    motion = prepare(rig, Log(log, "here.csv"), cutoff=50.0)
    words = {"even": "around an even clock", "held": "repeat a sample", "uneven": "and so does the motion"}
    assert words[clock] in " ".join(motion.notes)
    assert len(motion.segments) == 1
    assert motion.step == pytest.approx(1e-3, rel=2e-3)
    rows = inside(motion)[200:-200]
    truth = -np.sin(np.outer(motion.t[rows], w) + phase) @ (size * w**2)
    # What is read was sampled up to one step before, and ticks near standstill may be off by one or two.
    late = 3e-3 * np.abs(np.gradient(truth, 1e-3)).max() if clock == "held" else 0.0
    assert np.abs(motion.a[rows, 0] - truth).max() < 0.01 * np.ptp(truth) + late


SIZE, W = np.array([0.1, 0.02]), 2 * np.pi * np.array([0.5, 1.3])
"""A motion whose two axes never stand at once [m or rad], [rad/s]."""


@pytest.mark.parametrize("held", [2, 4, 5])
def test_a_skip_after_rows_that_repeat_a_sample_is_as_long_as_the_motion_says(
    rig: Machine, held: int
) -> None:
    """A logger that reads one sample several times and then catches up: five ticks were taken for four."""
    rng = np.random.default_rng(5)
    tick, at = np.arange(N), rng.choice(np.arange(100, N - 100, 50), 60, replace=False)
    for k in at:
        tick[k : k + held] = tick[k]
    stamps = (np.arange(N) + 0.2 * rng.uniform(-1.0, 1.0, N)) / RATE
    x, b = (np.sin(np.outer(tick / RATE, W) + p) @ SIZE + 1e-6 * rng.normal(size=N) for p in (0.0, 1.5))
    log = {"t": stamps, "X.q": x, "B.q": b, "X.u": 30.0 * x, "B.u": -4.0 * b}
    motion = prepare(rig, Log(log, "here.csv"), cutoff=50.0)
    said = " ".join(motion.notes)
    assert f"{len(at) * (held - 1)} rows repeat a sample" in said
    assert f"at most {held - 1} in a row" in said
    assert len(motion) == N
    rows = inside(motion)[200:-200]
    truth = -np.sin(np.outer(rows / RATE, W)) @ (SIZE * W**2)
    assert np.abs(motion.a[rows, 0] - truth).max() < 0.03 * np.ptp(truth)


@pytest.mark.parametrize("piece", [15, 20, 22, 26, 32, 40, 60])
def test_a_scrap_between_two_holes_is_left_out_not_fatal(rig: Machine, piece: int) -> None:
    _, q, _, _ = multisine()
    q[998:1001] = q[1000 + piece + 1 : 1000 + piece + 4] = np.nan
    motion = prepare(rig, log_of(q), cutoff=100.0)
    assert len(motion.segments) == 2
    assert motion.decimation > 1
    rows = inside(motion)
    assert not ((rows >= 1000) & (rows <= 1000 + piece + 1)).any()


def test_holes_in_a_load_break_the_log_too(rig: Machine) -> None:
    _, q, _, _ = multisine()
    load = np.ones(N)
    load[3000:3003] = np.nan
    motion = prepare(rig, log_of(q, arm_fz=load), cutoff=50.0)
    assert len(motion.segments) == 2


def test_edges_are_cut_as_long_as_the_filter_remembers(rig: Machine) -> None:
    _, q, _, _ = multisine()
    wide = prepare(rig, log_of(q), cutoff=100.0).segments[0]
    narrow = prepare(rig, log_of(q), cutoff=10.0).segments[0]
    assert 2 < wide.start < narrow.start
    assert N - wide.stop == wide.start


def test_drop_says_how_much_to_cut(tmp_path: Path) -> None:
    _, q, _, _ = multisine()
    machine = Machine.load(write_machine(tmp_path / "rig", yaml=YAML + "data: {drop: [7, 11]}\n"))
    assert prepare(machine, log_of(q), cutoff=50.0).segments == (slice(7, N - 11),)


def test_decimation_keeps_more_than_four_rows_a_period_of_the_corner(rig: Machine) -> None:
    _, q, _, _ = multisine()
    for cutoff in (10.0, 37.0, 100.0, 400.0):
        motion = prepare(rig, log_of(q), cutoff=cutoff)
        assert RATE / motion.decimation >= 4 * cutoff or motion.decimation == 1
    assert prepare(rig, log_of(q), cutoff=50.0, decimate=3).decimation == 3


def test_the_step_is_the_mean_of_rounded_stamps(rig: Machine) -> None:
    # 1024 Hz logged in 0.1 ms: the median interval is 1 ms, the truth 0.9766 ms.
    _, q, v, _ = multisine(4096)
    stamps = np.round(np.arange(4096) / 1024.0, 4)
    assert np.median(np.diff(stamps)) == pytest.approx(1e-3)
    motion = prepare(rig, Log({**log_of(q).channels, "t": stamps}), cutoff=50.0)
    assert motion.step == pytest.approx(1 / 1024.0, rel=1e-3)
    rows = inside(motion)
    expected = v[rows] * 1.024
    np.testing.assert_allclose(motion.v[rows, 0], expected, atol=5e-3 * np.abs(v).max())


def test_transmission_mixes_and_scales(tmp_path: Path) -> None:
    # q_motor = N q, hence tau = N^T tau_motor: the power is the same on both sides.
    mixed = YAML + "transmission: {X: {X: 50}, B: {X: 7, B: -3}}\n"
    mixed = mixed.replace("joint: jb", "joint: jb, zero: 0.4")
    machine = Machine.load(write_machine(tmp_path / "rig", yaml=mixed))
    matrix = np.array([[50.0, 0.0], [7.0, -3.0]])
    rng = np.random.default_rng(4)
    t, wave, _, _ = multisine()
    joint = np.column_stack([wave, np.roll(wave, 700)])
    motors, torque = joint @ matrix.T, rng.normal(size=(N, 2))
    names = ("X", "B")
    log = {"t": t} | {f"{n}.q": motors[:, i] for i, n in enumerate(names)}
    log |= {f"{n}.u": torque[:, i] for i, n in enumerate(names)}
    motion = prepare(machine, Log(log), cutoff=0.0)
    np.testing.assert_allclose(motion.q, joint + np.array([0.0, 0.4]), atol=1e-12)
    power = np.einsum("ni,ni->n", np.gradient(motors, axis=0), torque)
    np.testing.assert_allclose(
        np.einsum("ni,ni->n", np.gradient(motion.q, axis=0), motion.u), power, atol=1e-9
    )


def test_a_motor_without_effort_spoils_only_the_joints_it_drives(tmp_path: Path) -> None:
    mixed = YAML + "transmission: {X: {X: 50}, B: {X: 7, B: -3}}\n"
    machine = Machine.load(write_machine(tmp_path / "rig", yaml=mixed))
    _, q, _, _ = multisine()
    log = log_of(q)
    motion = prepare(machine, log.with_channels({k: x for k, x in log.channels.items() if k != "X.u"}))
    assert np.isnan(motion.u[:, 0]).all()  # both motors act on joint X
    assert np.isfinite(motion.u[:, 1]).all()


def test_external_loads_against_pinocchio(rig: Machine) -> None:
    # J^T f, found independently: RNEA with and without the load on the arm's link.
    _, wave, _, _ = multisine(400)
    rng = np.random.default_rng(5)
    wrench = {f"arm_{k}": rng.normal(size=400) for k in ("fx", "fy", "fz", "mx", "my", "mz")}
    motion = prepare(rig, log_of(wave, **wrench), cutoff=0.0)
    assert motion.external is not None
    model, data = rig.model, rig.model.createData()
    joint = model.getJointId("jb")
    for k in range(0, 400, 37):
        q = motion.q[k]
        pin.forwardKinematics(model, data, q)
        f_world = np.array([wrench[f"arm_{c}"][k] for c in ("fx", "fy", "fz", "mx", "my", "mz")])
        rotation = data.oMi[joint].rotation  # the arm's link frame is the joint frame
        f_local = pin.Force(rotation.T @ f_world[:3], rotation.T @ f_world[3:])
        forces = [pin.Force.Zero() for _ in range(model.njoints)]
        forces[joint] = f_local
        zero = np.zeros(2)
        with_load = pin.rnea(model, data, q, zero, zero, forces)
        without = pin.rnea(model, data, q, zero, zero)
        np.testing.assert_allclose(motion.external[k], without - with_load, atol=1e-10)


def test_the_velocity_of_a_passive_joint_may_be_logged_alone() -> None:
    machine = Machine.load("flexure_rig")
    t, q, v, a = multisine()
    log = {"t": t, "delta.v": 1e-3 * v}
    for name in machine.axes:
        log |= {f"{name}.q": q, f"{name}.u": q}
    motion = prepare(machine, Log(log), cutoff=100.0)
    delta, rows = motion.index("delta"), inside(motion)
    np.testing.assert_allclose(motion.v[rows, delta], 1e-3 * v[rows], atol=1e-6)
    np.testing.assert_allclose(motion.a[rows, delta], 1e-3 * a[rows], atol=1e-4)
    assert motion.use[:, delta].all()


def test_thresholds(tmp_path: Path) -> None:
    _, q, v, _ = multisine()
    still = np.full(N, 0.2)
    yaml = YAML.replace("{joint: jx}", "{joint: jx, min_speed: 0.25}")
    machine = Machine.load(write_machine(tmp_path / "rig", yaml=yaml))
    log = log_of(q).with_channels({**log_of(q).channels, "B.q": 2 * q})
    motion = prepare(machine, log, cutoff=100.0)
    rows = inside(motion)
    clear = rows[np.abs(np.abs(v[rows]) - 0.25) > 1e-3]
    np.testing.assert_array_equal(motion.use[clear, 0], np.abs(v[clear]) >= 0.25)
    top = np.abs(motion.v[:, 1]).max()  # no min_speed: 1 % of its own top speed
    np.testing.assert_array_equal(motion.use[rows, 1], np.abs(motion.v[rows, 1]) >= 0.01 * top)
    rest = prepare(machine, log.with_channels({**log.channels, "B.q": still}), cutoff=100.0)
    assert not rest.use[:, 1].any()


def test_an_axis_that_only_trembles_stands_still(rig: Machine) -> None:
    _, q, _, _ = multisine()
    rest = 0.2 + 1e-5 * np.random.default_rng(6).normal(size=N)
    motion = prepare(rig, log_of(q).with_channels({**log_of(q).channels, "B.q": rest}))
    assert not motion.use[:, 1].any()
    assert (motion.v[:, 1] == 0.0).all()
    assert (motion.a[:, 1] == 0.0).all()
    np.testing.assert_allclose(motion.q[:, 1], 0.2, atol=1e-5)
    assert np.ptp(motion.q[:, 1]) == 0.0


def test_several_logs_are_one_motion_with_segments_apart(rig: Machine) -> None:
    _, q, _, _ = multisine()
    both = prepare(rig, [log_of(q), log_of(q[::-1].copy())], cutoff=50.0)
    assert len(both) == 2 * N
    assert len(both.segments) == 2
    assert both.segments[1].start >= N
    alone = prepare(rig, log_of(q[::-1].copy()), cutoff=50.0)
    np.testing.assert_array_equal(both.v[N:], alone.v)


def test_what_is_given_is_not_changed(rig: Machine) -> None:
    log = Log(good_log())
    before = log.fingerprint()
    prepare(rig, log)
    assert log.fingerprint() == before


def test_no_log_at_all(rig: Machine) -> None:
    with pytest.raises(DataError, match="rig: no log given; give at least one"):
        prepare(rig, [])


def test_the_message_names_channel_and_remedy(rig: Machine) -> None:
    log = log_of(np.zeros(N))
    with pytest.raises(LogError) as caught:
        prepare(rig, log.with_channels({k: x for k, x in log.channels.items() if k != "B.q"}))
    assert str(caught.value) == (
        "here.csv: no channel B.q (position of axis B); name its column under `columns` in "
        "machine.yaml, or drop the axis; did you mean 'X.q'? known: B.u, X.q, X.u, t"
    )


def test_a_log_without_rows(rig: Machine) -> None:
    log = log_of(np.zeros(N)).rows(slice(0, 0))
    for use in (prepare, check):
        with pytest.raises(LogError, match=r"here\.csv: holds no rows; record or cut it again"):
            use(rig, log)


def test_one_row_in_so_many_keeps_segments_apart_and_the_clock_true(rig: Machine) -> None:
    _, q, _, _ = multisine()
    one = prepare(rig, log_of(q), cutoff=30.0)
    both = Motion.join([one, one])
    few = both.every(3)
    assert few.step == pytest.approx(3.0 * both.step)
    assert len(few.segments) == len(both.segments)
    for old, new in zip(both.segments, few.segments, strict=True):
        np.testing.assert_array_equal(few.q[new], both.q[old][::3])
        np.testing.assert_allclose(np.diff(few.t[new]), few.step)
