"""Simulation against an integrator that shares no code with it, and what it must refuse."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pinotwin.columns import Column
from pinotwin.errors import DataError, InputError, LogError, TwinError
from pinotwin.log import Log
from pinotwin.logs.prepare import prepare
from pinotwin.simulation import preferred, respond, simulate
from pinotwin.simulation.command import beginning
from tests.simulated import Integrator, known_twin, plain_machine, smooth_command

LINK = {"trunnion": "C_link", "laser_driller": "C_link", "flexure_rig": "C_link"}


def rms(x: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(x**2, axis=0))


@pytest.fixture(scope="module")
def trunnion():
    return known_twin(plain_machine("trunnion"))


@pytest.fixture(scope="module")
def command(trunnion) -> Log:
    return smooth_command(trunnion.machine, 1.0, 1000.0)


def with_(log: Log, **channels: np.ndarray) -> Log:
    return Log({**log.channels, **{k.replace("__", "."): x for k, x in channels.items()}}, "changed")


class TestAgainstAnIndependentIntegrator:
    @pytest.mark.parametrize("name", ["trunnion", "laser_driller", "flexure_rig"])
    def test_error_and_effort_of_a_known_closed_loop_agree_within_half_a_percent(self, name):
        twin = known_twin(plain_machine(name))
        log = smooth_command(twin.machine, 0.4, 1000.0)
        found = respond(twin, log)
        e, u = Integrator(twin).run(log, 1e-4)
        axes = [axis.index for axis in twin.machine.axes.values()]
        assert np.all(rms(found.e - e)[axes] < 5e-3 * rms(e)[axes])
        assert np.all(rms(found.u - u)[axes] < 5e-3 * rms(u)[axes])
        passive = [part.index for part in twin.machine.passive.values()]
        assert np.all(rms(found.e - e)[passive] < 5e-3 * rms(e)[passive])

    def test_an_external_pulse_on_the_table_is_felt_by_every_axis_it_reaches(self, trunnion):
        log = smooth_command(trunnion.machine, 0.4, 1000.0)
        force = 150.0 * np.exp(-(((log.t - 0.25) / 0.008) ** 2))
        load = {"C_link__fy": force, "C_link__fz": -0.5 * force, "C_link__mx": 0.05 * force}
        hit = respond(trunnion, with_(log, **load))
        quiet = respond(trunnion, log)

        def wrench(t: float) -> np.ndarray:
            return np.array([0, 1, -0.5, 0.05, 0, 0]) * 150.0 * np.exp(-(((t - 0.25) / 0.008) ** 2))

        e, u = Integrator(trunnion).run(log, 1e-4, "C_link", wrench)
        felt = [i for i, name in enumerate(trunnion.machine.names) if name in "YA"]
        assert np.all(rms(hit.e - quiet.e)[felt] > 0.05 * rms(e)[felt])
        assert np.all(rms(hit.e - e)[felt] < 1e-2 * rms(hit.e - quiet.e)[felt])
        assert np.all(rms(hit.u - u)[felt] < 1e-2 * rms(hit.u - quiet.u)[felt])

    def test_a_passive_joint_swings_after_a_blow_as_it_should(self):
        twin = known_twin(plain_machine("flexure_rig"))
        t = np.arange(301) * 1e-3
        still = {f"{name}.qr": 0 * t for name in twin.machine.axes}
        log = Log({"t": t, **still, "delta_link.mx": 400.0 * np.exp(-(((t - 0.05) / 0.004) ** 2))})

        def blow(t: float) -> np.ndarray:
            return np.array([0, 0, 0, 1.0, 0, 0]) * 400.0 * np.exp(-(((t - 0.05) / 0.004) ** 2))

        found = simulate(twin, log)
        e, u = Integrator(twin).run(log, 1e-4, "delta_link", blow)
        i = twin.machine.names.index("delta")
        assert np.abs(e[:, i]).max() > 1e-4
        assert rms(found["delta.q"] + e[:, i]) < 1e-2 * rms(e[:, i])
        assert rms(np.gradient(found["delta.q"], 1e-3) - found["delta.v"]) < 2e-2 * rms(found["delta.v"])
        assert rms(found["Y.u"] - u[:, 0]) < 1e-2 * rms(u[:, 0])

    def test_a_shorter_step_changes_little(self, trunnion, command):
        coarse, fine = respond(trunnion, command), respond(trunnion, command, step=1e-5)
        assert fine.substeps > 2 * coarse.substeps
        assert np.all(rms(coarse.e - fine.e) < 1e-3 * rms(fine.e))
        assert np.all(rms(coarse.u - fine.u) < 1e-3 * rms(fine.u))


class TestPhysics:
    def test_effort_is_the_effort_of_the_motion(self, trunnion, command):
        from pinotwin.simulation.run import as_motion

        found = respond(trunnion, command, every_step=True)
        needed = trunnion.effort(as_motion(trunnion, found))
        assert np.all(rms(found.u - needed) < 1e-3 * rms(needed))

    def test_position_velocity_and_acceleration_belong_together(self, trunnion, command):
        found = respond(trunnion, command, every_step=True)
        step = found.request.step
        slope = (found.q[2:] - found.q[:-2]) / (2 * step)
        assert np.all(rms(slope - found.v[1:-1]) < 1e-3 * rms(found.v))
        slope = (found.v[2:] - found.v[:-2]) / (2 * step)
        # where friction turns within a step, a difference cannot follow the acceleration
        assert np.all(rms(slope - found.a[1:-1]) < 3e-2 * rms(found.a))

    def test_a_constant_command_settles_and_friction_does_not_chatter(self, trunnion):
        t = np.arange(3001) * 1e-3
        log = Log({"t": t, "Y.qr": 0 * t + 0.03, "A.qr": 0 * t + 0.4, "C.qr": 0 * t})
        found = simulate(trunnion, log)
        late = t > 2.0
        for name, rotary in (("Y", False), ("A", True), ("C", True)):
            e, u = found[f"{name}.e"][late], found[f"{name}.u"][late]
            assert np.ptp(e) < (1e-7 if rotary else 1e-8)
            assert np.ptp(u) < 1e-2 * max(np.abs(u).max(), 0.1)

    def test_an_axis_that_stops_stands_still(self, trunnion):
        t = np.arange(2001) * 1e-3
        s = np.clip(t / 0.5, 0, 1)
        move = 0.1 * s**3 * (10 - 15 * s + 6 * s * s)
        log = Log({"t": t, "Y.qr": move, "A.qr": 4 * move, "C.qr": 0 * t})
        found = respond(trunnion, log, every_step=True)
        rest = found.request.clock > 1.5
        assert np.all(np.abs(found.v[rest]).max(axis=0) < 1e-4 * np.abs(found.v).max(axis=0).clip(1e-3))
        changes = np.sum(np.abs(np.diff(np.sign(found.v[rest] + 0.0), axis=0)) > 1, axis=0)
        assert np.all(changes < 40)

    def test_gravity_is_held_from_the_first_sample(self, trunnion):
        t = np.arange(200) * 1e-3
        log = Log({"t": t, "Y.qr": 0 * t, "A.qr": 0 * t + 0.5, "C.qr": 0 * t})
        found = respond(trunnion, log)
        assert np.ptp(found.u[:, 1]) < 1e-6 * np.abs(found.u[:, 1]).max()


class TestWhatIsUsed:
    def test_nothing_measured_is_looked_at(self, trunnion, command):
        noise = np.random.default_rng(0).normal(size=len(command))
        spoilt = with_(command, Y__q=noise, Y__u=noise * np.nan, A__v=noise)
        a, b = simulate(trunnion, command), simulate(trunnion, spoilt)
        assert all(np.array_equal(a[name], b[name]) for name in a.channels)

    def test_channels_are_those_of_the_contract(self, trunnion, command):
        found = simulate(trunnion, command)
        expected = ["t", *(f"{n}.{k}" for n in ("Y", "A", "C") for k in ("q", "e", "u"))]
        assert list(found.channels) == expected
        assert np.allclose(found["Y.q"] + found["Y.e"], command["Y.qr"], atol=1e-15)

    def test_the_rate_of_the_log_does_not_matter(self, trunnion):
        fine = smooth_command(trunnion.machine, 1.0, 2000.0)
        coarse = fine.rows(slice(None, None, 8))
        a, b = simulate(trunnion, fine), simulate(trunnion, coarse)
        assert not a.notes or "Hz" in a.notes[0]
        assert "log at 250 Hz, loops identified at 1000 Hz" in b.notes[0]
        for name in ("Y.e", "A.e", "A.u"):
            assert rms(a[name][::8] - b[name]) < 2e-2 * rms(a[name])

    def test_uneven_stamps_are_interpolated_and_said(self, trunnion, command):
        gappy = command.rows(np.r_[0:300, 306 : len(command)])
        found = simulate(trunnion, gappy)
        assert len(found) == len(gappy)
        assert "uneven" in found.notes[0]
        whole = simulate(trunnion, command)["Y.e"][np.r_[0:300, 306 : len(command)]]
        assert rms(found["Y.e"] - whole) < 2e-2 * rms(whole)

    def test_an_axis_without_loop_follows_its_command(self, trunnion, command):
        part = dataclasses.replace(trunnion, loops={"Y": trunnion.loops["Y"]})
        found = simulate(part, command)
        assert np.array_equal(found["A.e"], np.zeros(len(command)))
        assert "no closed loop of A, C" in found.notes[0]
        assert rms(found["A.u"]) > 0.0

    def test_a_form_of_older_twins_that_is_no_more_is_not_asked_for(self, trunnion):
        old = dataclasses.replace(trunnion, quality={"simulation": {"use": "grey"}})
        assert preferred(old) == "black"
        assert preferred(dataclasses.replace(old, loops={})) == "coupled"

    def test_a_higher_gain_makes_a_smaller_error(self, trunnion, command):
        law = {"A": trunnion.servos["A"].scaled(kp=1.5)}
        now = simulate(trunnion, command, controller="coupled")
        then = simulate(trunnion, command, controller=law)
        assert rms(then["A.e"]) < 0.85 * rms(now["A.e"])


class TestRefusals:
    def test_a_missing_command_is_named(self, trunnion, command):
        log = Log({k: x for k, x in command.channels.items() if k != "A.qr"}, "a.csv")
        with pytest.raises(
            LogError, match=r"a\.csv: no channel A\.qr; a simulation needs the command"
        ) as told:
            simulate(trunnion, log)
        assert "did you mean" not in str(told.value)  # a position that was measured is no command

    def test_a_column_that_may_be_the_command_is_offered(self, trunnion, command):
        log = Log({("A.soll" if k == "A.qr" else k): x for k, x in command.channels.items()}, "a.csv")
        with pytest.raises(LogError, match=r"no channel A\.qr; .*known: A\.soll"):
            simulate(trunnion, log)

    def test_holes_in_a_command_are_named_by_row(self, trunnion, command):
        bad = command["Y.qr"].copy()
        bad[[4, 10]] = np.nan
        with pytest.raises(LogError, match=r"channel Y\.qr is not a number in row 5, 11; a command"):
            simulate(trunnion, with_(command, Y__qr=bad))

    def test_time_that_runs_backward_is_refused(self, trunnion, command):
        t = command.t.copy()
        t[7] = t[5]
        with pytest.raises(LogError, match="time runs backward at row 8"):
            simulate(trunnion, with_(command, t=t))

    def test_a_log_of_a_few_rows_is_refused(self, trunnion, command):
        with pytest.raises(DataError, match="3 rows, at least 8"):
            simulate(trunnion, command.rows(slice(0, 3)))

    def test_a_load_on_no_link_is_refused(self, trunnion, command):
        with pytest.raises(LogError, match="external load on 'tabel', which is no link"):
            simulate(trunnion, with_(command, tabel__fx=0 * command.t))

    def test_a_twin_without_loops_is_refused(self, trunnion, command):
        with pytest.raises(TwinError, match="no closed loop"):
            simulate(dataclasses.replace(trunnion, loops={}, servos={}), command)

    def test_bad_options_are_refused(self, trunnion, command):
        with pytest.raises(InputError, match="step: -1"):
            simulate(trunnion, command, step=-1.0)
        with pytest.raises(InputError, match="controller: 'gray'"):
            simulate(trunnion, command, controller="gray")  # type: ignore[arg-type]
        with pytest.raises(InputError, match="no axis 'B'"):
            simulate(trunnion, command, controller={"B": trunnion.servos["A"]})

    def test_a_machine_that_leaves_its_command_is_said_with_axis_and_time(self, trunnion, command):
        wild = {k: 0.0 * x for k, x in trunnion.diagonal.items()}
        wild["inertia"] = 0.02 * trunnion.diagonal["inertia"]
        loops = dict(trunnion.loops)
        loops["A"] = dataclasses.replace(loops["A"], residues=30.0 * loops["A"].residues)
        broken = dataclasses.replace(trunnion, diagonal=wild, loops=loops)
        with pytest.raises(DataError, match=r"diverges from its command at t = .* on axis A"):
            simulate(broken, command)


def test_an_effort_logged_ahead_of_its_position_is_simulated_as_it_is_logged(trunnion, command):
    """A lead of the log: put back, the simulated effort is that of a machine whose log has none."""
    plain = simulate(trunnion, command)
    axes = {
        k: dataclasses.replace(axis, lead=0.004 if k == "A" else None)
        for k, axis in trunnion.machine.axes.items()
    }
    ahead = dataclasses.replace(trunnion, machine=dataclasses.replace(trunnion.machine, axes=axes))
    said = simulate(ahead, command)
    assert said["Y.u"] == pytest.approx(plain["Y.u"])
    assert said["A.q"] == pytest.approx(plain["A.q"])
    assert said["A.u"][:-4] == pytest.approx(plain["A.u"][4:], abs=1e-6 * np.ptp(plain["A.u"]))
    put_back = prepare(ahead.machine, said, cutoff=0.0, decimate=1)
    effort = np.interp(put_back.t, plain.t, plain["A.u"])[20:-20]
    assert put_back.u[20:-20, put_back.index("A")] == pytest.approx(effort, abs=1e-3 * np.ptp(effort))


def test_counts_that_machine_yaml_gives_a_size_are_a_command(trunnion, command):
    """Every position of the log is in encoder counts: each has its size by its own column."""
    names = [f"{axis}.{x}" for axis in trunnion.machine.axes for x in ("q", "qr")]
    logged = {**command.channels, **{k: command[f"{k[0]}.qr"] for k in names}}
    counts = Log(
        {k: x / (1e-7 if k in names else 1.0) for k, x in logged.items()}, units=dict.fromkeys(names, "inc")
    )
    columns = {k: Column(k, factor=1e-7) for k in names}
    counted = dataclasses.replace(trunnion, machine=dataclasses.replace(trunnion.machine, columns=columns))
    plain, found = simulate(trunnion, command), simulate(counted, counts)
    assert found["A.e"] == pytest.approx(plain["A.e"], abs=1e-6 * np.ptp(plain["A.e"]))
    assert set(names) <= set(found.command.channels)
    assert found.command["A.qr"] == pytest.approx(command["A.qr"])


def test_a_machine_begins_as_its_command_can_have_come_in() -> None:
    """Cut out of a motion it moves on; before a first move it stands; a step at the first row is not its motion."""
    h, t = 1e-3, 1e-3 * np.arange(200)
    cut = 0.1 * np.sin(3.0 * t + 1.0), 0.3 * np.cos(3.0 * t + 1.0)
    move = 0.05 * (1.0 - np.cos(3.0 * t)), 0.15 * np.sin(3.0 * t)
    step = 0.2 * t + np.where(t > 0.0, 1e-4, 0.0), np.where(t > 0.0, 0.2, 0.3)
    qr, vr = (np.stack(x, axis=1) for x in zip(cut, move, step, strict=True))
    q0, v0 = beginning(qr, vr, h)
    a = (6.0 * (q0[1] - q0[0]) / h - 4.0 * v0[0] - 2.0 * v0[1]) / h
    np.testing.assert_allclose(q0[0], qr[0])
    np.testing.assert_allclose(v0[0], [vr[0, 0], 0.0, 0.2], atol=1e-9)
    np.testing.assert_allclose(a, [-0.9 * np.sin(1.0), 0.0, 0.0], atol=2e-3)
