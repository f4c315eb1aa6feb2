"""The posture of a machine: axis name -> position, and its place in Pinocchio's configuration.

A posture names only the axes that differ from zero; on the command line it is written
``Y=0.1,A=30deg``. A bare number is SI (m or rad).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.errors import InputError, nearest
from pinotwin.units import SI_FACTOR

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_LENGTHS = ("m", "mm", "um", "µm", "nm", "inch", "in")
_ANGLES = ("rad", "mrad", "urad", "deg", "°", "mdeg", "arcmin", "arcsec", "rev", "turn")


def joint_kinds(model: pin.Model) -> dict[str, bool]:
    """Return joint name -> whether it turns (True) or slides (False), in the model's order.

    Joints that are neither (free flyers, mimic joints) are left out.
    """
    kinds = {}
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        kind = joint.shortname()
        if joint.nv == 1 and ("JointModelR" in kind or "JointModelP" in kind):
            kinds[name] = "JointModelR" in kind
    return kinds


def parse_posture(text: str, rotary: Mapping[str, bool]) -> dict[str, float]:
    """Return the posture that a text like ``Y=0.1,A=30deg`` means, in m and rad.

    Args:
        text: ``axis=value`` pairs between commas; the value may carry a unit of its kind.
        rotary: the axes that exist, and whether each turns.

    Raises:
        InputError: an axis, a number or a unit is not understood; the message says which.
    """
    posture: dict[str, float] = {}
    for item in filter(None, (part.strip() for part in text.split(","))):
        axis, equals, value = (word.strip() for word in item.partition("="))
        if not equals:
            raise InputError(f"posture: expected axis=value, found {item!r}, e.g. Y=0.1,A=30deg")
        if axis not in rotary:
            raise InputError(f"posture: no axis {axis!r}; {nearest(axis, rotary)}")
        if axis in posture:
            raise InputError(f"posture: axis {axis!r} is given twice")
        posture[axis] = _position(axis, value, rotary[axis])
    return posture


def _position(axis: str, value: str, turns: bool) -> float:
    """Return the position [m or rad] that the text of one value means."""
    found = _NUMBER.match(value)
    if found is None:
        raise InputError(f"posture: {value!r} of axis {axis!r} is not a number")
    unit = value[found.end() :].strip() or ("rad" if turns else "m")
    known = _ANGLES if turns else _LENGTHS
    if unit not in known:
        moves = "turns" if turns else "slides"
        hint = nearest(unit, known)
        raise InputError(f"posture: unit {unit!r} does not fit axis {axis!r}, which {moves}; {hint}")
    return float(found[0]) * SI_FACTOR[unit]


def configuration(model: pin.Model, posture: Mapping[str, float] | None = None) -> Floats:
    """Return Pinocchio's configuration of a posture, shape (nq,).

    Joints that the posture does not name stay at zero. A continuous joint takes cosine and sine.

    Raises:
        InputError: the posture names a joint that the model does not have.
    """
    q = pin.neutral(model)
    kinds = joint_kinds(model)
    for name, x in (posture or {}).items():
        if name not in kinds:
            raise InputError(f"posture: no axis {name!r}; {nearest(name, kinds)}")
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q : joint.idx_q + joint.nq] = [x] if joint.nq == 1 else [math.cos(x), math.sin(x)]
    return np.asarray(q, dtype=float)
