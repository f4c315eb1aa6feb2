"""Write the machine with the effects that were found added to it."""

from __future__ import annotations

import copy
import dataclasses

from pinotwin.diagnosis.payload import found_body, loaded
from pinotwin.diagnosis.result import Diagnosis, Found
from pinotwin.effects import known
from pinotwin.errors import DataError
from pinotwin.machine import Machine
from pinotwin.machine.from_model import with_bodies
from pinotwin.twin import Twin

SAME = 0.03  # Share by which two pitches may differ and be one ripple whose size has changed


def repaired(diagnosis: Diagnosis) -> Machine:
    """Return the machine with the named causes added; DataError where the diagnosis does not know its machine.

    A payload whose body is told goes into the inertia of its link: of a twin, beside the inertias identified.
    """
    machine = extended(diagnosis)
    told = [e for e in diagnosis.effects if e.effect == "payload" and "m" in e.theta]
    bodies = [e for e in told if e.axis in machine.axes]
    if not bodies:
        return machine
    model = diagnosis.subject.model if isinstance(diagnosis.subject, Twin) else machine.model
    for found in bodies:
        model = loaded(model, machine.axis(str(found.axis)).joint, found_body(found.theta))
    return with_bodies(machine, model)


def extended(diagnosis: Diagnosis) -> Machine:
    """Return the machine with the named effects, as far as its files can say them; DataError without a machine."""
    subject = diagnosis.subject
    machine = subject.machine if isinstance(subject, Twin) else subject
    if not isinstance(machine, Machine):
        raise DataError("this diagnosis does not hold its machine; diagnose again")
    for found in diagnosis.effects:
        if found.axis in machine.passive:
            machine = _sprung(machine, found)
        if found.axis in machine.axes:
            machine = _with(machine, found)
    return machine


def _sprung(machine: Machine, found: Found) -> Machine:
    """Return the machine with the stiffness and damping that were found of a passive joint."""
    name, k, c = str(found.axis), found.theta["k"], found.theta["c"]
    spec = copy.deepcopy(dict(machine.spec))
    spec["passive"][name] |= {"stiffness": k, "damping": c}
    part = dataclasses.replace(machine.passive[name], stiffness=k, damping=c)
    return dataclasses.replace(machine, spec=spec, passive={**machine.passive, name: part})


def _with(machine: Machine, found: Found) -> Machine:
    """Return the machine with one effect added to its axis; the machine itself where a file cannot say it."""
    name = str(found.axis)
    axis = machine.axis(name)
    if found.effect == "saturation":
        limited = dataclasses.replace(axis, effort_limit=abs(float(found.shape["limit"])))
        return dataclasses.replace(machine, axes={**machine.axes, name: limited})
    kind = known(machine.effects).get(found.effect) if found.listed is None else type(found.listed)
    if kind is None or kind.unlisted:
        return machine
    if found.effect == "encoder_error" and "ql" in found.shrink:
        return machine  # a table between two encoders: machine.yaml corrects no position by it
    effect = found.listed
    if effect is None:
        effect = kind.on(machine, name)
        own = {s.name for s in effect.shapes()}
        effect = dataclasses.replace(effect, **{k: v for k, v in found.shape.items() if k in own})  # type: ignore[type-var]
    effect = effect.settled()
    same, shape = [e for e in axis.effects if e.name == effect.name], found.shape.items()
    if any(not e.several or all(abs(getattr(e, k) - x) <= SAME * abs(x) for k, x in shape) for e in same):
        return machine
    kept = [e for e in axis.effects if e.name not in effect.contains or e.several]
    return machine.with_effects(name, (*kept, effect))
