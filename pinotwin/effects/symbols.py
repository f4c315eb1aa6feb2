"""Unit symbols of an axis: N and m for a linear one, N·m and rad for a rotary one."""

from __future__ import annotations


def effort(rotary: bool) -> str:
    """Return the unit of effort."""
    return "N·m" if rotary else "N"


def length(rotary: bool) -> str:
    """Return the unit of position."""
    return "rad" if rotary else "m"


def inertia(rotary: bool) -> str:
    """Return the unit of inertia."""
    return "kg·m²" if rotary else "kg"
