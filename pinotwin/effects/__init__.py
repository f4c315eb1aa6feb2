"""The effects that pinotwin knows, one family a file, and the table of their YAML names."""

from __future__ import annotations

from pinotwin.effects.coupling import WristCoupling
from pinotwin.effects.effect import AxisEffect, Coefficient, Columns, Effect, Shape
from pinotwin.effects.friction import (
    Coulomb,
    CoulombAsymmetric,
    QuadraticDrag,
    Stribeck,
    Viscous,
    ViscousAsymmetric,
)
from pinotwin.effects.position import Offset, PositionTable, Ripple, RippleModulated
from pinotwin.effects.presliding import Presliding
from pinotwin.effects.rigid_body import RigidBody
from pinotwin.effects.spring import Spring

EFFECTS: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        Viscous,
        ViscousAsymmetric,
        Coulomb,
        CoulombAsymmetric,
        Stribeck,
        Presliding,
        QuadraticDrag,
        Offset,
        Ripple,
        RippleModulated,
        PositionTable,
        Spring,
        WristCoupling,
    )
}
"""YAML name -> effect of an axis. ``rigid_body`` needs no listing: every machine has it."""

__all__ = [
    "EFFECTS",
    "AxisEffect",
    "Coefficient",
    "Columns",
    "Coulomb",
    "CoulombAsymmetric",
    "Effect",
    "Offset",
    "PositionTable",
    "Presliding",
    "QuadraticDrag",
    "RigidBody",
    "Ripple",
    "RippleModulated",
    "Shape",
    "Spring",
    "Stribeck",
    "Viscous",
    "ViscousAsymmetric",
    "WristCoupling",
]
