"""The thesis' studies on a machine of known truth."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinotwin as pt
from pinotwin.effects import Coulomb, PositionTable, Ripple, Viscous
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.report.study_plots import coupling_figure, removal_figure
from pinotwin.studies.amount import error_against_data
from pinotwin.studies.coupling import coupled_against_decoupled
from pinotwin.studies.evidence import evidence, split_rigid_body
from pinotwin.studies.overlay import FRICTION, TABLE, explained, overlay, with_and_without
from pinotwin.studies.overlay import RIPPLE as RIPPLES
from pinotwin.twin import Twin
from pinotwin.virtual import VirtualMachine, random_trajectory

PITCH, RIPPLE = 2 * np.pi / 9, 0.8  # [rad], [N·m]
COULOMB = {"Y": 24.0, "A": 1.6}
VISCOUS = {"Y": 60.0, "A": 0.9}


def trunnion() -> Machine:
    """Bundled machine with a table on Y, a ripple on A, and an axis C that stands switched off."""
    machine = Machine.load("trunnion")
    effects = {
        "Y": (Viscous("Y"), Coulomb("Y", width=0.0), PositionTable("Y", spacing=0.02)),
        "A": (
            Viscous("A", rotary=True),
            Coulomb("A", rotary=True, width=0.0),
            Ripple("A", rotary=True, period=PITCH),
        ),
    }
    for axis, listed in effects.items():
        machine = machine.with_effects(axis, listed)
    return replace(machine, data=replace(machine.data, cutoff=60.0))


def bump(q: np.ndarray) -> np.ndarray:
    """The guideway's force on Y [N], piecewise linear between multiples of 20 mm."""
    knots = 0.02 * np.arange(-12, 13)
    return np.interp(q, knots, 9.0 * np.sin(knots / 0.045))


def recorded(machine: Machine, seed: int, seconds: float = 8.0, noise: float = 0.02) -> Log:
    """A log of the machine moving Y and A, written with pin.rnea and friction by hand."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1e-3)
    q, v, a = (np.zeros((len(t), 3)) for _ in range(3))
    for j, size in ((0, 0.12), (1, 0.9)):
        for k in range(5):
            w = 2 * np.pi * (0.25 + 0.5 * k + 0.2 * rng.random())
            r, phi = size * rng.uniform(0.3, 0.5) / (1 + k), rng.uniform(0, 2 * np.pi)
            q[:, j] += r * np.sin(w * t + phi)
            v[:, j] += r * w * np.cos(w * t + phi)
            a[:, j] -= r * w * w * np.sin(w * t + phi)
    data = machine.model.createData()
    u = np.array([pin.rnea(machine.model, data, *x).copy() for x in zip(q, v, a, strict=True)])
    for j, name in enumerate(("Y", "A")):
        u[:, j] += VISCOUS[name] * v[:, j] + COULOMB[name] * np.sign(v[:, j])
    u[:, 0] += bump(q[:, 0])
    u[:, 1] += RIPPLE * np.cos(2 * np.pi * q[:, 1] / PITCH)
    u += noise * np.std(u, axis=0) * rng.normal(size=u.shape)
    channels = {"t": t}
    for j, name in enumerate(("Y", "A", "C")):
        channels[f"{name}.q"] = q[:, j]
    for j, name in enumerate(("Y", "A")):  # C is switched off: no effort is logged
        channels[f"{name}.u"] = u[:, j]
    return Log(channels, source=f"synthetic-{seed}")


@cache
def identified() -> tuple[Twin, Log]:
    machine = trunnion()
    log = recorded(machine, 1)
    return pt.identify(machine, log, loop=False), log


def test_evidence_of_a_twin_adds_up() -> None:
    twin, log = identified()
    given = evidence(twin, log)
    assert given.names == ("Y", "A", "C")
    np.testing.assert_allclose(given.predicted + given.residual, given.u)
    # Noise of 2 % is all that is left; a tenth more for the low-pass' edges at reversals.
    for axis in ("Y", "A"):
        j = given.index(axis)
        use = given.use[:, j]
        assert np.std(given.residual[use, j]) < 0.03 * np.std(given.u[:, j])
    with pytest.raises(DataError, match="no measured effort of axis 'Z'"):
        given.index("Z")


def test_split_of_the_rigid_body_is_that_of_pinocchio() -> None:
    twin, log = identified()
    given = evidence(twin, log)
    split = split_rigid_body(twin, given)
    three = split.parts["inertia"] + split.parts["gravity"] + split.parts["coupling"]
    np.testing.assert_allclose(three, given.parts["rigid_body"], atol=1e-9)
    data = twin.model.createData()
    k = len(given.t) // 3
    gravity = pin.computeGeneralizedGravity(twin.model, data, given.q[k])
    np.testing.assert_allclose(split.parts["gravity"][k], gravity, atol=1e-6)
    M = pin.crba(twin.model, data, given.q[k])
    M = np.triu(M) + np.triu(M, 1).T
    coriolis = pin.nonLinearEffects(twin.model, data, given.q[k], given.v[k]) - gravity
    coupling = (M - np.diag(np.diag(M))) @ given.a[k] + coriolis
    np.testing.assert_allclose(split.parts["coupling"][k], coupling, atol=1e-6)


def test_friction_overlay_shows_the_true_curve() -> None:
    twin, log = identified()
    found = overlay(twin, log, "Y", FRICTION, "velocity")
    assert found.effects == ("Y.viscous", "Y.coulomb")
    grid = found["grid"]
    assert np.all(np.diff(grid) >= 0)
    fast = np.abs(grid) > 0.02
    truth = VISCOUS["Y"] * grid + COULOMB["Y"] * np.sign(grid)
    np.testing.assert_allclose(found["curve"][fast], truth[fast], atol=0.05 * COULOMB["Y"])
    x, median, low, high = np.array(found.rows).T
    fast = np.abs(x) > 0.05
    data = VISCOUS["Y"] * x + COULOMB["Y"] * np.sign(x)
    np.testing.assert_allclose(median[fast], data[fast], atol=0.1 * COULOMB["Y"])
    assert np.all((low <= median) & (median <= high))
    assert explained(found["extracted"], found["fitted"]) > 0.95


def test_ripple_and_table_overlays_show_the_true_curves() -> None:
    twin, log = identified()
    ripple = overlay(twin, log, "A", RIPPLES, "position")
    truth = RIPPLE * np.cos(2 * np.pi * ripple["grid"] / PITCH)
    np.testing.assert_allclose(ripple["curve"], truth, atol=0.1 * RIPPLE)
    table = overlay(twin, log, "Y", TABLE, "position")
    middle = np.abs(table["grid"]) < 0.1
    # A table and the constant part of another effect share their mean: compare without it.
    curve, truth = table["curve"][middle], bump(table["grid"][middle])
    np.testing.assert_allclose(curve - curve.mean(), truth - truth.mean(), atol=1.0)


def test_overlay_of_an_effect_that_the_axis_has_not() -> None:
    twin, log = identified()
    with pytest.raises(DataError, match=r"axis Y has none of ripple, ripple_modulated"):
        overlay(twin, log, "Y", RIPPLES, "position")


def test_error_against_data_falls_to_the_noise() -> None:
    machine = trunnion()
    found = error_against_data(machine, recorded(machine, 3, seconds=10.0))
    seconds, fitted, held_out = np.array(found.rows).T
    assert len(seconds) == 10
    assert np.all(np.diff(seconds) > 0)
    # With little data the fit flatters itself; with enough, both errors are the noise.
    assert held_out[0] > 1.5 * fitted[0]
    assert held_out[-1] < 1.2 * fitted[-1]
    assert fitted[-1] < 0.035


def test_coupling_matters_where_the_tree_couples() -> None:
    machine = trunnion()
    log = recorded(machine, 4, seconds=12.0)
    found = coupled_against_decoupled(machine, log)
    # Y's acceleration tilts the table through its first moment and the other way round.
    rows = {name: errors for name, *errors in found.rows}
    assert rows["A"][1] > 1.5 * rows["A"][0]
    assert rows["A"][2] < 0.04
    assert set(rows) == {"Y", "A"}
    assert len(coupling_figure(found).data) >= 4


def test_one_axis_has_nothing_to_couple_with() -> None:
    machine = Machine.load("emps")
    t = np.arange(0.0, 6.0, 1e-3)
    q = 0.1 * np.sin(2.0 * t) + 0.03 * np.sin(9.0 * t)
    v = 0.2 * np.cos(2.0 * t) + 0.27 * np.cos(9.0 * t)
    a = -0.4 * np.sin(2.0 * t) - 2.43 * np.sin(9.0 * t)
    u = 95.0 * a + 200.0 * v + 20.0 * np.sign(v) + np.random.default_rng(0).normal(size=len(t))
    log = Log({"t": t, "X.q": q, "X.u": u})
    machine = replace(machine, columns={}, data=replace(machine.data, decimate=1))
    found = coupled_against_decoupled(machine, log)
    ((_, coupled, decoupled, *_),) = found.rows
    assert decoupled == pytest.approx(coupled, rel=1e-6)


def test_leaving_the_ripple_out_is_seen_in_the_prediction() -> None:
    """Fig. 3-8: the error grows by the ripple's own RMS, and the two predictions differ by it."""
    virtual = VirtualMachine.load(pt.machines()["laser_driller"])
    log = virtual.record(random_trajectory(virtual, 8.0, 3), seed=3).to_log()
    twin = pt.identify(pt.Machine.load("laser_driller"), log, loop=False)
    study = with_and_without(twin, log, "C", ("ripple_modulated",))
    ((_, complete, without),) = study.rows
    assert without > 3.0 * complete
    ripple = study["complete"] - study["without"]
    assert np.sqrt(np.mean(ripple**2)) == pytest.approx(np.sqrt(without**2 - complete**2), rel=0.1)
    assert len(removal_figure(study).data) == 3
    with pytest.raises(DataError, match="has none of"):
        with_and_without(twin, log, "Z")
