"""The real drive EMPS (Janot, Gautier, Brunot 2019): published digits, and our recipe against theirs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.effects import Coulomb, CoulombAsymmetric, Offset, Viscous, ViscousAsymmetric
from pinotwin.identification.assemble import assemble
from pinotwin.machine import DataSettings, Machine
from pinotwin.solve.linear import Options, linear
from tests.stated_gap import check_stated_gap

AUTHORS = DataSettings(cutoff=100.0, order=4, decimate=10, filter_effort=False, drop=(49, 0))


@pytest.fixture(scope="module")
def log(data_dir):
    return pt.read(data_dir / "emps" / "DATA_EMPS.mat")


def authors_machine(effects) -> Machine:
    machine = Machine.load("emps")
    axis = dataclasses.replace(machine.axis("X"), effects=effects, min_speed=0.0)
    return dataclasses.replace(machine, axes={"X": axis}, data=AUTHORS)


def fit(machine: Machine, log):
    problem = assemble(pt.prepare(machine, log), machine.effects)
    return linear(problem, Options(inference="ols"))


def relative_error(found) -> float:
    return float(np.linalg.norm(found.residual) / np.linalg.norm(found.problem.y))


def test_the_authors_recipe_gives_the_published_digits(log):
    machine = authors_machine((Viscous("X"), Coulomb("X", width=0.0), Offset("X")))
    found = fit(machine, log)
    np.testing.assert_allclose(found.theta, [95.1089, 203.5034, 20.3935, -3.1648], atol=5e-5)
    # The report divides the residual power by N - 1 (MATLAB's std), we by N - p.
    n, p = found.problem.W.shape
    theirs = found.standard_errors * np.sqrt((n - p) / (n - 1))
    np.testing.assert_allclose(theirs, [0.1085, 1.1460, 0.1012, 0.0444], rtol=0.0, atol=5e-5)
    assert 100 * relative_error(found) == pytest.approx(4.0834, abs=5e-5)
    assert np.linalg.cond(found.problem.W.toarray()) == pytest.approx(25.9883, abs=5e-5)
    assert np.linalg.norm(found.residual) == pytest.approx(108.7569, abs=5e-5)


def test_a_diagnosis_states_the_gap_of_the_twin(log):
    twin = pt.identify(Machine.load("emps"), log, loop=False)
    check_stated_gap(twin, log)


def test_asymmetric_friction_gives_the_published_digits(log):
    machine = authors_machine((ViscousAsymmetric("X"), CoulombAsymmetric("X", width=0.0)))
    found = fit(machine, log)
    expected = {"M": 95.1540, "Fv+": 166.7061, "Fv-": 240.4236, "Fc+": 20.1440, "Fc-": 20.6277}
    np.testing.assert_allclose(found.theta, list(expected.values()), atol=5e-5)
    assert 100 * relative_error(found) == pytest.approx(3.1117, abs=5e-5)


def halves(machine: Machine, log):
    motion = pt.prepare(machine, log)
    cut = len(motion) // 2
    return motion.cut(0, cut), motion.cut(cut, len(motion))


def test_our_default_recipe_predicts_unseen_data_no_worse_than_the_authors_model(log):
    """Both models are fitted to one half and judged on the same raw rows of the other half."""
    ours = Machine.load("emps")
    theirs = authors_machine((Viscous("X"), Coulomb("X", width=0.0), Offset("X")))
    judge = dataclasses.replace(theirs, data=dataclasses.replace(AUTHORS, decimate=1))
    errors = {}
    for name, machine in {"ours": ours, "theirs": theirs}.items():
        trained, tested = halves(machine, log)
        theta = linear(assemble(trained, machine.effects)).theta
        _, rows = halves(judge, log)
        for other in tested.names:
            assert other == "X"
        problem = assemble(rows, machine.effects)
        errors[name] = float(np.linalg.norm(problem.y - problem.W @ theta))
    assert errors["ours"] <= errors["theirs"]
