"""The effects that pinotwin knows, one family a file, and the table of their names, ``EFFECTS``.

How an effect is written and used: :mod:`pinotwin.effects.effect`.
"""

from __future__ import annotations

from pinotwin.effects.effect import AxisEffect as AxisEffect
from pinotwin.effects.effect import Coefficient as Coefficient
from pinotwin.effects.effect import Columns as Columns
from pinotwin.effects.effect import Effect as Effect
from pinotwin.effects.effect import Shape as Shape
from pinotwin.effects.family import FAMILIES as FAMILIES
from pinotwin.effects.family import Family as Family
from pinotwin.effects.friction import Coulomb as Coulomb
from pinotwin.effects.friction import CoulombAsymmetric as CoulombAsymmetric
from pinotwin.effects.friction import Stribeck as Stribeck
from pinotwin.effects.friction import Viscous as Viscous
from pinotwin.effects.friction import ViscousAsymmetric as ViscousAsymmetric
from pinotwin.effects.known import EFFECTS as EFFECTS
from pinotwin.effects.known import LISTED as LISTED
from pinotwin.effects.known import check_effect as check_effect
from pinotwin.effects.known import effect_name as effect_name
from pinotwin.effects.known import given as given
from pinotwin.effects.known import known as known
from pinotwin.effects.position import Offset as Offset
from pinotwin.effects.position import PositionTable as PositionTable
from pinotwin.effects.position import Spring as Spring
from pinotwin.effects.presliding import Presliding as Presliding
from pinotwin.effects.rigid_body import InertialCoupling as InertialCoupling
from pinotwin.effects.rigid_body import RigidBody as RigidBody
from pinotwin.effects.ripple import Ripple as Ripple
from pinotwin.effects.ripple import RippleModulated as RippleModulated
from pinotwin.effects.scene import needs_model as needs_model
from pinotwin.effects.scene import total_effort as total_effort
from pinotwin.effects.scene import with_model as with_model
from pinotwin.effects.scene import with_model_effort as with_model_effort
from pinotwin.effects.transmission import JointFlexibility as JointFlexibility
from pinotwin.effects.tree import Tree as Tree
