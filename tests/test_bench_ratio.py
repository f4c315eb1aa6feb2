"""rho against closed forms: a ripple's power, the sensors' noise, and what a fit takes up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pinotwin.bench.cases import Case
from pinotwin.bench.plants import public_machine, virtual
from pinotwin.bench.produce import path_of, produce
from pinotwin.bench.ratio import left_of, noise_powers, powers, run
from pinotwin.virtual.axis_truth import Harmonic

SECONDS = 4.0


@pytest.fixture(scope="module")
def emps():
    well = virtual("emps")
    path = path_of("emps", SECONDS, 3)
    return well, path, run(well, path)


def with_axis(machine, **changes):
    axis = replace(machine.truth.axes["X"], **changes)
    return replace(machine, truth=replace(machine.truth, axes={"X": axis}))


def test_the_gap_of_a_ripple_is_its_own_power(emps):
    well, path, _ = emps
    slick = with_axis(well, friction=replace(well.truth.axes["X"].friction, coulomb=0.0))
    clean = run(slick, path)
    ripple = Harmonic(3.0, 0.1, 0.4)  # [N], [m], [rad]
    gap = powers(run(with_axis(slick, ripple=(ripple,)), path).signals - clean.signals)[0, 0]
    wave = 3.0 * np.sin(2 * np.pi * clean.log["X.q"] / 0.1 + 0.4)
    assert gap == pytest.approx(np.mean(wave**2), rel=0.05)  # without stiction the motor bears it


def test_the_noise_without_scatter_is_that_of_the_sensors(emps):
    well, path, clean = emps
    sensor = well.truth.axes["X"].effort
    expected = sensor.white**2 + sensor.coloured**2 + sensor.resolution**2 / 12.0
    quiet = replace(well, truth=replace(well.truth, scatter=0.0))
    # Friction that holds an axis at rest holds it with another effort in every run: not the sensors' doing.
    # Nor is the effort with which the loop answers the encoder's noise.
    axis = well.truth.axes["X"]
    slick = with_axis(
        quiet,
        friction=replace(axis.friction, coulomb=0.0),
        encoder=replace(axis.encoder, noise=0.0, resolution=1e-13),
    )
    assert noise_powers(slick, path, run(slick, path))[0, 0] == pytest.approx(expected, rel=0.1)
    assert noise_powers(quiet, path, clean)[0, 0] > expected


def test_scatter_of_friction_counts_as_noise_of_its_own_size(emps):
    well, path, clean = emps
    loud = replace(well, truth=replace(well.truth, scatter=0.05))
    still = replace(well, truth=replace(well.truth, scatter=0.0))
    extra = (noise_powers(loud, path, clean) - noise_powers(still, path, clean))[0, 0]
    f = well.truth.axes["X"].friction
    v = np.gradient(clean.log["X.q"], clean.log["t"])
    moving = np.abs(v) > 2e-3
    expected = 0.05**2 * np.mean(moving * f.coulomb**2 + (f.viscous * v) ** 2)
    assert extra == pytest.approx(expected, rel=0.1)


def test_a_fit_takes_up_what_its_own_columns_can(emps):
    well, path, clean = emps
    f = well.truth.axes["X"].friction
    ill = run(with_axis(well, friction=replace(f, viscous=1.2 * f.viscous)), path)
    gap = ill.signals - clean.signals
    noise = noise_powers(well, path, clean)
    whole = powers(gap)[0] / noise[0]
    bare = public_machine("emps", (("viscous", "X", 0.1),))
    listed = left_of(gap[0], ill, public_machine("emps"), well, noise[0])
    unlisted = left_of(gap[0], ill, bare, well, noise[0])
    assert listed < 0.02 * whole
    assert unlisted > 0.1 * whole


def test_rho_grows_with_the_square_of_the_size():
    sizes = []
    for size in (0.01, 0.02):
        case = Case(0, "emps", "change", "single", (("viscous", "X", size),), 7)
        sizes.append(produce(case, seconds=SECONDS).sizes[0])
    assert sizes[1] / sizes[0] == pytest.approx(4.0, rel=0.15)


def test_each_of_two_effects_has_its_own_rho():
    both = (("viscous", "X", 0.02), ("effort_scale", "X", 0.05))
    made = produce(Case(0, "emps", "change", "double", both, 7), seconds=SECONDS)
    for k, one in enumerate(both):
        alone = produce(Case(0, "emps", "change", "single", (one,), 7), seconds=SECONDS)
        assert made.sizes[k] == pytest.approx(alone.sizes[0], rel=1e-6)


def test_effects_of_the_controller_are_seen_in_the_tracking_error():
    case = Case(0, "trunnion", "change", "single", (("feedforward", "Y", 0.4),), 7)
    well, ill, path = (
        virtual("trunnion"),
        virtual("trunnion", on=case.effects, seed=7),
        path_of("trunnion", 8.0, 7),
    )
    clean = run(well, path)
    efforts, errors = powers(run(ill, path).signals - clean.signals) / noise_powers(well, path, clean)
    (size,) = produce(case, seconds=8.0).sizes
    assert size == pytest.approx(errors.max())
    assert size > 10.0 * efforts[list(well.axes).index("Y")]


@pytest.mark.parametrize("machine", ["trunnion", "random:4"])
def test_every_axis_moves_in_every_command(machine):
    well = virtual(machine)
    for seed in range(3):
        q, _, _ = path_of(machine, 8.0, seed).at(np.arange(0.0, 8.0, 0.01), well.axes)
        for k, name in enumerate(well.axes):
            low, high = well.limits[name].travel
            assert np.abs(np.diff(q[:, k])).sum() > 0.4 * (high - low)
