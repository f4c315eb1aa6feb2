"""A machine wherever one is asked for: an object, or what :meth:`Machine.load` reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pinotwin.errors import InputError
from pinotwin.machine.machine import Machine

MachineLike = Machine | str | Path
"""A machine, its folder, machine.yaml or URDF, or the name of a bundled one."""


def as_machine(given: Any, name: str = "machine") -> Machine:
    """Return a machine as it is, or load it.

    Args:
        given: a machine, or what :meth:`Machine.load` takes.
        name: of the argument, for the message.

    Raises:
        InputError: it is something else.
        MachineError: it cannot be loaded.
    """
    if isinstance(given, Machine):
        return given
    if isinstance(given, str | Path):
        return Machine.load(given)
    raise InputError(
        f"{name}: expected a Machine, its folder, a URDF or a bundled name, not {type(given).__name__}"
    )
