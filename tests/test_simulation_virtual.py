"""Identify on one log of a virtual machine, predict another from its command alone; and the command line."""

from __future__ import annotations

import dataclasses
import json
from typing import ClassVar

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.analysis.disturbance import diagonal, generalised_disturbance
from pinotwin.cli.main import main
from pinotwin.effects import Coefficient, Columns, Coulomb, Effect, PositionTable, Viscous
from pinotwin.log import Log
from pinotwin.logs.write import write_log
from pinotwin.loop import LoopData, Structure, identify_loop
from pinotwin.motion import Motion
from pinotwin.simulation import compare, respond, simulate
from pinotwin.simulation.run import as_motion
from pinotwin.virtual import VirtualMachine, random_trajectory
from tests.simulated import known_twin, plain_machine, smooth_command


def recorded(name: str, urdf_dir, seconds: float, seed: int) -> Log:  # type: ignore[no-untyped-def]
    # `coulomb` does not know what friction holds while an axis stands; here the simulation is judged.
    machine = VirtualMachine.load(urdf_dir / name, withhold=["coulomb"])
    return machine.record(random_trajectory(machine, seconds, seed), seed=seed).to_log()


@pytest.fixture(scope="module")
def twin(urdf_dir):
    """Only linear effects, and loops of the default order: quicker than searching and choosing."""
    log = recorded("trunnion", urdf_dir, 20.0, 1)
    machine = pt.Machine.load("trunnion")
    for axis, part in machine.axes.items():
        table = [PositionTable(axis=axis, rotary=part.rotary)] if axis != "C" else []
        plain = (Viscous(axis=axis, rotary=part.rotary), Coulomb(axis=axis, rotary=part.rotary))
        machine = machine.with_effects(axis, (*plain, *table))
    twin = pt.identify(machine, log, loop=False)
    motion = twin.motion(log)
    twin = dataclasses.replace(twin, diagonal=diagonal(twin, motion))
    d = generalised_disturbance(twin, motion, twin.diagonal)
    loops = {}
    for name in twin.machine.axes:
        i = motion.index(name)
        outputs = np.stack([motion.qr[:, i] - motion.q[:, i], motion.u[:, i]], axis=1)
        data = LoopData(motion.step, motion.qr[:, i], d[:, i], outputs, motion.segments, axis=name)
        loops[name] = identify_loop(data, Structure())
    return dataclasses.replace(twin, loops=loops)


@pytest.fixture(scope="module")
def unseen(urdf_dir) -> Log:
    return recorded("trunnion", urdf_dir, 8.0, 2)


class TestUnseenTrajectory:
    def test_effort_is_predicted_nearly_as_well_as_from_the_measured_motion(self, twin, unseen):
        rows = compare(twin.machine, unseen, simulate(twin, unseen))
        motion = twin.motion(unseen)
        known = twin.effort(motion) - motion.u
        for name in twin.machine.axes:
            i = motion.index(name)
            floor = np.sqrt(np.mean(known[:, i] ** 2) / np.mean(motion.u[:, i] ** 2))
            assert rows[name]["u"]["nrmse"] < 1.25 * floor + 0.01
        assert rows["A"]["u"]["nrmse"] < 0.02
        assert rows["A"]["e"]["nrmse"] < 0.12

    def test_feeding_back_costs_little_against_measured_disturbance(self, twin, unseen):
        """The simulated disturbance is as good an input to the loops as the one from measured motion."""
        motion = twin.motion(unseen)
        measured = generalised_disturbance(twin, motion, twin.diagonal)
        found = respond(twin, unseen)
        inside = motion.segments[0]
        for name, loop in twin.loops.items():
            i = twin.machine.axes[name].index
            e = (motion.qr[:, i] - motion.q[:, i])[inside]
            with_measured = loop.simulate(motion.qr[:, i], measured[:, i])[inside, 0]
            size = np.sqrt(np.mean(e**2))
            error = np.sqrt(np.mean((found.e[inside, i] - e) ** 2)) / size
            reference = np.sqrt(np.mean((with_measured - e) ** 2)) / size
            assert error < 1.3 * reference + 0.02

    def test_a_saved_twin_predicts_the_same(self, twin, unseen, tmp_path):
        again = pt.Twin.load(twin.save(tmp_path / "twin"))
        a, b = simulate(twin, unseen), simulate(again, unseen)
        assert np.allclose(a["Y.e"], b["Y.e"], rtol=1e-9, atol=1e-15)
        assert np.array_equal(twin.simulate(unseen)["Y.e"], a["Y.e"])


class TestCommandLine:
    @pytest.fixture(scope="class")
    @classmethod
    def folder(cls, twin, tmp_path_factory):
        return twin.save(tmp_path_factory.mktemp("twin"))

    def test_writes_the_prediction_and_says_how_good_it_is(self, folder, unseen, tmp_path, capsys):
        write_log(tmp_path / "log.csv", unseen.channels)
        out, result = tmp_path / "pred.csv", tmp_path / "result.json"
        args = [
            "simulate",
            str(folder),
            str(tmp_path / "log.csv"),
            "--out",
            str(out),
            "--json",
            str(result),
        ]
        assert main(args) == 0
        predicted = pt.read(out)
        assert list(predicted.channels)[:4] == ["t", "Y.q", "Y.e", "Y.u"]
        assert len(predicted) == len(unseen)
        rows = json.loads(result.read_text())["axes"]
        assert rows["A"]["u"]["nrmse"] < 0.02
        text = capsys.readouterr().out
        assert "rows written" in text
        assert f"{rows['A']['u']['nrmse']:.2%}" in text

    def test_a_log_without_measurements_is_enough(self, folder, unseen, tmp_path, capsys):
        asked = {k: x[:500] for k, x in unseen.channels.items() if k == "t" or k.endswith(".qr")}
        write_log(tmp_path / "log.csv", asked)
        assert (
            main(
                [
                    "simulate",
                    str(folder),
                    str(tmp_path / "log.csv"),
                    "--out",
                    str(tmp_path / "p.csv"),
                ]
            )
            == 0
        )
        *notes, closed, written = capsys.readouterr().out.splitlines()  # and no table of errors
        assert closed.startswith("closed loop: ")
        assert all(note.startswith("note: the command leaves what the twin knows: Y") for note in notes)
        assert written == f"500 rows written to {tmp_path / 'p.csv'}"

    def test_bad_input_is_one_line_and_leaves_no_file(self, folder, unseen, tmp_path, capsys):
        write_log(tmp_path / "log.csv", {k: x[:500] for k, x in unseen.channels.items() if k != "A.qr"})
        args = [
            "simulate",
            str(folder),
            str(tmp_path / "log.csv"),
            "--out",
            str(tmp_path / "p.csv"),
        ]
        assert main(args) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert "A.qr" in error
        assert not (tmp_path / "p.csv").exists()
        assert main([*args[:-1], str(tmp_path / "p.xls")]) == 2


def test_a_motor_that_turns_two_joints_has_friction_in_the_sum_of_their_speeds():
    machine = plain_machine("tx40")
    effects = (*machine.axes["J6"].effects, *pt.Machine.load("tx40").axes["J6"].effects[-1:])
    assert effects[-1].name == "wrist_coupling"
    twin = known_twin(machine.with_effects("J6", effects), scale=0.05)
    theta = twin.theta.copy()
    theta[twin.slices[twin.keys.index("J6.wrist_coupling")]] = 2e-3, 0.02, 0.05
    twin = dataclasses.replace(twin, theta=theta)
    found = respond(twin, smooth_command(twin.machine, 0.5, 1000.0), every_step=True)
    needed = twin.effort(as_motion(twin, found))
    slides = np.abs(found.v[:, 4] + found.v[:, 5]) > 0.1  # the effect takes a plain sign, which chatters
    slides &= np.arange(len(slides)) > 200
    for i in range(machine.nv):
        size = np.sqrt(np.mean(found.u[:, i] ** 2))
        assert np.sqrt(np.mean((found.u[slides, i] - needed[slides, i]) ** 2)) < 2e-2 * size


@dataclasses.dataclass(frozen=True)
class Wind(Effect):
    """Drag of one axis that grows with the speed of another: tau = c v_Y v_A²."""

    name: ClassVar[str] = "wind"
    axis: str = "Y"

    def coefficients(self) -> tuple[Coefficient, ...]:
        return (Coefficient("c", "N·s³/m"),)

    def columns(self, motion: Motion) -> Columns:
        own, other = motion.axis("Y"), motion.axis("A")
        return Columns((own.index,), (own.v * other.v**2)[:, None, None])


def test_an_effect_that_fits_no_table_is_simulated_by_passes():
    twin = known_twin(plain_machine("trunnion"))
    windy = dataclasses.replace(twin, effects=(*twin.effects, Wind()), theta=np.append(twin.theta, 30.0))
    log = smooth_command(twin.machine, 0.6, 1000.0)
    found, calm = respond(windy, log, every_step=True), respond(twin, log, every_step=True)
    assert not found.notes
    motion = as_motion(windy, found)
    needed, drag = (
        windy.effort(motion)[:, 0],
        windy.parts(motion)["Y." + windy.effects[-1].name][:, 0],
    )
    assert np.sqrt(np.mean(drag**2)) > 1.0
    assert np.sqrt(np.mean((found.u[:, 0] - needed) ** 2)) < 1e-2 * np.sqrt(np.mean(drag**2))
    assert np.abs(found.u - calm.u)[:, 0].max() > 1.0


def test_positions_are_given_as_the_log_counts_them():
    """With a transmission the log holds motors, the model joints."""
    twin = known_twin(plain_machine("tx40"), scale=0.05)
    log = smooth_command(twin.machine, 0.3, 1000.0)
    motors = {k: x if k == "t" else 32.0 * x for k, x in log.channels.items()}
    found = simulate(twin, Log(motors, "motors"))
    joints = respond(twin, Log(motors, "motors"))
    for name in twin.machine.axes:
        assert np.allclose(found[f"{name}.q"] + found[f"{name}.e"], motors[f"{name}.qr"], atol=1e-12)
    power_motor = sum(found[f"{n}.u"] * np.gradient(found[f"{n}.q"], 1e-3) for n in twin.machine.axes)
    power_joint = np.sum(joints.u * np.gradient(joints.q, 1e-3, axis=0), axis=1)
    assert np.allclose(power_motor, power_joint, atol=1e-6 * np.abs(power_joint).max())
