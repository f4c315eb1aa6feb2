"""From a URDF file to the ``pin.Model`` of the joints that matter, and back with other inertias.

Pinocchio makes (cos, sin) of a ``continuous`` joint, where identification needs one number: the XML is rewritten.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from pinotwin.arrays import Floats
from pinotwin.errors import MachineError
from pinotwin.machine.urdf_check import MOVING, read_tree

_WIDE = "1e9"


def _without_turns(root: etree._Element) -> bytes:
    """Return the XML with continuous joints as revolute ones and every limit present."""
    copy = deepcopy(root)
    for joint in copy.findall("joint"):
        if joint.get("type") not in MOVING:
            continue
        limit = joint.find("limit")
        if limit is None:
            limit = etree.SubElement(joint, "limit")
        unlimited = limit.get("lower") is None and limit.get("upper") is None
        if joint.get("type") == "continuous" or unlimited:
            limit.set("lower", "-" + _WIDE)
            limit.set("upper", _WIDE)
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
        for key in ("effort", "velocity"):
            limit.set(key, limit.get(key, _WIDE))
    etree.strip_elements(copy, "visual", "collision", "mimic")
    return etree.tostring(copy)


def load_model(path: Path, joints: Sequence[str]) -> pin.Model:
    """Return the model in which only ``joints``, of one degree of freedom each, move; every other is locked at zero."""
    text = _without_turns(read_tree(path))
    saved = os.dup(2)  # urdfdom writes its warnings straight to the process' standard error
    with open(os.devnull, "w") as sink:
        os.dup2(sink.fileno(), 2)
    try:
        full = pin.buildModelFromXML(text)
    except (ValueError, RuntimeError) as error:
        raise MachineError(f"{path}: Pinocchio cannot build it: {error}") from None
    finally:
        os.dup2(saved, 2)
        os.close(saved)
    locked = [full.getJointId(n) for n in full.names if n != "universe" and n not in joints]
    return pin.buildReducedModel(full, locked, pin.neutral(full)) if locked else full


def idle_joints(model: pin.Model) -> list[str]:
    """Return the joints whose branch has neither inertia nor rotor inertia: they move nothing."""
    data = model.createData()
    q = np.clip(np.full(model.nq, 0.3), model.lowerPositionLimit, model.upperPositionLimit)
    diagonal = np.diag(pin.crba(model, data, q))
    return [str(model.names[j]) for j in range(1, model.njoints) if diagonal[model.idx_vs[j]] <= 1e-12]


def no_urdf_holds(model: pin.Model) -> bool:
    """Whether a fit found what no URDF is read with: a negative mass, or a joint that moves no inertia."""
    return any(body.mass < 0.0 for body in model.inertias) or bool(idle_joints(model))


def impossible_bodies(model: pin.Model) -> dict[str, str]:
    """Return the joints that move a body which cannot exist, with all that is fixed to it, and why; 1 % is rounding."""
    out = {}
    for joint in range(1, model.njoints):
        inertia = model.inertias[joint]
        low, middle, high = np.linalg.eigvalsh(inertia.inertia)
        slack = 0.01 * abs(high) + 1e-12
        told = f"principal moments {low:.3g}, {middle:.3g}, {high:.3g} kg·m²"
        if inertia.mass <= 0.0 < high - slack:
            out[str(model.names[joint])] = f"{told} without mass"
        elif low < -slack:
            out[str(model.names[joint])] = f"{told}: one is negative"
        elif low + middle < high - slack:
            out[str(model.names[joint])] = f"{told} break the triangle inequality"
    return out


def resolve_meshes(root: etree._Element, path: Path, meshes: Sequence[Path] = ()) -> bool:
    """Put the files in place of mesh names that only mean something beside ``path``; return whether any was."""
    changed = False
    for mesh in root.iter("mesh"):
        file = _mesh_file(mesh.get("filename") or "", path, meshes)
        if file is not None:
            mesh.set("filename", str(file))
            changed = True
    return changed


def without_missing_meshes(path: Path, meshes: Sequence[Path] = ()) -> tuple[bytes, list[str]]:
    """Return the URDF text with the meshes that are here, in ``meshes`` first, and the names of the others."""
    root = read_tree(path)
    missing: dict[str, None] = {}
    for shape in [*root.iter("visual"), *root.iter("collision")]:
        mesh = next(shape.iter("mesh"), None)
        if mesh is None:
            continue
        name = mesh.get("filename") or ""
        file = _mesh_file(name, path, meshes)
        if file is None:
            if shape.tag == "visual":
                missing[name] = None
            shape.getparent().remove(shape)  # type: ignore[union-attr]
        else:
            mesh.set("filename", str(file))
    return etree.tostring(root), list(missing)


def _mesh_file(name: str, path: Path, meshes: Sequence[Path]) -> Path | None:
    scheme, separator, rest = name.partition("://")
    if not separator:
        places = [path.resolve().parent / name]
        rest = name
    elif scheme == "package":
        extra = [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
        places = [folder / rest for folder in (*meshes, *path.resolve().parents[:6], *extra)]
    elif scheme == "file":
        places = [Path(rest)]
    else:
        return None
    parts = Path(rest).parts  # the folder given may be the package itself, or its meshes
    places += [Path(folder, *parts[k:]) for folder in meshes for k in range(len(parts))]
    return next((place.resolve() for place in places if place.is_file()), None)


def with_inertias(path: Path, model: pin.Model) -> bytes:
    """Return the URDF text with the moving links' inertials replaced by those of ``model``; all else stays."""
    # Pinocchio lumps children on fixed or locked joints into the moving link: it gets the sum, they lose theirs.
    root = read_tree(path)
    resolve_meshes(root, path)
    joint_above = {str(child.get("link")): child.getparent() for child in root.iterfind("joint/child")}
    for link in root.findall("link"):
        joint = first = joint_above.get(str(link.get("name")))
        while joint is not None and joint.get("name") not in model.names:
            joint = joint_above.get(str(joint.find("parent").get("link")))  # type: ignore[union-attr]
        if joint is None or first is None:  # fixed to the base
            continue
        body = model.inertias[model.getJointId(joint.get("name"))]
        for inertial in link.findall("inertial"):
            link.remove(inertial)
        if joint is first:
            link.insert(0, inertial_element(body))
    return etree.tostring(root, xml_declaration=True, encoding="utf-8", pretty_print=True)


def written(values: Floats) -> str:
    """Return numbers, (n,), as an attribute has them, with all their digits."""
    return " ".join(repr(float(x) + 0.0) for x in values)


def inertial_element(inertia: pin.Inertia) -> etree._Element:
    """Return the ``<inertial>`` element of a body."""
    element = etree.Element("inertial")
    etree.SubElement(element, "origin", xyz=written(inertia.lever), rpy="0 0 0")
    etree.SubElement(element, "mass", value=repr(float(inertia.mass)))
    m = inertia.inertia
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    entries = {f"i{'xyz'[i]}{'xyz'[j]}": repr(float(m[i, j])) for i, j in pairs}
    etree.SubElement(element, "inertia", entries)
    return element
