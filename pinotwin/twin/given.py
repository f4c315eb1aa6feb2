"""A twin wherever one is asked for: an object or its folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pinotwin.errors import InputError
from pinotwin.twin.twin import Twin

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
