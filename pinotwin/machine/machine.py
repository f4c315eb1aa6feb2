"""What we believe about a machine: its tree from the URDF; axes, effects and sensors from YAML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml
from lxml import etree

from pinotwin.arrays import Floats
from pinotwin.columns import Column
from pinotwin.dynamics.base import BaseParameters, base_parameters
from pinotwin.effects import Effect, RigidBody, Spring, Tree
from pinotwin.errors import InputError, MachineError, require
from pinotwin.machine.effect_list import make_effects
from pinotwin.machine.parts import Axis, DataSettings, Imu, LoopShape, Passive
from pinotwin.machine.urdf import resolve_meshes
from pinotwin.machine.urdf_check import read_tree
from pinotwin.notebook import Card, Shown
from pinotwin.system.writing import as_path, write_bytes, write_text


@dataclass(frozen=True, eq=False, repr=False)
class Machine(Card):
    """A machine: its tree and what is believed to act on it. See :meth:`load`.

    Attributes:
        name: name of the machine.
        path: the machine.yaml (or the URDF) it came from.
        urdf: the URDF file.
        model: Pinocchio model of the axes and passive joints, everything else locked at zero.
        axes: axis name -> axis, in the order of the YAML.
        passive: joints without motor.
        imus: inertial sensors.
        loop: order of the closed loop per axis, and its encoder; axes that are absent take the default.
        columns: how this controller names and scales its channels.
        transmission: motor position = transmission @ joint position, in the model's order; None for identity.
        data: how logs are prepared.
        meshes: folders in which the URDF's meshes are looked for first.
    """

    name: str
    path: Path
    urdf: Path
    model: pin.Model
    axes: Mapping[str, Axis]
    passive: Mapping[str, Passive] = field(default_factory=dict)
    imus: Mapping[str, Imu] = field(default_factory=dict)
    loop: Mapping[str, LoopShape] = field(default_factory=dict)
    columns: Mapping[str, Column] = field(default_factory=dict)
    transmission: Floats | None = None
    data: DataSettings = field(default_factory=DataSettings)
    spec: Mapping[str, Any] = field(default_factory=dict, repr=False)
    meshes: tuple[Path, ...] = ()

    def __new__(cls, *given: Any, **fields: Any) -> Machine:
        """Refuse what is no list of attributes with the name of the function that takes it."""
        if len(given) == 1 and not fields:
            how = "from_model" if isinstance(given[0], pin.Model) else "load"
            raise MachineError(f"Machine({type(given[0]).__name__}): use Machine.{how}")
        return object.__new__(cls)

    @classmethod
    def load(cls, path: str | Path) -> Machine:
        """Read a machine from its folder, its machine.yaml, a bare URDF, or by name.

        Args:
            path: folder, ``machine.yaml``, ``*.urdf`` (every moving joint an axis with the default effects), one of
                :func:`pinotwin.machines`, or a robot of example-robot-data, e.g. ``"ur5"``.

        Raises:
            MachineError: with the file, the key and the remedy.
        """
        from pinotwin.machine.loading import load_machine

        return load_machine(path)

    @classmethod
    def from_model(
        cls,
        model: pin.Model,
        axes: Iterable[str] | Mapping[str, Any] | None = None,
        *,
        name: str | None = None,
        effects: Iterable[Any] | None = None,
    ) -> Machine:
        """Make a machine of a ``pin.Model`` in hand, without a file.

        Joints that are no axis are locked at neutral. The tree becomes a URDF, which :meth:`save` writes. Gravity,
        damping and friction are kept, mimic joints refused; geometry (not in a model) is lost. The joints are in the
        order in which Pinocchio reads a URDF (siblings by name): address them by name.

        Args:
            model: Pinocchio model; ``armature`` becomes the axes' rotor inertia.
            axes: joints that are axes (all of one degree of freedom when None), or joint -> its effects, as in
                machine.yaml (``["viscous", {"ripple": {"period": 0.01}}]``) or as :class:`pinotwin.Effect`, or
                joint -> the whole entry under ``axes`` of machine.yaml.
            name: of the machine; the model's own when None.
            effects: what an axis without a list of its own has, viscous and Coulomb friction when None: names,
                classes (own ones too), or effects (each on its own axis).

        Raises:
            MachineError: with what cannot be a machine, and the remedy.
        """
        from pinotwin.machine.from_model import machine_of_model

        return machine_of_model(model, axes, name, effects)

    def listing(self, effects: Iterable[Any] | Mapping[str, Iterable[Any]]) -> Machine:
        """Return the machine with further effects (names, mappings, classes, effects) of every axis, or by axis."""
        if isinstance(effects, str):
            raise MachineError(f"effects: expected a list such as [stribeck], found {effects!r}")
        machine = self
        each = dict(effects) if isinstance(effects, Mapping) else {}
        for effect in [] if isinstance(effects, Mapping) else effects:
            for name in (str(effect.axis),) if isinstance(effect, Effect) else self.axes:
                each.setdefault(name, []).append(effect)
        for name, more in each.items():
            axis = machine.axis(name)
            made = make_effects(list(more), name, axis.rotary, f"effects of {name}")
            there = {e.name for e in axis.effects}
            new = tuple(e for e in made if e.several or e.name not in there)
            machine = machine.with_effects(name, (*axis.effects, *new))
        return machine

    def regulated(self, axis: str) -> str:
        """Return the channel whose position an axis' controller regulates: ``<axis>.q`` or ``<axis>.ql``."""
        return f"{axis}.ql" if axis in self.loop and self.loop[axis].closed_on == "load" else f"{axis}.q"

    @property
    def nv(self) -> int:
        """Number of joints of the model."""
        return int(self.model.nv)

    @property
    def parts(self) -> tuple[Axis | Passive, ...]:
        """Axes and passive joints."""
        return (*self.axes.values(), *self.passive.values())

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Axis or passive name of every column of the machine's arrays."""
        return tuple(part.name for part in sorted(self.parts, key=lambda part: part.index))

    @cached_property
    def rotary(self) -> tuple[bool, ...]:
        """Whether each column is a rotation."""
        return tuple(part.rotary for part in sorted(self.parts, key=lambda part: part.index))

    @cached_property
    def base(self) -> BaseParameters:
        """Base parameters of the tree, rotor inertias included (they may be zero)."""
        return base_parameters(self.model)

    @cached_property
    def rigid_body(self) -> RigidBody:
        """The rigid-body effect."""
        return RigidBody(self.model, self.base)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Everything that acts: the tree, each axis' effects, each passive joint's spring."""
        of_axes = [effect for axis in self.axes.values() for effect in axis.effects]
        springs = [Spring(axis=p.name, rotary=p.rotary) for p in self.passive.values()]
        tree = Tree.of(self)
        return (self.rigid_body, *(effect.bound(tree) for effect in (*of_axes, *springs)))

    def axis(self, name: str) -> Axis:
        """Return an axis; MachineError if there is none of that name."""
        require(name, self.axes, f"{self.name}: no axis", MachineError)
        return self.axes[name]

    def with_effects(self, axis: str, effects: tuple[Effect, ...]) -> Machine:
        """Return the machine with other effects on one axis."""
        return replace(self, axes={**self.axes, axis: replace(self.axis(axis), effects=effects)})

    def with_meshes(self, folder: str | Path | None) -> Machine:
        """Return the machine with its meshes looked for first in a folder (None: itself); InputError without it."""
        if folder is None:
            return self
        if not Path(folder).is_dir():
            raise InputError(
                f"meshes: no folder {folder}; give the one that holds the meshes or their packages"
            )
        return replace(self, meshes=(Path(folder).resolve(), *self.meshes))

    def with_rigid_joints(self) -> Machine:
        """Return the machine with its passive joints locked at zero, as if infinitely stiff."""
        if not self.passive:
            return self
        model = self.model
        locked = [model.getJointId(part.joint) for part in self.passive.values()]
        rigid = pin.buildReducedModel(model, locked, pin.neutral(model))
        axes = {
            k: replace(a, index=int(rigid.idx_vs[rigid.getJointId(a.joint)])) for k, a in self.axes.items()
        }
        spec = {key: value for key, value in self.spec.items() if key != "passive"}
        return replace(self, model=rigid, axes=axes, passive={}, spec=spec)

    def posture(self, values: Mapping[str, float] | None = None) -> Floats:
        """Return the configuration with the named axes at ``values`` [m or rad], others at zero."""
        q = np.clip(np.zeros(self.nv), self.model.lowerPositionLimit, self.model.upperPositionLimit)
        for name, value in (values or {}).items():
            require(name, self.names, f"{self.name}: no axis", MachineError)
            q[self.names.index(name)] = value
        return q

    def _shown(self) -> Shown:
        rows = [
            (a.name, a.joint, "rotary" if a.rotary else "linear", ", ".join(e.title for e in a.effects))
            for a in self.axes.values()
        ]
        rows += [(p.name, p.joint, "passive", "") for p in self.passive.values()]
        note = f"{len(self.base.names)} base parameters; {self.path}"
        return (f"Machine {self.name}", ("axis", "joint", "kind", "effects"), rows, note)

    def save(self, folder: str | Path) -> Path:
        """Write ``machine.yaml`` and the URDF into a folder and return the path of the YAML."""
        from pinotwin.machine.loading import machine_spec

        folder = as_path(folder, "folder")
        target = folder / self.urdf.name
        if target.resolve() != self.urdf.resolve():
            root = read_tree(self.urdf)
            moved = resolve_meshes(root, self.urdf, self.meshes)
            text = etree.tostring(root, xml_declaration=True, encoding="utf-8")
            write_bytes(target, text if moved else self.urdf.read_bytes())
        path = folder / "machine.yaml"
        write_text(path, yaml.safe_dump(machine_spec(self), sort_keys=False, allow_unicode=True))
        return path


MachineLike = Machine | pin.Model | str | Path
"""A machine, a ``pin.Model``, a folder, machine.yaml or URDF, or the name of a bundled one."""


def as_machine(given: Any, name: str = "machine") -> Machine:
    """Return a machine as it is, of a ``pin.Model`` (every joint an axis) or loaded; ``name`` is for messages."""
    if isinstance(given, Machine):
        return given
    if isinstance(given, pin.Model):
        return Machine.from_model(given)
    if isinstance(given, str | Path):
        return Machine.load(given)
    raise InputError(
        f"{name}: expected a Machine, its folder, a pin.Model, a URDF or a bundled name, not {type(given).__name__}"
    )
