"""``VirtualMachine``: a machine folder brought to life, with a controller, friction and sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.errors import DataError, MachineError, require
from pinotwin.trajectories.moves import Limits, Trajectory
from pinotwin.virtual import columns as c
from pinotwin.virtual import kernel, run
from pinotwin.virtual.amounts import Body, Request, inject_all, withhold_all
from pinotwin.virtual.axis_truth import AxisTruth
from pinotwin.virtual.defaults import Scale, filled, resolved_axis, resolved_limits, scales
from pinotwin.virtual.folder import Folder, read_folder
from pinotwin.virtual.parameters import Layout, Timing, stiffest, tables
from pinotwin.virtual.recording import Recording, SealedTruth
from pinotwin.virtual.structs import Axes
from pinotwin.virtual.tree import assembled, axes_of, inertia_at, links_of, load_model, perturbed, tree_of
from pinotwin.virtual.truth import Passive, Pulse, Truth
from pinotwin.virtual.withholding import changed


@dataclass(frozen=True)
class VirtualMachine:
    """A machine with a sealed truth that can be run."""

    name: str  # name of the machine
    truth: Truth  # resolved truth; belongs to tests and scoring only
    model: pin.Model  # Pinocchio model of the shipped URDF
    true: pin.Model  # the true one; one coordinate a joint
    layout: Layout  # where names sit in it
    scales: Mapping[str, Scale]  # reference sizes of every axis
    timing: Timing  # rates of the simulation
    cad_inertia: Mapping[str, float]  # CAD inertia per axis that the feed-forward uses [kg or kg·m²]

    @classmethod
    def load(
        cls, folder: Path | str, *, withhold: Sequence[str] = (), inject: Sequence[Request] = ()
    ) -> VirtualMachine:
        """Return the virtual machine of a folder, or of its ``machine.yaml``.

        ``withhold``: effects to leave out, ``"stribeck:Y"``; ``inject``: to add, ``"backlash:Y=0.1"`` or
        ``{"effect": ..., "axis": ..., "size": ..., "seed": ..., "value": ...}``. MachineError for impossible values.
        """
        try:
            return cls.build(read_folder(folder), withhold=withhold, inject=inject)
        except (ArithmeticError, LookupError, RuntimeError, TypeError, ValueError) as error:
            raise MachineError(
                f"{folder}: no machine has these values ({error}); correct machine.yaml or virtual.yaml"
            ) from None

    @classmethod
    def build(
        cls, folder: Folder, *, withhold: Sequence[str] = (), inject: Sequence[Request] = ()
    ) -> VirtualMachine:
        """Return the virtual machine of a :class:`Folder`; see :meth:`load`."""
        model = load_model(folder.urdf, [*folder.axes.values(), *folder.passive.values()])
        if folder.gravity is not None:
            model.gravity.linear = np.array(folder.gravity)
        cad = assembled(model, list(model.inertias)[1:])
        truth, sizes = resolve(folder, model, cad)
        truth = withhold_all(truth, withhold)
        truth = inject_all(truth, inject, sizes, bodies_of(folder, model))
        true, layout = true_model(truth, folder, model)
        inertia = np.diag(inertia_at(cad, np.delete(layout.home, list(layout.bend.values()))))
        forward = {}  # inertia of CAD and what a rotor adds to it
        for name, joint in folder.axes.items():
            drive, j = truth.axes[name].drive, model.getJointId(joint) - 1
            forward[name] = float(inertia[j]) + (0.0 if drive.inside else drive.rotor or 0.0)
        timing = Timing(1.0 / truth.control_rate, 1, truth.substeps or 4)
        if not truth.substeps:
            guess = tables(truth, layout, true, timing, forward)
            needed = int(np.ceil(stiffest(guess, inertia_at(true, layout.home)) * timing.period / 0.2))
            timing = timing._replace(substeps=int(np.clip(needed, 4, 100)))
        return cls(folder.name, truth, model, true, layout, sizes, timing, forward)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes in order."""
        return tuple(self.layout.drive)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints of the true model in order."""
        return tuple(self.true.names)[1:]

    @property
    def limits(self) -> Mapping[str, Limits]:
        """Kinematic limits of every axis."""
        return {name: self.truth.axes[name].limits for name in self.axes}

    def tables(self, truth: Truth | None = None) -> Axes:
        """Return the kernel's tables, of this truth or of one with this run's friction."""
        return tables(truth or self.truth, self.layout, self.true, self.timing, self.cad_inertia)

    def inertia(self, q: Floats | None = None) -> Floats:
        """Return the true mass matrix at a position (home by default), shape (nv, nv)."""
        return inertia_at(self.true, self.layout.home if q is None else q)

    def record(
        self,
        trajectory: Trajectory,
        *,
        seed: int,
        noise: bool = True,
        external: Sequence[Pulse] | None = None,
        truth_rate: float | None = None,
    ) -> Recording:
        """Run the machine along a trajectory and return its log, with the truth kept apart.

        Another seed is a repeat: fresh sensor noise, and friction that scatters. ``noise=False`` leaves out all that,
        and quantisation. ``external`` loads take the place of those in ``virtual.yaml``; the truth's rate [Hz] is the
        log's where ``truth_rate`` is absent.
        """
        loads = self.truth.external if external is None else tuple(external)
        rate, true = self.truth.control_rate, self.true
        rng = np.random.default_rng([self.truth.seed, 1000, seed])
        truth = self.scattered(rng) if noise else self.truth
        axes, noises = self.tables(truth), rng if noise else None
        if not noise:
            axes.P[:, c.RESOLUTION] = 0.0
        every = run.decimation(rate, truth.log_rate, "log rate")
        fine = run.decimation(rate, truth_rate or truth.log_rate, "truth rate")
        step, n = int(np.gcd(every, fine)), round(trajectory.seconds * rate / every) * every
        if n < every:
            raise DataError(f"{self.name}: a trajectory of {trajectory.seconds} s is too short")
        drive = run.drive_of(truth, true, trajectory, loads, n, noises)
        state, tree = run.equilibrium(true, axes, drive.qr[0]), tree_of(true)
        record = run.empty_record(step, n // step, len(self.axes), len(self.joints))
        kernel.run(tree, axes, drive, state, run.empty_room(tree), record, self.timing)
        if not np.all(np.isfinite(record.q)):
            raise MachineError(f"{self.name}: the simulation diverged; lower the loop gains")
        t = np.arange(n // every) * every / rate
        log = run.log_of(truth, drive, record, t, every, noises) | run.load_channels(true, loads, t)
        rows = slice(None, None, fine // step)
        q, v, a, u, friction = (getattr(record, x)[rows] for x in ("q", "v", "a", "effort", "friction"))
        clock = np.arange(len(q)) * fine / rate
        sealed = SealedTruth(clock, self.joints, q, v, a, self.axes, u, friction, true)
        return Recording(self.name, log, sealed, seed)

    def scattered(self, rng: np.random.Generator) -> Truth:
        """Return the truth with this run's friction."""
        axes = {}
        for name, axis in self.truth.axes.items():
            a, b = 1.0 + self.truth.scatter * rng.standard_normal(2)
            coulomb, viscous = (axis.friction.coulomb or 0.0) * a, (axis.friction.viscous or 0.0) * b
            axes[name] = changed(axis, "friction", coulomb=coulomb, viscous=viscous)
        return replace(self.truth, axes=axes)


def resolve(folder: Folder, model: pin.Model, cad: pin.Model) -> tuple[Truth, dict[str, Scale]]:
    """Return the truth without gaps, and the reference sizes of every axis."""
    truth, joints = folder.truth, {n: model.getJointId(j) - 1 for n, j in folder.axes.items()}
    rng = np.random.default_rng([truth.seed, 2])
    given = [("axis", n, folder.axes) for n in truth.axes]
    for kind, name, known in [*given, *(("passive joint", n, folder.passive) for n in truth.passive)]:
        require(name, known, f"{folder.name}: virtual.yaml: no {kind}", MachineError)
    axes: dict[str, AxisTruth] = {}
    rotary, _ = axes_of(cad)
    travels = np.zeros((model.nv, 2))
    for name, j in joints.items():
        axis = truth.axes.get(name, AxisTruth())
        limits = resolved_limits(axis.limits, model, j, bool(rotary[j]))
        off = 1.0 + rng.choice((-1.0, 1.0)) * rng.uniform(*truth.inertial_error)
        axis = replace(axis, drive=filled(axis.drive, rotor=folder.rotors.get(name, 0.0) * off))
        top = axis.controller.effort_limit or folder.limits.get(name)
        axes[name] = replace(changed(axis, "controller", effort_limit=top), limits=limits)
        travels[j] = limits.travel or (0.0, 0.0)
    sizes = scales(cad, joints, axes, travels)
    axes = {name: resolved_axis(axis, sizes[name]) for name, axis in axes.items()}
    passive = {n: truth.passive.get(n, Passive(frequency=25.0)) for n in folder.passive}
    return replace(truth, axes=axes, passive=passive), sizes


def true_model(truth: Truth, folder: Folder, model: pin.Model) -> tuple[pin.Model, Layout]:
    """Return the true machine, inertials perturbed by its own seed first, and where the names sit in it."""
    bodies = perturbed(model, truth.inertial_error, np.random.default_rng([truth.seed, 1]))
    names = list(model.names)[1:]
    for load in truth.payload:
        require(load.joint, names, "payload: no joint", MachineError)
        bodies[names.index(load.joint)] += pin.Inertia(load.mass, np.array(load.centre), np.zeros((3, 3)))
    specs = {folder.axes[name]: axis for name, axis in truth.axes.items()}
    tilts = {joint: axis.tilt for joint, axis in specs.items()}
    bends = {joint: axis.bend.share for joint, axis in specs.items() if axis.bend is not None}
    true = assembled(model, bodies, tilts, bends)
    layout = _layout(truth, folder, true)
    armature = np.zeros(true.nv)
    for name, j in layout.drive.items():
        drive, rotor = truth.axes[name].drive, truth.axes[name].drive.rotor or 0.0
        if drive.frequency == 0.0:
            armature[j] += rotor
        elif drive.inside and name not in layout.bend:
            armature[j] -= rotor
    true.armature = armature
    return true, layout


def _layout(truth: Truth, folder: Folder, true: pin.Model) -> Layout:
    names = list(true.names)[1:]
    drive = {axis: names.index(joint) for axis, joint in folder.axes.items()}
    home, group = np.zeros(true.nv), np.full(true.nv, -1, dtype=np.intp)
    for axis, j in drive.items():
        home[j] = float(np.mean(truth.axes[axis].limits.travel or (0.0, 0.0)))
    drives = list(drive.values())
    for j, parent in enumerate(list(true.parents)[1:]):
        group[j] = drives.index(j) if j in drives else (group[parent - 1] if parent > 0 else -1)
    return Layout(
        drive=drive,
        passive={name: names.index(joint) for name, joint in folder.passive.items()},
        bend={axis: j + 1 for axis, j in drive.items() if truth.axes[axis].bend is not None},
        home=home,
        group=group,
    )


def bodies_of(folder: Folder, model: pin.Model) -> dict[str, Body]:
    """Return what each axis moves."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    out, (_, axes) = {}, axes_of(model)
    for name, joint in folder.axes.items():
        i = model.getJointId(joint)
        links = (link for link, frame in links_of(model).items() if frame.parentJoint == i)
        own, world = (tuple(map(float, x)) for x in (axes[i - 1], data.oMi[i].rotation @ axes[i - 1]))
        out[name] = Body(joint, next(links, ""), own, world, float(model.inertias[i].mass) or 1.0)
    return out
