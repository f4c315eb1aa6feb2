"""True intervals: on a virtual five-axis log with coloured noise, 95 % of them hold the truth.

Motion and rigid-body efforts come from the virtual laser driller (its true inertias, not the CAD's);
friction follows the identified law here, because the question is whether the *statistics* are true. How
far a friction law that the model does not know biases the inertias is another question: see
docs/limits.md.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.effects import Coulomb, Viscous
from pinotwin.identification.assemble import assemble, choose_rows
from pinotwin.solve.linear import linear
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.stacked import interval
from tests.virtual_motion import inverse_dynamics

DRAWS = 40
FRICTION = {
    "X": (60.0, 26.0),
    "Y": (38.0, 15.0),
    "Z": (420.0, 75.0),
    "B": (0.9, 2.4),
    "C": (0.16, 0.8),
}


@pytest.fixture(scope="module")
def run():
    """Noise-free log of a 12 s cycle at 500 Hz, and the true rigid-body efforts along it."""
    virtual = VirtualMachine.load(pt.machines()["laser_driller"])
    recording = virtual.record(random_trajectory(virtual, 12.0, 5), seed=5, noise=False)
    truth = recording.truth
    machine = pt.Machine.load("laser_driller")
    for name in machine.axes:
        machine = machine.with_effects(
            name,
            (Viscous(name, machine.axis(name).rotary), Coulomb(name, machine.axis(name).rotary)),
        )
    columns = [truth.joints.index(name) for name in machine.names]
    efforts = inverse_dynamics(truth)[:, columns]
    motion = pt.prepare(machine, recording.to_log(), cutoff=60.0)
    motion = dataclasses.replace(motion, q=truth.q[:, columns], v=truth.v[:, columns], a=truth.a[:, columns])
    return machine, motion, efforts


def coloured(rng, n: int, size: float) -> np.ndarray:
    """AR(1) noise with a correlation of 0.9 from sample to sample, as a drive's current shows."""
    from scipy.signal import lfilter

    return lfilter([size * np.sqrt(1 - 0.9**2)], [1.0, -0.9], rng.standard_normal(n))


def test_intervals_of_the_base_parameters_cover_the_truth(run):
    machine, motion, efforts = run
    clean = efforts.copy()
    for name, (b, c) in FRICTION.items():
        i = motion.index(name)
        viscous, coulomb = machine.axis(name).effects
        clean[:, i] += viscous.columns(motion).values[:, 0, 0] * b
        clean[:, i] += coulomb.columns(motion).values[:, 0, 0] * c
    exact = linear(assemble(dataclasses.replace(motion, u=clean), machine.effects))
    count = len(machine.base)
    # X and Y bend at 29 Hz behind their encoders: what is not rigid in the truth is noise here too.
    truth = exact.theta[:count]
    rows = choose_rows(motion)
    size = 0.02 * np.sqrt(np.mean(clean**2, axis=0))
    rng = np.random.default_rng(11)
    hits = []
    for _ in range(DRAWS):
        noise = np.stack([coloured(rng, len(motion), s) for s in size], axis=1)
        fit = linear(assemble(dataclasses.replace(motion, u=clean + noise), machine.effects, rows))
        low, high = interval(fit)[:count].T
        hits.append((low <= truth) & (truth <= high))
    coverage = float(np.mean(hits))
    assert 0.90 <= coverage <= 0.98
    assert np.mean(hits, axis=0).min() > 0.75  # no single parameter is badly off
