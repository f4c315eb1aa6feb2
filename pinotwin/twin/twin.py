"""What was found: a machine with numbers, which predicts and which can judge itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import with_parameters
from pinotwin.effects import Effect
from pinotwin.effects.layout import effect_keys, effect_slices
from pinotwin.effects.scene import with_model
from pinotwin.errors import InputError, TwinError, nearest
from pinotwin.log import Log
from pinotwin.logs.files.given import LogLike
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.notebook import Shown, card, plain_card
from pinotwin.twin.misfit import Misfit
from pinotwin.twin.parameters import Parameter

if TYPE_CHECKING:
    from pinotwin.loop import Controller, LoopModel, Servo


@dataclass(frozen=True, eq=False)
class Twin:
    """An identified machine.

    Attributes:
        machine: what was believed.
        effects: the effects with the shapes that were found.
        theta: their linear coefficients, in the order of the effects, shape (p,).
        covariance: of ``theta``, shape (p, p); zero rows for what the data leave open.
        parameters: the table of all parameters.
        pi: standard inertial parameters with ``P pi = beta``; physically consistent unless
            ``quality["consistency"]`` says otherwise.
        loops: closed loop of each axis that has one (black box).
        controllers: controller of each axis whose command was logged (grey box).
        servos: controller of each axis in continuous time, as it is coupled to the plant.
        diagonal: constant inertia, viscous and stiffness terms that the loops were identified with,
            each of shape (nv,); see :mod:`pinotwin.analysis.disturbance`.
        quality: how good the fit is: errors per axis, whiteness, condition, held-out errors.
        data: fingerprints of the logs that were used.
        settings: how they were prepared.
        groups: parameters that these data cannot tell apart.
        misfit: what it leaves of its own logs when it does not know them; None for a twin without logs.
    """

    machine: Machine
    effects: tuple[Effect, ...]
    theta: Floats
    covariance: Floats
    parameters: tuple[Parameter, ...]
    pi: Floats
    loops: Mapping[str, LoopModel] = field(default_factory=dict)
    controllers: Mapping[str, Controller] = field(default_factory=dict)
    servos: Mapping[str, Servo] = field(default_factory=dict)
    diagonal: Mapping[str, Floats] = field(default_factory=dict)
    quality: Mapping[str, Any] = field(default_factory=dict)
    data: Sequence[Mapping[str, Any]] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    groups: Sequence[Sequence[str]] = ()
    misfit: Misfit | None = None

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Key of every effect: ``rigid_body`` or ``<axis>.<name>``, numbered when repeated."""
        return effect_keys(self.effects)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Where each effect's coefficients are in ``theta``."""
        return effect_slices(self.effects)

    @cached_property
    def model(self) -> pin.Model:
        """Pinocchio model with the identified inertias and rotor inertias."""
        return with_parameters(self.machine.model, self.pi)

    def coefficients(self, key: str) -> Floats:
        """Return the coefficients of one effect, e.g. ``twin.coefficients("Y.coulomb")``.

        Raises:
            TwinError: it has no such effect.
        """
        if key not in self.keys:
            raise TwinError(f"{self.machine.name}: no effect {key!r}; {nearest(key, self.keys)}")
        return self.theta[self.slices[self.keys.index(key)]]

    def parameter(self, name: str) -> Parameter:
        """Return one row of the parameter table by its full name.

        Raises:
            TwinError: there is none of that name.
        """
        for row in self.parameters:
            if row.name == name:
                return row
        names = [row.name for row in self.parameters]
        raise TwinError(f"{self.machine.name}: no parameter {name!r}; {nearest(name, names)}")

    def scene(self, motion: Motion) -> Motion:
        """Return a motion with this twin's own effort along it, if any of its effects scales with it."""
        return with_model(motion, self.effects, self.theta)

    def parts(self, motion: Motion) -> dict[str, Floats]:
        """Return the effort of each effect, key -> (n, nv) [N or N·m]."""
        nv = self.machine.nv
        motion = self.scene(motion)
        return {
            key: effect.columns(motion).effort(self.theta[s], nv)
            for key, effect, s in zip(self.keys, self.effects, self.slices, strict=True)
        }

    def effort(self, motion: Motion) -> Floats:
        """Return the motor effort that this motion takes, shape (n, nv) [N or N·m]."""
        total = np.zeros((len(motion), self.machine.nv))
        for part in self.parts(motion).values():
            total += part
        if motion.external is not None:
            total -= motion.external
        return total

    def motion(self, log: LogLike) -> Motion:
        """Return a log of this machine prepared as the ones the twin was identified from."""
        from pinotwin.logs.prepare import prepare

        return prepare(self.machine, log, **self.settings)

    def simulate(self, log: LogLike, **options: Any) -> Log:
        """Return position, error and effort that the command of a log will produce.

        Nothing measured is used; see :func:`pinotwin.simulation.simulate` for the options.
        """
        from pinotwin.simulation import simulate

        return simulate(self, log, **options)

    def __repr__(self) -> str:
        return plain_card(*self._shown())

    def _repr_html_(self) -> str:
        return card(*self._shown())

    def _shown(self) -> Shown:
        """Return title, columns, rows and a note for a notebook and for ``repr``."""
        rows = []
        for name in self.machine.names:
            own = [e.title for e in self.effects if e.axis == name]
            judged = self.quality.get("axes", {}).get(name, {}).get("held_out", {}).get("nrmse")
            error = "" if judged is None else f"{judged:.1%}"
            rows.append((name, ", ".join(own), error, "yes" if name in self.loops else ""))
        columns = ("axis", "effects", "effort error, held out", "closed loop")
        note = f"{len(self.theta)} coefficients from {len(self.data)} log(s)"
        return (f"Twin of {self.machine.name}", columns, rows, note)

    def save(self, folder: str | Path) -> Path:
        """Write ``twin.json``, ``machine.yaml`` and ``<name>.urdf`` into a folder."""
        from pinotwin.twin.files import save

        return save(self, Path(folder))

    @classmethod
    def load(cls, folder: str | Path) -> Twin:
        """Read a twin from its folder.

        Raises:
            TwinError: the folder holds no twin, or one of another schema.
        """
        from pinotwin.twin.files import load

        return load(Path(folder))


TwinLike = Twin | str | Path
"""A twin, or the folder that `pinotwin identify` wrote."""


def as_twin(given: Any, name: str = "twin") -> Twin:
    """Return a twin as it is, or load it.

    Args:
        given: a twin, or its folder.
        name: of the argument, for the message.

    Raises:
        InputError: it is something else.
        TwinError: the folder holds no twin.
    """
    if isinstance(given, Twin):
        return given
    if isinstance(given, str | Path):
        return Twin.load(given)
    raise InputError(f"{name}: expected a Twin or its folder, not {type(given).__name__}")
