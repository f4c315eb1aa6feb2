"""Write the machine with the effects that were found added to it."""

from __future__ import annotations

import copy
import dataclasses
from pathlib import Path

from pinotwin.diagnosis.result import Diagnosis, Found
from pinotwin.effects import EFFECTS, Effect
from pinotwin.errors import DataError
from pinotwin.machine import Machine
from pinotwin.twin import Twin


def apply(diagnosis: Diagnosis, folder: Path) -> Path:
    """See :meth:`Diagnosis.apply`."""
    machine = extended(diagnosis)
    return machine.save(folder)


def extended(diagnosis: Diagnosis) -> Machine:
    """Return the machine with the named effects, as far as machine.yaml knows them.

    Raises:
        DataError: the diagnosis does not know its machine.
    """
    subject = diagnosis.subject
    machine = subject.machine if isinstance(subject, Twin) else subject
    if not isinstance(machine, Machine):
        raise DataError("this diagnosis does not hold its machine; diagnose again")
    for found in diagnosis.effects:
        if found.axis in machine.passive:
            machine = _sprung(machine, found)
        if found.axis is None or found.axis not in machine.axes:
            continue
        old = machine.axis(found.axis).effects
        effect = _effect(found, machine)
        if (effect is not None and not any(e.name == effect.name for e in old)) or (
            effect is not None and effect.name == "ripple"
        ):
            machine = machine.with_effects(found.axis, (*old, effect))
    return machine


def _sprung(machine: Machine, found: Found) -> Machine:
    """Return the machine with the stiffness and damping that were found of a passive joint."""
    name, k, c = str(found.axis), found.theta["k"], found.theta["c"]
    spec = copy.deepcopy(dict(machine.spec))
    spec["passive"][name] |= {"stiffness": k, "damping": c}
    part = dataclasses.replace(machine.passive[name], stiffness=k, damping=c)
    return dataclasses.replace(machine, spec=spec, passive={**machine.passive, name: part})


def _effect(found: Found, machine: Machine) -> Effect | None:
    if found.effect not in EFFECTS or found.axis is None:
        return None
    kind = EFFECTS[found.effect]
    known = {f.name for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    shape = {k: v for k, v in found.shape.items() if k in known}
    settings = {"axis": found.axis, "rotary": machine.axis(found.axis).rotary, **shape}
    if found.effect == "wrist_coupling":
        settings["partner"] = machine.names[int(found.shape["with"])]
    if found.effect == "presliding":
        settings["x_s"] = found.shape["distance"]
    return kind(**settings)
