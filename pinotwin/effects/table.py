"""The table of the built-in effects; :mod:`pinotwin.effects.known` adds those of users."""

from __future__ import annotations

from pinotwin.effects.coupling import WristCoupling
from pinotwin.effects.effect import Effect
from pinotwin.effects.friction import (
    Coulomb,
    CoulombAsymmetric,
    LoadFriction,
    QuadraticDrag,
    Stribeck,
    Viscous,
    ViscousAsymmetric,
    ViscousThermal,
)
from pinotwin.effects.hysteresis import Hysteresis
from pinotwin.effects.load import ExternalForce, GeometricError, InertialCoupling, Payload
from pinotwin.effects.position import Offset, PositionTable, Ripple, RippleModulated
from pinotwin.effects.presliding import Presliding
from pinotwin.effects.rigid_body import RigidBody
from pinotwin.effects.sensing import Delay, EffortScale, EncoderError
from pinotwin.effects.servo import Feedforward, LoopGain, Saturation
from pinotwin.effects.spring import Spring
from pinotwin.effects.transmission import Backlash, DriveFlexibility, JointFlexibility

EFFECTS: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        RigidBody,
        Viscous,
        ViscousAsymmetric,
        Coulomb,
        CoulombAsymmetric,
        Stribeck,
        Presliding,
        LoadFriction,
        ViscousThermal,
        QuadraticDrag,
        Hysteresis,
        Offset,
        Ripple,
        RippleModulated,
        PositionTable,
        Spring,
        InertialCoupling,
        WristCoupling,
        DriveFlexibility,
        JointFlexibility,
        Backlash,
        Delay,
        EffortScale,
        EncoderError,
        Payload,
        ExternalForce,
        GeometricError,
        Feedforward,
        LoopGain,
        Saturation,
    )
}
"""Name -> effect. ``LISTED`` has those that machine.yaml may list under an axis."""

LISTED: tuple[str, ...] = tuple(name for name, effect in EFFECTS.items() if not effect.unlisted)
"""Names that an axis may list in machine.yaml."""
