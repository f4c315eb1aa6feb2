"""A low-pass on the effort must be a low-pass on the columns too, where they change faster than the motion.

A log of known friction: dry friction that turns round within 1 mm/s, an effort with 1 % of noise. The corner
that the positions suggest is 5 to 8 Hz; without the same filter on both sides viscous friction came out as
189 to 205 for 180, dry friction as 17 to 22 for 25, with errors of 1 %, and 2.4 % of the effort stayed.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pinotwin.effects import EFFECTS
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.scaffold.start import new
from pinotwin.signals import low_pass
from pinotwin.twin import Twin
from tests.motions import multisine
from tests.servo_log import FRICTION, servo_log
from tests.test_effects_battery import told, tree

SEEDS = range(8)


def logged(seed: int) -> Log:
    channels = servo_log(10.0, seed=seed)
    return Log({k: x for k, x in channels.items() if not k.endswith(".v")}, source=f"seed {seed}")


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return new("0-YA", logged(0), out=Path(tmp_path_factory.mktemp("passband")) / "mill").machine


@pytest.fixture(scope="module")
def twins(machine: Machine) -> list[Twin]:
    return [identify(machine, logged(seed), loop=False) for seed in SEEDS]


def test_friction_of_a_short_log_is_not_smeared(twins: list[Twin]) -> None:
    for axis, (viscous, dry) in FRICTION.items():
        found = np.array(
            [[t.parameter(f"{axis}.{x}").value for x in ("viscous.b", "coulomb.c")] for t in twins]
        )
        np.testing.assert_allclose(found.mean(axis=0), [viscous, dry], rtol=0.02)
        np.testing.assert_allclose(found, np.tile([viscous, dry], (len(twins), 1)), rtol=0.06)
    assert max(t.quality["relative_error"] for t in twins) < 0.005


def test_intervals_cover_the_truth(twins: list[Twin]) -> None:
    """Of 32 intervals of 95 % five may miss: the chance of six is 0.4 %."""
    inside = []
    for twin in twins:
        for axis, (viscous, dry) in FRICTION.items():
            for name, truth in (("viscous.b", viscous), ("coulomb.c", dry)):
                low, high = twin.parameter(f"{axis}.{name}").interval()
                inside.append(low <= truth <= high)
    assert len(inside) == 32
    assert sum(inside) >= 27


@pytest.mark.parametrize("name", [n for n, e in EFFECTS.items() if e.sharp])
def test_a_sharp_effect_goes_through_the_filter_of_the_effort(name: str) -> None:
    wide = told(multisine(n=4000))
    narrow = dataclasses.replace(wide, passband=8.0)
    effect = EFFECTS[name].on(tree(), "A")
    if name == "encoder_error":
        effect = dataclasses.replace(effect, period=0.1)
    sharp, smooth = (effect.columns(m).values[:, 0, :] for m in (wide, narrow))
    if "mass" not in effect.needs or name == "load_friction":  # a body's inertia changes along the path
        np.testing.assert_allclose(smooth, narrow.passed(sharp), atol=1e-12 * np.abs(sharp).max())
    assert np.abs(np.diff(smooth, 2, axis=0)).max() < 0.5 * np.abs(np.diff(sharp, 2, axis=0)).max()


def test_a_motion_without_a_filter_leaves_columns_alone() -> None:
    motion = multisine(n=500)
    x = np.sign(motion.v)
    np.testing.assert_array_equal(motion.passed(x), x)


@pytest.mark.parametrize(
    ("name", "settings", "theta"),
    [
        ("backlash", {"gap": 6e-4}, [0.6]),
        ("encoder_error", {"period": 2 * np.pi / 36}, [2e-3, 1e-3]),
    ],
)
def test_play_and_encoder_errors_are_found_in_a_filtered_effort(
    name: str, settings: dict, theta: list
) -> None:
    """Unfiltered columns left 99.8 and 90 % of such an effort: no search could have named them."""
    wide = told(multisine(n=8000))
    effect = dataclasses.replace(EFFECTS[name].on(tree(), "A"), **settings)
    logged = low_pass(effect.columns(wide).effort(np.array(theta), 2)[:, 1], 1000.0, 10.0)
    found = effect.columns(dataclasses.replace(wide, passband=10.0))
    column = found.values[:, found.joints.index(1), :]
    inner = slice(200, -200)
    x = np.linalg.lstsq(column[inner], logged[inner], rcond=None)[0]
    np.testing.assert_allclose(x, theta, rtol=0.01)
    assert np.std(logged[inner] - column[inner] @ x) < 0.02 * np.std(logged[inner])
