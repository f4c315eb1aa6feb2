"""What the functions of this package need: a model with one coordinate per velocity, whole logs."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.errors import DataError, MachineError


def require_simple(model: pin.Model) -> None:
    """Refuse a model with a joint whose coordinates are not as many as its velocities (nq != nv)."""
    mimics = [n for n, j in zip(model.names, model.joints, strict=True) if "Mimic" in j.shortname()]
    if mimics:
        raise MachineError(
            f"machine {model.name!r}: mimic joints {mimics} are not supported; load the URDF with "
            "mimic=False and describe the coupling in machine.yaml"
        )
    if model.nq != model.nv:
        odd = [n for n, j in zip(model.names, model.joints, strict=True) if j.nq != j.nv]
        raise MachineError(
            f"machine {model.name!r}: joints {odd} have nq != nv; rewrite 'continuous' as "
            "'revolute' with wide limits, and lock or remove floating, planar and spherical joints"
        )


def as_log(model: pin.Model, **arrays: Floats) -> list[Floats]:
    """Return arrays of shape (n, nv), all of one n, as C-contiguous floats; others are refused by their name."""
    require_simple(model)
    out: list[Floats] = []
    for name, values in arrays.items():
        x = np.ascontiguousarray(values, dtype=float)
        if x.ndim != 2 or x.shape[1] != model.nv:
            raise DataError(
                f"{name} has shape {x.shape}, expected (n, {model.nv}): one row per sample, one "
                f"column per joint of {model.name!r}"
            )
        if out and len(x) != len(out[0]):
            first = next(iter(arrays))
            raise DataError(f"{name} has {len(x)} rows but {first} has {len(out[0])}")
        out.append(x)
    return out


def require_depth_first(model: pin.Model) -> None:
    """Refuse joints out of depth-first order: ``pin.crba`` would be wrong without a word."""
    for i in range(2, model.njoints):
        above = i - 1
        while above > model.parents[i]:
            above = model.parents[above]
        if above != model.parents[i]:
            raise MachineError(
                f"machine {model.name!r}: joint {model.names[i]!r} is not in depth-first order; "
                "add the joints branch by branch, or load the machine from a URDF"
            )
