"""Every effect can be withheld and injected, one at a time, and does what its name says."""

import numpy as np
import pytest

from pinotwin.errors import InputError
from pinotwin.machine.bundled import machines
from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual.amounts import INJECT, INJECT_MACHINE, OUTSIDE
from pinotwin.virtual.tree import inertia_at
from pinotwin.virtual.withholding import WITHHOLD, WITHHOLD_MACHINE
from tests.test_effects_contract import NAMES

SECONDS = 4.0
EVERY = [*INJECT, *INJECT_MACHINE, *OUTSIDE]


@pytest.fixture(scope="module")
def plain(urdf_dir):
    return urdf_dir / "trunnion"


@pytest.fixture(scope="module")
def trajectory(plain):
    return random_trajectory(VirtualMachine.load(plain), SECONDS, 11, dwell=(0.02, 0.1))


@pytest.fixture(scope="module")
def healthy(plain, trajectory):
    return VirtualMachine.load(plain).record(trajectory, seed=0, noise=False)


def test_the_whole_catalogue_can_be_injected_and_withheld():
    catalogue = set(NAMES) - {"rigid_body", "loop_gain"}  # a body is always there, gains are its controller's
    assert set(EVERY) >= catalogue
    assert {*WITHHOLD, *WITHHOLD_MACHINE} >= catalogue
    assert len(OUTSIDE) >= 5


@pytest.mark.parametrize("effect", EVERY)
def test_an_injected_effect_shows_and_the_loop_survives(plain, trajectory, healthy, effect):
    machine = VirtualMachine.load(plain, inject=[{"effect": effect, "axis": "Y", "size": 0.2}])
    noisy = effect == "chatter"  # made of noise: only a noisy run holds it
    r = machine.record(trajectory, seed=0, noise=noisy)
    if noisy:
        healthy = VirtualMachine.load(plain).record(trajectory, seed=0)
    gap = np.sqrt(np.mean((r.log["Y.u"] - healthy.log["Y.u"]) ** 2))
    error = np.abs(r.log["Y.qr"] - r.log["Y.q"]).max()
    weak = {
        "viscous_thermal": 0.003,
        "feedforward": 0.006,
    }  # four seconds warm little; feed-forward moves the error
    assert gap > weak.get(effect, 0.03) * np.sqrt(np.mean(healthy.log["Y.u"] ** 2))
    assert error < 5e-3


@pytest.mark.parametrize("effect", ["ripple", "position_table", "stribeck", "feedforward"])
def test_withholding_what_was_injected_gives_back_the_healthy_machine(plain, trajectory, effect):
    bare = VirtualMachine.load(plain, withhold=[f"{effect}:Y"])
    item = bare.truth.axes["Y"]
    again = VirtualMachine.load(plain, withhold=[f"{effect}:Y", f"{effect}:Y"])
    assert again.truth == bare.truth
    assert item != VirtualMachine.load(plain).truth.axes["Y"]
    assert bare.truth.axes["A"] == VirtualMachine.load(plain).truth.axes["A"]
    assert list(bare.true.inertias) == list(VirtualMachine.load(plain).true.inertias)


def test_withheld_friction_is_exactly_gone(plain, trajectory):
    machine = VirtualMachine.load(plain, withhold=["coulomb:Y"])
    r = machine.record(trajectory, seed=0, noise=False)
    v = r.truth.joint("Y")[1]
    viscous = machine.truth.axes["Y"].friction.viscous
    moving = np.abs(v) > 0.05
    np.testing.assert_allclose(r.truth.friction[moving, 0], viscous * v[moving], rtol=2e-3)


def test_friction_follows_the_catalogue_at_speed(plain, trajectory):
    """Coulomb with asymmetry plus viscous plus drag, at speeds where Stribeck has died away."""
    inject = [
        {"effect": "coulomb_asymmetric", "axis": "Y", "size": 0.04},
        {"effect": "quadratic_drag", "axis": "Y", "size": 0.1},
    ]
    machine = VirtualMachine.load(plain, inject=inject)
    r = machine.record(trajectory, seed=0, noise=False)
    f, v = machine.truth.axes["Y"].friction, r.truth.joint("Y")[1]
    rows = np.abs(v) > 0.05
    level = f.coulomb * (np.sign(v) + 0.5 * f.asymmetry)
    expected = level + f.viscous * v + f.quadratic * v * np.abs(v)
    np.testing.assert_allclose(r.truth.friction[rows, 0], expected[rows], rtol=3e-3)


def test_ripple_has_the_stated_amplitude_and_period(plain, trajectory, healthy):
    """Effort gained by an injected ripple, through the loop's own integral action, at low speed."""
    inject = [{"effect": "ripple", "axis": "Y", "value": 6.0, "seed": 4}]
    machine = VirtualMachine.load(plain, withhold=["ripple:Y"], inject=inject)
    bare = VirtualMachine.load(plain, withhold=["ripple:Y"]).record(trajectory, seed=0, noise=False)
    r = machine.record(trajectory, seed=0, noise=False)
    (wave,) = machine.truth.axes["Y"].ripple
    q = r.truth.joint("Y")[0]
    expected = 6.0 * np.sin(2 * np.pi * q / wave.period + wave.phase)
    gained = r.truth.u[:, 0] - bare.truth.u[:, 0]
    assert np.corrcoef(gained, expected)[0, 1] > 0.98
    assert np.polyfit(expected, gained, 1)[0] == pytest.approx(1.0, abs=0.1)


def test_effort_scale_and_delay_change_the_log_alone(plain, trajectory, healthy):
    scaled = VirtualMachine.load(plain, inject=["effort_scale:Y=0.1"])
    r = scaled.record(trajectory, seed=0, noise=False)
    np.testing.assert_allclose(r.log["Y.u"], 1.1 * healthy.log["Y.u"], rtol=1e-12)
    late = VirtualMachine.load(plain, inject=[{"effect": "delay", "axis": "Y", "value": 0.004}])
    r = late.record(trajectory, seed=0, noise=False)
    np.testing.assert_array_equal(r.log["Y.q"], healthy.log["Y.q"])
    np.testing.assert_allclose(r.log["Y.u"][2:], healthy.log["Y.u"][:-2], rtol=1e-9)


def test_payload_shows_in_the_weight_and_the_tree(plain):
    machine = VirtualMachine.load(plain, inject=[{"effect": "payload", "axis": "C", "value": 2.0}])
    healthy = VirtualMachine.load(plain)
    assert machine.true.inertias[-1].mass - healthy.true.inertias[-1].mass == pytest.approx(2.0)
    assert machine.inertia()[0, 0] - healthy.inertia()[0, 0] == pytest.approx(2.0)


def test_without_coupling_an_axis_at_rest_feels_nothing(plain):
    machine = VirtualMachine.load(plain, withhold=["inertial_coupling", "ripple", "position_table"])
    trajectory = random_trajectory(machine, 3.0, 1)
    still = {**trajectory.profiles, "Y": random_rest(machine)}
    r = machine.record(type(trajectory)(3.0, still), seed=0, noise=False)
    assert np.abs(r.truth.joint("Y")[1]).max() < 1e-9
    real = VirtualMachine.load(plain, withhold=["ripple", "position_table"])
    r = real.record(type(trajectory)(3.0, still), seed=0, noise=False)
    assert np.abs(r.truth.joint("Y")[1]).max() > 1e-6


def random_rest(machine):
    from pinotwin.trajectories.moves import rest

    return rest(float(np.mean(machine.limits["Y"].travel)))


def test_backlash_leaves_a_gap_between_motor_and_table(plain, trajectory):
    inject = [{"effect": "backlash", "axis": "Y", "value": 30e-6}]
    r = VirtualMachine.load(plain, inject=inject).record(trajectory, seed=0, noise=False)
    low, high = np.percentile(r.log["Y.q"] - r.truth.joint("Y")[0], [5.0, 95.0])
    assert high - low == pytest.approx(30e-6, rel=0.1)  # and what its faces give


def test_play_brings_no_spring_of_its_own(plain, trajectory):
    """A rigid drive that gets play of some nanometres makes the efforts it made before."""
    well, ill = (
        VirtualMachine.load(plain, inject=inject).record(trajectory, seed=0, noise=False).log["Y.u"]
        for inject in ([], [{"effect": "backlash", "axis": "Y", "value": 1e-9}])
    )
    assert np.std(ill - well) < 0.02 * np.std(well)


def test_two_effects_and_strings(plain, trajectory):
    machine = VirtualMachine.load(plain, inject=["stribeck:Y=0.1", "encoder_error:A=0.2"])
    assert machine.truth.axes["A"].encoder.error == pytest.approx(2e-4)
    assert machine.truth.axes["Y"].friction.static > 1.5


@pytest.mark.parametrize(
    ("inject", "message"),
    [
        (["stribek:Y"], "cannot inject 'stribek'; did you mean 'stribeck'"),
        (["stribeck:X"], "no axis 'X'"),
        (["stribeck:Y=big"], "must be a number"),
        ([{"effect": "ripple", "sise": 1}], "unknown key 'sise'"),
    ],
)
def test_bad_requests_are_named(plain, inject, message):
    with pytest.raises(InputError, match=message):
        VirtualMachine.load(plain, inject=inject)
    with pytest.raises(InputError, match="cannot withhold 'gravity'"):
        VirtualMachine.load(plain, withhold=["gravity"])


@pytest.mark.parametrize("effect", ["drive_flexibility", "backlash"])
def test_an_elastic_drive_adds_no_inertia_and_leaves_the_feed_forward_alone(plain, effect):
    """Its rotor is a part of the axis' inertia; otherwise it would be a payload as well."""
    well = VirtualMachine.load(plain)
    ill = VirtualMachine.load(plain, inject=[f"{effect}:Y=0.05"])
    j = ill.layout.drive["Y"]
    rotor = ill.truth.axes["Y"].drive.rotor
    before, after = (np.diag(inertia_at(m.true, m.layout.home))[j] for m in (well, ill))
    assert rotor > 0.05 * before
    assert after + rotor == pytest.approx(before, rel=1e-9)
    assert ill.cad_inertia["Y"] == pytest.approx(well.cad_inertia["Y"])


def test_a_worn_axis_does_not_run_its_integrator_into_its_limit():
    """At constant speed an integral part leaves no tracking error, however much friction there is."""
    rough = VirtualMachine.load(
        machines()["trunnion"], withhold=["ripple:Y", "position_table:Y"], inject=["viscous:Y=0.5"]
    )
    log = rough.record(random_trajectory(rough, 20.0, 1), seed=9, noise=False).to_log()
    command = np.gradient(log["Y.qr"], log.t)
    steady = np.abs(command) > 0.999 * np.abs(command).max()
    steady[1:] &= steady[:-1]
    held = np.flatnonzero(steady & (np.convolve(steady, np.ones(101), "same") > 100))
    assert len(held) > 20
    assert np.abs(log["Y.qr"] - log["Y.q"])[held].max() < 1e-6  # 5e-6 where the integral part stops
