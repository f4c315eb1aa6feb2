"""The real recordings of the bench, and how each model loses what its machine has."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.linalg import qr

from benchmarks.questions.real import Given, Task
from pinotwin.dynamics.base import BaseParameters
from pinotwin.dynamics.batch import regressor
from pinotwin.dynamics.parameters import body_count, parameter_count, parameter_names
from pinotwin.effects import EFFECTS, RippleModulated
from pinotwin.errors import DataError
from pinotwin.log import Log
from pinotwin.logs.files import read
from pinotwin.logs.quality import resample
from pinotwin.machine import Machine

KR300 = Path(__file__).resolve().parents[2] / "examples" / "machines" / "kr300"
POSITION = ("ripple", "ripple_modulated", "position_table")
BEND = ("joint_flexibility", "drive_flexibility")


def _emps(effects: tuple[str, ...], folder: Path) -> Given:
    """Return the EMPS with these effects; the first 60 % of its log, the rest held back."""
    log = read(folder / "emps" / "DATA_EMPS.mat")
    made = tuple(EFFECTS[name](axis="X") for name in effects)  # type: ignore[call-arg]
    cut = int(0.6 * len(log))
    return Given(
        Machine.load("emps").with_effects("X", made),
        (log.rows(slice(0, cut)),),
        (log.rows(slice(cut, None)),),
    )


# How far each effort of the TX40 is ahead of its position [s]: where the delay that is left over, beside
# the whole model, is nil. (`check` sees the lead from one channel's smoothness: 1.5 to 2.7 ms.)
_LEADS = (3.65e-3, 3.75e-3, 1.5e-3, 1.9e-3, 3.4e-3, 2.6e-3)
_J4_PITCH = 0.20511209  # [rad]: 30.6 waves a turn, a ripple of its gear that no published model has


def _tx40(change: Callable[[Machine], Machine], complete: bool, folder: Path) -> Given:
    """Return the TX40 without one effect; ``complete``: with all else that is known of it.

    What is withheld should be the largest thing that the model lacks: leads are taken out, and the
    ripple of J4 is listed.
    """
    machine = Machine.load("tx40")
    files = (folder / "staubli_tx40" / f for f in ("pos_read_data.csv", "curr_data.csv"))
    log = read(*files)
    if complete:
        at = np.arange(len(log)) / 5000.0
        names = [f"curr_data.Joint_{k}" for k in range(1, 7)]
        moved = {n: np.interp(at - s, at, log[n]) for n, s in zip(names, _LEADS, strict=True)}
        log = log.with_channels({**log.channels, **moved})
        ripple = RippleModulated("J4", rotary=True, period=_J4_PITCH)
        machine = machine.with_effects("J4", (*machine.axis("J4").effects, ripple))
    return Given(change(machine), (log,))


def _same(machine: Machine) -> Machine:
    return machine


def _uncoupled(machine: Machine) -> Machine:
    kept = tuple(e for e in machine.axis("J6").effects if e.name != "wrist_coupling")
    return machine.with_effects("J6", kept)


def _weightless(machine: Machine) -> Machine:
    model = pin.Model(machine.model)
    model.gravity = pin.Motion.Zero()
    return dataclasses.replace(machine, model=model)


def _rotorless(machine: Machine) -> Machine:
    """Return the machine whose rigid-body model knows links, but no rotors that turn faster."""
    model = machine.model
    links = np.arange(10 * body_count(model))
    rng = np.random.default_rng(0)
    q, v, a = (rng.uniform(-2.0, 2.0, (200, model.nv)) for _ in range(3))
    W = regressor(model, q, v, a, links).reshape(-1, len(links))
    size = np.linalg.norm(W, axis=0)
    scaled = W / np.where(size > 0.0, size, 1.0)
    _, R, order = qr(scaled, mode="economic", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(R)) > 1e-7 * abs(R[0, 0])))
    kept = np.sort(order[:rank])
    K = np.linalg.lstsq(W[:, kept], W, rcond=None)[0]
    P = np.zeros((rank, parameter_count(model)))
    P[:, links] = np.where(np.abs(K) > 1e-9, K, 0.0)
    names = tuple(parameter_names(model)[k] for k in kept)
    whole = machine.base
    units = dict(zip(whole.names, whole.units, strict=True))
    base = BaseParameters(P, kept, names, names, tuple(units.get(n, "SI") for n in names), ())
    poorer = dataclasses.replace(machine)
    vars(poorer)["base"] = base  # in place of what Machine.base would work out
    return poorer


_MOTOR = """<?xml version="1.0"?>
<robot name="motor"><link name="base_link"/><joint name="M" type="continuous">
<parent link="base_link"/><child link="rotor"/><axis xyz="0 0 1"/></joint>
<link name="rotor"><inertial><mass value="0.3"/><inertia ixx="2e-4" iyy="2e-4" izz="2.5e-4"
 ixy="0" ixz="0" iyz="0"/></inertial></link></robot>
"""


def _motor() -> Machine:
    """Return a motor that stands upright: inertia and friction, nothing along the turn."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        (path / "motor.urdf").write_text(_MOTOR, encoding="utf-8")
        text = "name: motor\nurdf: motor.urdf\naxes:\n  M: {joint: M, effects: [viscous, coulomb]}\n"
        (path / "machine.yaml").write_text(text, encoding="utf-8")
        machine = Machine.load(path)
        assert machine.model.nv == 1  # reads the model while the folder exists
        return machine


def _cogging_maps(folder: Path) -> Given:
    """Return the maps a and b, held position by held position, as very slow turns."""
    logs = []
    for which in "ab":
        path = folder / "odrive_cogging" / f"coggingmap_0_cogging_measure_final_{which}_16.npy"
        current = np.load(path)
        visited = np.flatnonzero(current)  # 0 means that the count was not visited
        q = 2.0 * np.pi * visited / len(current)
        t = np.arange(len(visited)) / 100.0
        logs.append(Log({"t": t, "M.q": q, "M.u": current[visited]}, source=f"map {which}"))
    return Given(_motor(), (logs[0],), (logs[1],))


def _cogging_runs(folder: Path) -> Given:
    """Return the three slow turns without compensation; the third is held back."""
    logs = []
    for k in range(3):
        t, counts, current = np.load(folder / "odrive_cogging" / f"slow2_nocomp_{k}.npy")
        q = 2.0 * np.pi * counts / 8192.0
        raw = Log({"t": t - t[0], "M.q": q, "M.u": current}, source=f"slow turn {k}")
        logs.append(resample(raw, 440.0))
    return Given(_motor(), tuple(logs[:2]), (logs[2],))


def _kr300(folder: Path) -> Given:
    if not KR300.is_dir():
        raise DataError("the KR300's machine folder comes with the sources only")
    return Given(Machine.load(KR300), (read(folder / "kuka_kr300" / "FF_A_08ms.mat"),))


_EMPS, _TX40 = "emps/DATA_EMPS.mat", "staubli_tx40/curr_data.csv"
_JOINTS = tuple(f"J{k}" for k in range(1, 7))

TASKS: tuple[Task, ...] = (
    Task(
        "EMPS",
        "Coulomb friction",
        ("coulomb", "coulomb_asymmetric", "presliding"),
        ("X",),
        partial(_emps, ("viscous", "offset")),
        _EMPS,
    ),
    Task(
        "EMPS",
        "viscous friction",
        ("viscous", "viscous_asymmetric"),
        ("X",),
        partial(_emps, ("coulomb", "offset")),
        _EMPS,
    ),
    Task(
        "EMPS",
        "asymmetric friction",
        ("viscous_asymmetric", "coulomb_asymmetric"),
        ("X",),
        partial(_emps, ("viscous", "coulomb")),
        _EMPS,
    ),
    Task(
        "TX40",
        "wrist coupling",
        ("wrist_coupling", "inertial_coupling"),
        ("J5", "J6"),
        partial(_tx40, _uncoupled, True),
        _TX40,
    ),
    Task("TX40", "gravity", ("gravity",), (), partial(_tx40, _weightless, True), _TX40),
    Task("TX40", "rotor inertia", ("rotor_inertia",), (), partial(_tx40, _rotorless, True), _TX40),
    Task("TX40", "the effort's lead, uncorrected", ("delay",), _JOINTS, partial(_tx40, _same, False), _TX40),
    Task("ODrive, cogging maps", "cogging", POSITION, ("M",), _cogging_maps, "odrive_cogging"),
    Task("ODrive, slow turns", "cogging", POSITION, ("M",), _cogging_runs, "odrive_cogging"),
    Task("KR300", "gear ripple", POSITION, (), _kr300, "kuka_kr300/FF_A_08ms.mat"),
    Task("KR300", "joint flexibility", BEND, ("A1", "A2", "A3"), _kr300, "kuka_kr300/FF_A_08ms.mat"),
)
"""Every line of the table."""
