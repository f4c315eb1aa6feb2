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
from pinotwin.twin import Twin
from tests.motions import multisine
from tests.servo_log import FRICTION, servo_log

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
    wide = multisine(n=4000)
    narrow = dataclasses.replace(wide, passband=8.0)
    effect = EFFECTS[name](axis="A", rotary=True)
    sharp, smooth = (effect.columns(m).values[:, 0, :] for m in (wide, narrow))
    np.testing.assert_allclose(smooth, narrow.passed(sharp), atol=1e-12)
    assert np.abs(np.diff(smooth, 2, axis=0)).max() < 0.5 * np.abs(np.diff(sharp, 2, axis=0)).max()


def test_a_motion_without_a_filter_leaves_columns_alone() -> None:
    motion = multisine(n=500)
    x = np.sign(motion.v)
    np.testing.assert_array_equal(motion.passed(x), x)
