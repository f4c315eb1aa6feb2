"""Switch effects of the truth off (withhold) and on (inject), by the names of the catalogue.

``"name"``, ``"name:axis"``, ``"name:axis=size"``, or a mapping of ``effect``, ``axis``, ``size``, ``value``, ``seed``;
``size`` is relative (:mod:`pinotwin.virtual.amounts`), ``value`` the SI quantity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.errors import InputError, nearest, require
from pinotwin.virtual.amounts import INJECT, INJECT_MACHINE, OUTSIDE, Bodies, Dose
from pinotwin.virtual.defaults import Scale
from pinotwin.virtual.truth import Truth
from pinotwin.virtual.withholding import WITHHOLD, WITHHOLD_MACHINE

Request = Mapping[str, object] | str


def parse(request: Request) -> dict[str, object]:
    """Return a request as a mapping with the keys effect, axis, size, value and seed."""
    if not isinstance(request, str):
        for key in request:
            if key not in ("effect", "axis", "size", "value", "seed"):
                known = "known: axis, effect, seed, size, value"
                raise InputError(f"effect {dict(request)!r}: unknown key {key!r}; {known}")
        return dict(request)
    name, _, size = request.partition("=")
    effect, _, axis = (x.strip() for x in name.partition(":"))
    out: dict[str, object] = {"effect": effect, **({"axis": axis} if axis else {})}
    try:
        return {**out, "size": float(size)} if size else out
    except ValueError:
        raise InputError(f"effect {request!r}: the size must be a number") from None


def _axes_of(axis: object, truth: Truth) -> list[str]:
    if axis is not None and axis not in truth.axes:
        raise InputError(f"no axis {axis!r}; {nearest(str(axis), truth.axes)}")
    return list(truth.axes) if axis is None else [str(axis)]


def withhold_all(truth: Truth, requests: Sequence[str]) -> Truth:
    """Return the truth without the named effects (on one axis, or on all)."""
    for request in requests:
        item = parse(request)
        name = str(item["effect"])
        if name in WITHHOLD_MACHINE:
            truth = WITHHOLD_MACHINE[name](truth)
        elif name in WITHHOLD:
            less = {a: WITHHOLD[name](truth.axes[a]) for a in _axes_of(item.get("axis"), truth)}
            truth = replace(truth, axes={**truth.axes, **less})
        else:
            raise InputError(f"cannot withhold {name!r}; {nearest(name, [*WITHHOLD, *WITHHOLD_MACHINE])}")
    return truth


def inject_all(
    truth: Truth, requests: Sequence[Request], scales: Mapping[str, Scale], bodies: Bodies
) -> Truth:
    """Return the truth with effects added, sized by the scales of the axes and the bodies that they move."""
    known = {**INJECT, **OUTSIDE}
    for request in requests:
        item = parse(request)
        name, value = str(item["effect"]), item.get("value")
        require(name, [*known, *INJECT_MACHINE], "cannot inject", InputError)
        size, si = float(str(item.get("size", 0.1))), None if value is None else float(str(value))
        for axis in _axes_of(item.get("axis"), truth):
            rng = np.random.default_rng([int(str(item.get("seed", 0))), sum(map(ord, axis))])
            dose = Dose(axis, size, si, scales[axis], rng, bodies[axis])
            if name in INJECT_MACHINE:
                truth = INJECT_MACHINE[name](truth, dose)
            else:
                truth = replace(truth, axes={**truth.axes, axis: known[name](truth.axes[axis], dose)})
    return truth
