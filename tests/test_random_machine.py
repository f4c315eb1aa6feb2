"""Machines of random kinematics: sane, diverse, healthy by their own listing, the same for a seed."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

import pinotwin as pt
from pinotwin.virtual import VirtualMachine, random_trajectory
from pinotwin.virtual.random_machine import write_random_machine

SEEDS = range(1, 13)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    root = tmp_path_factory.mktemp("random")
    return {seed: write_random_machine(root / str(seed), seed) for seed in SEEDS}


def test_the_same_seed_writes_the_same_files(folders, tmp_path):
    again = write_random_machine(tmp_path / "again", 3)
    for name in ("random_3.urdf", "machine.yaml", "virtual.yaml"):
        assert (again / name).read_bytes() == (folders[3] / name).read_bytes()


def test_trees_differ_and_have_both_kinds_of_axes(folders):
    machines = [pt.Machine.load(f) for f in folders.values()]
    assert {m.nv for m in machines} == {2, 3, 4, 5}
    assert all(any(m.rotary) and not all(m.rotary) for m in machines)
    chains = [list(m.model.parents)[1:] == list(range(m.nv)) for m in machines]
    assert any(chains)
    assert not all(chains)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_random_machine_is_sane_and_runs(folders, seed):
    machine = pt.Machine.load(folders[seed])
    virtual = VirtualMachine.load(folders[seed])
    M = virtual.inertia()
    assert np.linalg.eigvalsh(M).min() > 0.0
    assert np.linalg.cond(M / np.sqrt(np.outer(np.diag(M), np.diag(M)))) < 1e3
    log = virtual.record(random_trajectory(virtual, 3.0, seed), seed=seed).log
    for name, scale in virtual.scales.items():
        limit = virtual.truth.axes[name].controller.effort_limit
        assert np.abs(log[f"{name}.u"]).max() < 0.9 * limit
        assert np.abs(log[f"{name}.qr"] - log[f"{name}.q"]).max() < 0.01 * scale.travel
    assert set(machine.axes) == set(virtual.axes)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_listing_covers_the_truth(folders, seed):
    listed = yaml.safe_load((folders[seed] / "machine.yaml").read_text())["axes"]
    truth = VirtualMachine.load(folders[seed]).truth
    assert not truth.payload
    assert not truth.external
    for name, axis in truth.axes.items():
        effects = listed[name]["effects"]
        slow = axis.friction.static > 1.0
        assert ("presliding" if slow else {"presliding": {"stribeck": 0}}) in effects
        assert ("ripple" in effects) == bool(axis.ripple)
        assert axis.friction.asymmetry == axis.friction.quadratic == axis.friction.load == 0.0
        assert axis.drive.frequency == axis.drive.backlash == axis.encoder.error == 0.0
        assert axis.bend is None
        assert axis.effort.scale == 1.0
        assert axis.effort.lag == 0.0
