"""Write a twin for other tools: which files there are, and what each leaves out.

The URDF has what was found: inertials, ``<dynamics damping friction>``, resolved mesh paths.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from pinotwin.arrays import Floats
from pinotwin.dynamics.batch import inverse as inverse_dynamics
from pinotwin.errors import InputError, require
from pinotwin.export.inverse import Inverse, c_text, deviation, inverse_of, left_out, numpy_text, sweep
from pinotwin.export.mjcf import mjcf_files
from pinotwin.machine.loading import GRAVITY
from pinotwin.machine.urdf import with_inertias
from pinotwin.notebook import Card, Shown
from pinotwin.simulation.tables import tabulate
from pinotwin.system.writing import as_path, write_bytes
from pinotwin.twin import Twin
from pinotwin.twin.twin import TwinLike, as_twin


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


SUFFIX = {"urdf": ".urdf", "mjcf": ".xml", "numpy": ".py", "c": ".c"}  # format -> suffix of its file


@dataclass(frozen=True, repr=False)
class Export(Card):
    """Files for another tool."""

    format: str  # ``urdf``, ``mjcf``, ``numpy`` or ``c``
    files: dict[str, bytes]  # name -> content
    inverse: Inverse  # the inverse model that they hold
    notes: tuple[str, ...]  # what they leave out, a line each

    def to_dict(self) -> dict[str, Any]:
        """Return what ``pinotwin export --json`` writes."""
        x = self.inverse
        columns = zip(x.names, x.units, x.error, x.travel.T, x.speed, strict=True)
        return {
            "machine": x.name,
            "format": self.format,
            "files": list(self.files),
            "left_out": list(self.notes),
            "axes": {
                name: {"unit": unit, "error": error, "range": travel, "speed": speed}
                for name, unit, error, travel, speed in columns
            },
        }

    def _shown(self) -> Shown:
        rows = [(name, f"{len(content)} bytes") for name, content in self.files.items()]
        return (f"Export as {self.format}", ("file", "size"), rows, "; ".join(self.notes))


def export_twin(
    twin: TwinLike, format: str, out: str | Path, *, travel: Floats | None = None, speed: Floats | None = None
) -> Export:
    """Write a twin for other tools and return what was written.

    Args:
        twin: what was found, or its folder.
        format: ``urdf`` (``<dynamics>`` with damping and friction), ``mjcf`` (MuJoCo, with a Python
            passive-force function beside it), ``numpy`` or ``c`` (the inverse model in one file).
        out: the file.
        travel: positions that curves shall cover [m or rad], shape (2, nv); the URDF's limits where None.
        speed: largest speeds to cover [m/s or rad/s], shape (nv,); the URDF's limits where None.

    Raises:
        InputError: there is no such format, or the name has another format's suffix.
    """
    path, twin = as_path(out, "out"), as_twin(twin)
    require(format, SUFFIX, "--format: no format", InputError)
    if path.suffix != SUFFIX[format]:
        raise InputError(f"--out: {path.name}: a file of format {format} is named *{SUFFIX[format]}")
    inverse = inverse_of(twin, travel, speed)
    if format == "urdf":
        files, notes = {path.name: urdf_text(twin)}, urdf_lines(twin, inverse)
    elif format == "mjcf":
        files, notes = mjcf_files(twin, inverse, path.stem)
    else:
        text = numpy_text if format == "numpy" else c_text
        files, notes = {path.name: text(inverse, path.stem).encode()}, []
    for name, content in files.items():
        write_bytes(path.parent / name, content)
    return Export(format, files, inverse, tuple(dict.fromkeys([*left_out(inverse), *notes])))
