"""``new``: a machine folder from axes, a URDF, a bundled machine or a robot, with a log's columns guessed."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from pinotwin.columns import bind
from pinotwin.errors import InputError, MachineError, nearest
from pinotwin.log import Log
from pinotwin.logs.files import LogLike, as_log
from pinotwin.machine import Machine
from pinotwin.machine.bundled import machines, robots
from pinotwin.machine.sections import parse_columns
from pinotwin.machine.urdf import idle_joints, load_model, resolve_meshes
from pinotwin.machine.urdf_check import axis_names, mimics, read_tree
from pinotwin.notebook import Card, Shown
from pinotwin.scaffold.chain import Chain, Sizes, assumed, is_chain, kind_of, parse_chain, write_urdf
from pinotwin.scaffold.guess import Guesses, guess_columns, in_one_line
from pinotwin.system.writing import as_path, whole_folder

ROTOR = {True: 0.01, False: 1.0}
"""Whether an axis turns -> inertia of its rotor [kg·m² or kg] where its URDF has no mass on it."""


@dataclass(frozen=True, repr=False)
class Start(Card):
    """A machine folder that was written."""

    folder: Path  # where
    machine: Machine  # the machine in it
    said: tuple[str, ...]  # what was assumed, one sentence each
    guesses: Guesses | None  # the log's columns, None without a log

    def _shown(self) -> Shown:
        guesses = self.guesses or Guesses()
        rows = [("assumed", text) for text in self.said]
        rows += [("guess", f"{g.channel} = {g.column}: {g.reason}") for g in guesses.found]
        rows += [("open", text) for text in guesses.open]
        return (f"Machine folder {self.folder}", ("", "what"), rows, "")


def new(
    source: str | Path | pin.Model,
    log: LogLike | None = None,
    *,
    out: str | Path,
    rotary: str = "table",
    sizes: Sizes | None = None,
    rate: float | None = None,
    meshes: str | Path | None = None,
) -> Start:
    """Write a machine folder.

    Args:
        source: letters of axes (``XYZAC``, ``XYZ-BC``), a ``.urdf``, a bundled name, a robot of
            example-robot-data, or a ``pin.Model``.
        log: a log of the machine, as read, or its file; its columns are guessed.
        out: the folder to write; it must not hold a machine yet.
        rotary: what rotary axes carry where ``source`` does not say: ``table`` or ``head``.
        sizes: what is known of the axes.
        rate: sampling rate [Hz] of a log without a time column.
        meshes: folder of the mesh packages of a URDF.

    Raises:
        InputError: the source means nothing, or the folder holds a machine.
    """
    target, text = as_path(out, "out"), str(source)
    log = None if log is None else as_log(log)
    if (target / "machine.yaml").exists():
        raise InputError(f"{target}: holds a machine.yaml already; choose another folder, or edit that one")
    with whole_folder(target) as folder:
        task = _Task(folder, log, rate, sizes or Sizes(), meshes)
        if isinstance(source, pin.Model):
            Machine.from_model(source).save(folder)
            what = f"the model {source.name or 'in hand'}"
            said = [f"made of {what}: every joint of one degree of freedom is an axis"]
            guesses = _guess_known(task)
        elif text in machines():
            shutil.copytree(machines()[text], folder, dirs_exist_ok=True)
            said, guesses = [f"copied from the bundled machine {text}"], _guess_known(task)
        elif Path(text).suffix == ".urdf" or text in robots():
            guesses, said = _from_urdf(robots().get(text, Path(text)), task)
        elif is_chain(text):
            name = re.sub(r"\W+", "_", target.resolve().name).strip("_") or "machine"
            guesses, said = _from_axes(name, parse_chain(text, rotary), task)
            said[0] += "" if "-" in text else "; write XYZ-AC to say it yourself"
        else:
            raise MachineError(
                f"{text}: neither axes (XYZAC, XYZ-BC), nor a .urdf, nor a machine by name; "
                f"{nearest(text, [*machines(), *robots()])}"
            )
    return Start(target, Machine.load(target), tuple(said), None if log is None else guesses)


@dataclass(frozen=True)
class _Task:
    """What was asked for beside the machine itself."""

    folder: Path
    log: Log | None
    rate: float | None
    sizes: Sizes
    meshes: str | Path | None

    def guesses(self, axes: Mapping[str, tuple[str, bool]]) -> Guesses:
        """Return the guesses, none without a log, with known factors of efforts; InputError for one of no effort."""
        if self.log is None:
            return Guesses()
        guesses = guess_columns(self.log, axes, self.rate)
        efforts = {f"{axis}.u": factor for axis, factor in self.sizes.factor.items()}
        known = [g.channel for g in guesses.found if g.channel.endswith(".u")]
        for channel in efforts:
            if channel not in known:
                hint = nearest(channel, known)
                raise InputError(f"factor: no effort {channel!r} among the columns; {hint}")
        found = tuple(
            replace(g, factor=g.factor * efforts[g.channel], reason=f"{g.reason}; factor as given")
            if g.channel in efforts
            else g
            for g in guesses.found
        )
        asked = tuple(q for q in guesses.open if q.partition(": ")[0] not in efforts)
        return replace(guesses, found=found, open=asked)


def _guess_known(task: _Task) -> Guesses:
    """Put the guesses in place of the columns of a machine.yaml that is there."""
    axes = {name: (axis.joint, axis.rotary) for name, axis in Machine.load(task.folder).axes.items()}
    guesses = task.guesses(axes)
    if guesses.found:
        file = task.folder / "machine.yaml"
        text = re.sub(r"(?ms)^columns:.*?(?=^\S|\Z)", "", file.read_text(encoding="utf-8"))
        file.write_text(text.rstrip() + "\n" + _columns(guesses), encoding="utf-8")
    return guesses


def _from_urdf(path: Path, task: _Task) -> tuple[Guesses, list[str]]:
    root = read_tree(path)
    joints = {str(j.get("name")): str(j.get("type")) for j in root.findall("joint")}
    axes = {name: (joint, joints[joint] != "prismatic") for name, joint in axis_names(root).items()}
    if not axes:
        raise MachineError(f"{path}: no joint of it can be an axis")
    said = [f"{len(axes)} joints of {path.name} are axes"]
    said += [f"{name} follows {leader} (mimic) and is no axis" for name, leader in mimics(root).items()]
    said += [f"{name} is the joint {joint!r}" for name, (joint, _) in axes.items() if name != joint]
    guesses = task.guesses(axes)
    idle = [name for name in axes if task.log is not None and f"{name}.q" not in guesses]
    if idle and len(idle) < len(axes):
        said.append(f"not in the log, held at zero: {', '.join(idle)}")
        axes = {name: value for name, value in axes.items() if name not in idle}
        guesses = replace(guesses, open=tuple(q for q in guesses.open if q.partition(".")[0] not in idle))
    massless = idle_joints(load_model(path, [joint for joint, _ in axes.values()]))
    rotors = {name: ROTOR[turns] for name, (joint, turns) in axes.items() if joint in massless}
    for name, rotor in rotors.items():
        unit = "kg·m²" if axes[name][1] else "kg"
        said.append(f"{name} moves no mass in the URDF: rotor_inertia {rotor:g} {unit} (assumed)")
    resolve_meshes(root, path)
    text = etree.tostring(root, xml_declaration=True, encoding="utf-8")
    (task.folder / f"{path.stem}.urdf").write_bytes(text)
    _write_yaml(task, path.stem, {axis: joint for axis, (joint, _) in axes.items()}, guesses, rotors)
    return guesses, said


def _from_axes(name: str, chain: Chain, task: _Task) -> tuple[Guesses, list[str]]:
    axes = {axis: (axis, kind_of(axis) == "rotary") for axis in chain.axes}
    guesses = task.guesses(axes)
    travel = {} if task.log is None else _travel(task.log, guesses, axes)
    sizes = replace(task.sizes, travel={**travel, **task.sizes.travel})
    (task.folder / f"{name}.urdf").write_bytes(write_urdf(name, chain, sizes))
    _write_yaml(task, name, {axis: axis for axis in chain.axes}, guesses, {})
    return guesses, assumed(chain, sizes, set(travel))


def _travel(
    log: Log, guesses: Guesses, axes: Mapping[str, tuple[str, bool]]
) -> dict[str, tuple[float, float]]:
    """Return limits a tenth beyond what the log reaches [m or rad], for axes that do not turn endlessly."""
    entries = {g.channel: g.entry for g in guesses.found if g.channel.endswith(".q")}
    try:
        bound = bind(log, parse_columns(entries))
    except InputError:
        return {}
    out = {}
    for axis in axes:
        if f"{axis}.q" in bound and axis != "C":
            q = bound[f"{axis}.q"][np.isfinite(bound[f"{axis}.q"])]
            margin = 0.1 * float(np.ptp(q)) if len(q) else 0.0
            if margin > 0.0:
                out[axis] = (round(float(q.min()) - margin, 4), round(float(q.max()) + margin, 4))
    return out


def _write_yaml(
    task: _Task, name: str, axes: Mapping[str, str], guesses: Guesses, rotors: Mapping[str, float]
) -> None:
    lines = [
        "# Written by `pinotwin new`. Every guess says why: correct what is wrong, then `pinotwin check`.",
        f"name: {name}",
        f"urdf: {name}.urdf",
    ]
    lines += [f"meshes: {Path(task.meshes).resolve()}"] if task.meshes else []
    lines += ["axes:  # what acts beside the rigid body; more effects: stribeck, ripple, position_table..."]
    for axis, joint in axes.items():
        rotor = {"rotor_inertia": rotors[axis]} if axis in rotors else {}
        entry = {"joint": joint, "effects": ["viscous", "coulomb"], **rotor}
        lines.append(f"  {in_one_line({axis: entry})}")
    text = "\n".join(lines) + "\n" + (_columns(guesses) if guesses.found else "")
    (task.folder / "machine.yaml").write_text(text, encoding="utf-8")


def _columns(guesses: Guesses) -> str:
    head = "columns:  # how this controller names and scales its channels: SI = raw * unit * factor + offset"
    found = [f"  {guess.yaml}" for guess in guesses.found]
    asked = [f"  # open: {question}" for question in guesses.open]
    return "\n".join([head, *found, *asked]) + "\n"
