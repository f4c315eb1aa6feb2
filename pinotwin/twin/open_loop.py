"""The plant in numbers: what turns a motion into the efforts of the motors, before any loop is closed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import with_parameters
from pinotwin.effects import Effect
from pinotwin.effects.layout import effect_keys, effect_slices, rigid_body_of
from pinotwin.effects.scene import blocks, with_model
from pinotwin.errors import InputError, TwinError, require
from pinotwin.machine import Machine
from pinotwin.motion import Motion
from pinotwin.twin.parameters import Parameter, Parameters


@dataclass(frozen=True, eq=False, repr=False)
class OpenLoop:
    """An identified plant: ``effort = sum over effects of columns(motion) @ theta``."""

    machine: Machine  # what was believed
    effects: tuple[Effect, ...]  # the effects with the shapes that were found
    theta: Floats  # their linear coefficients, in the order of the effects, shape (p,)
    covariance: Floats  # of ``theta``, shape (p, p); zero rows for what the data leave open
    parameters: Parameters  # all parameters, in order and by full name
    pi: Floats  # standard inertial parameters with ``P pi = beta``, of bodies that can exist where ``bodies`` has a row
    # constant inertia, viscous and stiffness terms that the loops are identified with, each of shape (nv,); see
    # :mod:`pinotwin.analysis.disturbance`.
    diagonal: Mapping[str, Floats] = field(default_factory=dict)
    # per joint its body's ``mass`` and that of the ``urdf`` [kg], ``share`` d log m / d log m_URDF (0: the log's, 1:
    # the URDF's), ``source`` (``log``, ``URDF``, ``rod`` for dummies) and ``interval95`` or None
    bodies: tuple[Mapping[str, Any], ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", Parameters(self.parameters))

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Key of every effect: ``rigid_body`` or ``<axis>.<name>``, numbered when repeated."""
        return effect_keys(self.effects)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Where each effect's coefficients are in ``theta``."""
        return effect_slices(self.effects)

    @cached_property
    def pairs(self) -> tuple[tuple[Effect, Floats], ...]:
        """Every effect with its coefficients."""
        return tuple((e, self.theta[s]) for e, s in zip(self.effects, self.slices, strict=True))

    @cached_property
    def model(self) -> pin.Model:
        """Pinocchio model with the identified inertias, rotor inertias (``armature``), ``damping`` and dry friction.

        ``friction`` (``upperDryFrictionLimit``) and ``lowerDryFrictionLimit`` are the level at speed, both ways apart.
        Pinocchio's ``rnea`` and ``aba`` know the armature alone: what all friction takes is in :meth:`effort`.
        """
        model = with_parameters(self.machine.model, self.pi)
        nv = self.machine.nv
        damping, level = np.zeros(nv), {way: np.zeros(nv) for way in (1.0, -1.0)}
        for effect, theta in self.pairs:
            viscous = [cause == "viscous" for cause in effect.causes]
            if effect.axis is not None and any(viscous):
                damping[self.machine.names.index(effect.axis)] += float(np.sum(theta * viscous))
            elif effect.depends in ("direction", "displacement"):
                for way, total in level.items():
                    total += effect.along(_sliding(self.machine, way), theta)[-1]
        model.damping = np.maximum(damping, 0.0)
        model.upperDryFrictionLimit = np.maximum(level[1.0], 0.0)
        model.lowerDryFrictionLimit = np.minimum(level[-1.0], 0.0)
        return model

    def coefficients(self, key: str) -> Floats:
        """Return the coefficients of one effect, e.g. ``twin.coefficients("Y.coulomb")``; TwinError without it."""
        require(key, self.keys, f"{self.machine.name}: no effect", TwinError)
        return self.theta[self.slices[self.keys.index(key)]]

    def parameter(self, name: str) -> Parameter:
        """Return one row of the parameter table by its full name, or a TwinError."""
        return self.parameters[name]

    def scene(self, motion: Motion) -> Motion:
        """Return a motion, or an InputError, with this plant's own effort along it, if any effect scales with it."""
        if not isinstance(motion, Motion):
            raise InputError(f"motion: expected twin.motion(log), a Motion, not {type(motion).__name__}")
        return with_model(motion, self.effects, self.theta)

    def parts(self, motion: Motion) -> dict[str, Floats]:
        """Return the effort of each effect, key -> (n, nv) [N or N·m]."""
        motion = self.scene(motion)
        return {key: e.along(motion, x) for key, (e, x) in zip(self.keys, self.pairs, strict=True)}

    def rigid_effort(self, q: Floats, v: Floats, a: Floats) -> Floats:
        """Return the effort of the tree along positions, velocities and accelerations, all (n, nv)."""
        tree, where = rigid_body_of(self.effects)
        return tree.effort(self.theta[where], q, v, a)

    def effort(self, motion: Motion) -> Floats:
        """Return the motor effort that this motion takes, shape (n, nv) [N or N·m]."""
        total = sum(self.parts(motion).values(), np.zeros((len(motion), self.machine.nv)))
        return total if motion.external is None else total - motion.external

    def effort_error(self, motion: Motion) -> Floats:
        """Return the standard error of :meth:`effort` from that of the coefficients, shape (n, nv) [N or N·m].

        It says where a motion asks for what the logs of the identification did not tell: places that they hardly
        visited, inertias that they did not move. What the model itself lacks is not in it.
        """
        out = np.zeros((len(motion), self.machine.nv))
        for rows, j, X, C in self._acting(motion):
            own = np.flatnonzero(X.any(axis=0))  # few of a table's
            X = X[:, own]
            out[rows, j] = np.sqrt(np.maximum(np.einsum("np,np->n", X @ C[np.ix_(own, own)], X), 0.0))
        return out

    def effort_errors(self, motion: Motion, most: int = 24) -> Floats:
        """Return what :meth:`effort` may be off by as independent efforts of one sigma, (n, nv, most) [N or N·m].

        They are the largest of all combinations of the coefficients; their squares sum up to that of the whole error.
        """
        out = np.zeros((len(motion), self.machine.nv, most))
        grams: dict[int, Floats] = {}
        for _, j, X, _ in self._acting(motion):
            grams[j] = grams.get(j, 0.0) + X.T @ X
        for rows, j, X, C in self._acting(motion):
            variance, axes = np.linalg.eigh(np.nan_to_num(C, posinf=0.0))
            S = axes * np.sqrt(np.maximum(variance, 0.0))
            largest = np.linalg.eigh(S.T @ grams[j] @ S)[1][:, ::-1][:, :most]
            out[rows, j, : largest.shape[1]] = X @ (S @ largest)
        return out

    def _acting(self, motion: Motion) -> Iterator[tuple[slice, int, Floats, Floats]]:
        """Yield blocks of rows, and each joint, the columns that act on it, (n, p), and their covariance, (p, p)."""
        motion = self.scene(motion)
        whole = [None if effect.pointwise else effect.columns(motion) for effect in self.effects]
        for rows, formed in blocks(motion, self.effects, whole, np.arange(len(motion))):
            for j in range(self.machine.nv):
                acting = [(c, s) for c, s in zip(formed, self.slices, strict=True) if j in c.joints]
                at = np.r_[*(s for _, s in acting)]
                X = np.hstack([c.values[:, c.joints.index(j)] for c, _ in acting])
                yield rows, j, X, self.covariance[np.ix_(at, at)]


def _sliding(machine: Machine, way: float, far: float = 1e6, fast: float = 1e3) -> Motion:
    """Return three samples of all joints sliding one way (1 or -1) so far and fast that no memory of rest is left."""
    q = way * far * np.arange(3.0)[:, None] * np.ones(machine.nv)
    v = np.full_like(q, way * fast)
    return Motion.exact((machine.names, machine.rotary), np.arange(3.0), q, v, np.zeros_like(q))
