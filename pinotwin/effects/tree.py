"""The tree that an effect belongs to: what an effect that needs more than one axis asks a machine for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin

from pinotwin.errors import MachineError, require

TURN = 2.0 * np.pi  # A whole turn [rad]


class HasTree(Protocol):
    """What a machine is for an effect."""

    @property
    def model(self) -> pin.Model:
        """Pinocchio model."""

    @property
    def names(self) -> tuple[str, ...]:
        """Axis or passive name of every velocity."""

    @property
    def rotary(self) -> tuple[bool, ...]:
        """Whether each is a rotation."""


@dataclass(frozen=True, eq=False)
class Tree:
    """A model with the names of its axes; a machine gives its own, a twin that with its inertias."""

    model: pin.Model  # Pinocchio model, one velocity a joint
    names: tuple[str, ...]  # axis or passive name of every velocity
    rotary: tuple[bool, ...]  # whether each is a rotation

    @classmethod
    def of(cls, machine: HasTree) -> Tree:
        """Return the tree of a machine (or of another tree)."""
        return cls(machine.model, tuple(machine.names), tuple(machine.rotary))

    def index(self, axis: str) -> int:
        """Return the velocity of an axis, or MachineError with the axes that there are."""
        require(axis, self.names, f"{self.model.name}: no axis", MachineError)
        return self.names.index(axis)

    def joint(self, axis: str) -> int:
        """Return the joint id of an axis in the model."""
        k = self.index(axis)
        return next(j for j in range(1, self.model.njoints) if self.model.idx_vs[j] == k)

    def endless(self, axis: str, beyond: float = 1e6) -> bool:
        """Whether an axis is a rotation without stops, its travel ``beyond`` [rad]: its position repeats every turn."""
        k = self.index(axis)
        span = float(self.model.upperPositionLimit[k]) - float(self.model.lowerPositionLimit[k])
        return bool(self.rotary[k] and span > beyond)

    def apart(self, a: str, b: str) -> int | None:
        """Return how many joints one axis is further out than another that carries it; None if neither does."""
        inner, outer = sorted((self.joint(a), self.joint(b)))
        path = list(self.model.supports[outer])
        return len(path) - 1 - path.index(inner) if inner in path else None
