"""Random mountings and clocks on the virtual rig: found within limits and intervals, or refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks import imu_mountings as bench
from pinotwin.errors import DataError
from pinotwin.reconstruction import reconstruct_vibration
from pinotwin.solve.sandwich import at_least, left_out
from pinotwin.trajectories.moves import random_trajectory
from pinotwin.virtual.recording import Recording


@pytest.mark.parametrize("case", [4, 17, 32])
def test_a_random_mounting_is_found_within_its_intervals(case: int) -> None:
    found = bench.study(case, 12.0)
    for name, error in found.error.items():
        size = np.linalg.norm(error) if name in ("mounting", "upward") else np.abs(error).max()
        assert size < bench.LIMITS[name] * (1.5 if name == "scale" else 1.0), name
        if name != "upward":
            assert np.all(np.abs(error) < 3.5 * found.sd[name]), name
    assert np.all(found.sd["clock"] < 0.03)
    assert np.all(found.sd["skew"] < 6.0)


@pytest.mark.parametrize("kind", list(bench.SILENT))
def test_a_log_that_cannot_tell_is_refused(kind: str) -> None:
    said = bench.refusal(3, kind)
    assert said is not None
    assert "move a" in said


@cache
def gentle() -> Recording:
    """A and C turn far, but so softly that the joint moves by 0.0002 deg only."""
    _, vm = bench.rig()
    soft = {
        n: replace(x, speed=0.3 * x.speed, acceleration=6e-3 * x.acceleration, jerk=6e-3 * x.jerk)
        for n, x in vm.limits.items()
    }
    whole = random_trajectory(vm, 10.0, 5, soft)
    still = bench.moving(("A", "C"), 10.0, 5).profiles["Y"]
    moves = replace(whole, profiles={**whole.profiles, "Y": still})
    return vm.record(moves, seed=5, truth_rate=2000.0)


def test_a_joint_that_hardly_deflects_is_refused() -> None:
    machine, _ = bench.rig()
    imu = bench.read(bench.mounted(5), gentle(), 5)
    with pytest.raises(DataError, match=r"deflects too little.*move the axes that shake it"):
        reconstruct_vibration(machine, gentle().to_log(), imu)


def test_leaving_out_blocks_states_the_scatter_of_a_fit_with_correlated_noise() -> None:
    rng = np.random.default_rng(0)
    X = np.stack([np.ones(400), np.linspace(-1.0, 1.0, 400), rng.normal(size=400)], axis=1)
    inverse = np.linalg.inv(X.T @ X)
    truth, stated = [], []
    for _ in range(300):
        white = rng.normal(size=430)
        noise = np.convolve(white, np.ones(30) / np.sqrt(30), "valid")[:400]
        b = inverse @ X.T @ noise
        S = left_out(X[:, None, :], (noise - X @ b)[:, None], inverse, 40)
        truth.append(b)
        stated.append(np.diag(inverse @ S @ inverse))
    ratio = np.sqrt(np.mean(stated, axis=0)) / np.std(truth, axis=0)
    assert np.all(ratio > 0.85)
    assert np.all(ratio < 1.6)


def test_what_one_block_alone_knows_does_not_blow_up() -> None:
    X = np.zeros((200, 2))
    X[:, 0], X[:10, 1] = 1.0, 1.0  # the second is seen in the first block only
    e = np.random.default_rng(1).normal(size=(200, 1))
    inverse = np.linalg.inv(X.T @ X)
    e = e - X @ (inverse @ X.T @ e)
    cov = at_least(inverse @ left_out(X[:, None, :], e, inverse, 20) @ inverse, inverse)
    assert np.all(np.diag(cov) >= np.diag(inverse) * (1 - 1e-12))
    assert cov[1, 1] < 4.0 * inverse[1, 1]
    assert np.all(np.linalg.eigvalsh(cov) > -1e-12)
