"""A machine wherever one is asked for: an object, a ``pin.Model``, or what :meth:`Machine.load` reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pinocchio as pin

from pinotwin.errors import InputError
from pinotwin.machine.machine import Machine

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
