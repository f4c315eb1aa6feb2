"""Switch effects of the truth off (withhold) and on (inject), by the names of the catalogue.

A request is ``"name"``, ``"name:axis"`` or ``"name:axis=size"``, or a mapping with the keys
``effect``, ``axis``, ``size``, ``value``, ``seed``. ``size`` is relative: for an effort it is a
share of the rated effort of the axis (:mod:`pinotwin.virtual.doses`). ``value`` sets the SI
quantity instead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.errors import InputError, nearest
from pinotwin.virtual.defaults import Scale
from pinotwin.virtual.doses import INJECT, INJECT_MACHINE, OUTSIDE, Bodies, Body, Dose
from pinotwin.virtual.truth import Truth
from pinotwin.virtual.withholding import WITHHOLD, WITHHOLD_MACHINE

Request = Mapping[str, object] | str


def parse(request: Request) -> dict[str, object]:
    """Return a request as a mapping with the keys effect, axis, size, value and seed."""
    if isinstance(request, str):
        name, _, size = request.partition("=")
        effect, _, axis = name.partition(":")
        out: dict[str, object] = {"effect": effect.strip()}
        if axis.strip():
            out["axis"] = axis.strip()
        if size:
            try:
                out["size"] = float(size)
            except ValueError:
                raise InputError(f"effect {request!r}: the size must be a number") from None
        return out
    for key in request:
        if key not in ("effect", "axis", "size", "value", "seed"):
            known = "known: axis, effect, seed, size, value"
            raise InputError(f"effect {dict(request)!r}: unknown key {key!r}; {known}")
    return dict(request)


def _axes_of(axis: object, truth: Truth) -> list[str]:
    if axis is None:
        return list(truth.axes)
    if axis not in truth.axes:
        raise InputError(f"no axis {axis!r}; {nearest(str(axis), truth.axes)}")
    return [str(axis)]


def withhold_all(truth: Truth, requests: Sequence[str]) -> Truth:
    """Return the truth without the named effects (on one axis, or on all)."""
    for request in requests:
        item = parse(request)
        name = str(item["effect"])
        if name in WITHHOLD_MACHINE:
            truth = WITHHOLD_MACHINE[name](truth)
        elif name in WITHHOLD:
            axes = dict(truth.axes)
            for axis in _axes_of(item.get("axis"), truth):
                axes[axis] = WITHHOLD[name](axes[axis])
            truth = replace(truth, axes=axes)
        else:
            known = [*WITHHOLD, *WITHHOLD_MACHINE]
            raise InputError(f"cannot withhold {name!r}; {nearest(name, known)}")
    return truth


def inject_all(
    truth: Truth, requests: Sequence[Request], scales: Mapping[str, Scale], bodies: Bodies
) -> Truth:
    """Return the truth with the effects added.

    Args:
        truth: resolved truth.
        requests: what to add.
        scales: reference sizes of the axes.
        bodies: what each axis moves.
    """
    for request in requests:
        item = parse(request)
        name = str(item["effect"])
        known = {**INJECT, **OUTSIDE}
        if name not in known and name not in INJECT_MACHINE:
            raise InputError(f"cannot inject {name!r}; {nearest(name, [*known, *INJECT_MACHINE])}")
        for axis in _axes_of(item.get("axis"), truth):
            dose = _dose(item, axis, scales[axis], bodies[axis])
            if name in INJECT_MACHINE:
                truth = INJECT_MACHINE[name](truth, dose)
            else:
                truth = replace(truth, axes={**truth.axes, axis: known[name](truth.axes[axis], dose)})
    return truth


def _dose(item: Mapping[str, object], axis: str, scale: Scale, body: Body) -> Dose:
    value = item.get("value")
    seed = int(str(item.get("seed", 0)))
    return Dose(
        axis=axis,
        size=float(str(item.get("size", 0.1))),
        value=None if value is None else float(str(value)),
        scale=scale,
        rng=np.random.default_rng([seed, sum(map(ord, axis))]),
        body=body,
    )
