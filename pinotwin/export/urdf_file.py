"""The URDF with what was found: inertials, ``<dynamics damping friction>``, resolved mesh paths."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from lxml import etree

from pinotwin.arrays import Floats
from pinotwin.dynamics.batch import inverse as inverse_dynamics
from pinotwin.export.inverse import Inverse, deviation, sweep
from pinotwin.machine.loading import GRAVITY
from pinotwin.machine.urdf import with_inertias
from pinotwin.simulation.tables import tabulate
from pinotwin.twin import Twin


def urdf_text(twin: Twin) -> bytes:
    """Return the text of the URDF; comments and foreign tags of the original stay."""
    machine = twin.machine
    root = etree.fromstring(with_inertias(machine.urdf, twin.model))
    friction, damping = dry_friction(twin.model), twin.model.damping
    for part in machine.parts:
        joint = root.find(f"joint[@name='{part.joint}']")
        if joint is None:
            continue
        dynamics = joint.find("dynamics")
        if dynamics is None:
            dynamics = etree.SubElement(joint, "dynamics")
            dynamics.tail = joint[0].tail
        dynamics.set("damping", f"{damping[part.index]:.10g}")
        dynamics.set("friction", f"{friction[part.index]:.10g}")
    return etree.tostring(root, xml_declaration=True, encoding="utf-8", pretty_print=True)


def dry_friction(model: pin.Model) -> Floats:
    """Return the dry friction of every joint, both directions' mean, shape (nv,) [N or N·m]."""
    return np.asarray(0.5 * (model.upperDryFrictionLimit - model.lowerDryFrictionLimit))


def urdf_lines(twin: Twin, inverse: Inverse) -> list[str]:
    """Return what a URDF cannot hold, and how much of the effort that is."""
    rotors = [part.name for part in twin.machine.parts if twin.model.armature[part.index] != 0.0]
    lost = [f"rotor inertia of {' '.join(rotors)}"] if rotors else []
    pull = twin.model.gravity.linear.tolist()
    lost += [] if tuple(pull) == GRAVITY else [f"gravity {pull} m/s²"]
    lost += _effects(twin, inverse)
    missed = missed_share(twin, inverse)
    shares = ", ".join(f"{name} {share:.0%}" for name, share in zip(inverse.names, missed, strict=True))
    lines = [f"a URDF has no place for: {', '.join(lost)}"] if lost else []
    return [*lines, f"share of the twin's effort that it misses (RMS, a motion through the range): {shares}"]


def _effects(twin: Twin, inverse: Inverse) -> list[str]:
    """Return the keys of effects that damping and constant friction do not hold, or hold in part."""
    out = []
    for key, pair in zip(twin.keys, twin.pairs, strict=True):
        effect = pair[0]
        if effect.axis is None or effect.causes[0] == "viscous":
            continue
        if effect.depends == "direction":
            tables = tabulate(twin.machine, [pair], inverse.travel, inverse.speed).lookup
            spread = np.ptp(np.abs(tables.dry))
            out += [f"{key} (its level at speed is kept)"] if spread > 1e-9 * np.abs(tables.dry).max() else []
        elif effect.depends == "displacement":
            out.append(f"{key} (its level at speed is kept)")
        else:
            out.append(key)
    return out


def missed_share(twin: Twin, inverse: Inverse) -> Floats:
    """Return RMS(URDF - twin) / RMS(twin) of every joint's effort on the sweep, shape (nv,)."""
    motion = sweep(twin.machine, inverse.travel, inverse.speed)
    model = twin.model.copy()
    model.armature = np.zeros(model.nv)
    found = inverse_dynamics(model, motion.q, motion.v, motion.a)
    found = found + model.damping * motion.v + dry_friction(model) * np.sign(motion.v)
    return deviation(twin, found, motion)
