"""From a URDF file to the ``pin.Model`` of the joints that matter, with errors that name the element.

Pinocchio and urdfdom accept negative masses and massless links and turn a ``continuous`` joint into a
(cos, sin) pair; identification needs physical links and one number a joint. So the XML is checked and
rewritten here, and the joints that are no axis are locked at zero.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from pinotwin.errors import MachineError, nearest

_MOVING = ("revolute", "continuous", "prismatic")
_WIDE = "1e9"


def read_tree(path: Path) -> etree._Element:
    """Parse a URDF file and return its ``<robot>`` element.

    Raises:
        MachineError: no such file, not XML, not a URDF, or a link or joint that cannot be.
    """
    if not path.is_file():
        raise MachineError(f"{path}: no such URDF file; check `urdf` in machine.yaml")
    try:
        root = etree.parse(str(path), etree.XMLParser(remove_comments=False)).getroot()
    except etree.XMLSyntaxError as error:
        raise MachineError(f"{path}: not valid XML: {error.msg}") from None
    if root.tag != "robot":
        raise MachineError(f"{path}: root element is <{root.tag}>, a URDF starts with <robot>")
    _check_links(path, root)
    _check_joints(path, root)
    return root


def _number(path: Path, where: str, text: str | None) -> float:
    try:
        value = float(text if text is not None else "")
    except ValueError:
        raise MachineError(f"{path}: {where}: {text!r} is not a number") from None
    if not np.isfinite(value):
        raise MachineError(f"{path}: {where}: {text!r} is not a finite number")
    return value


def _check_links(path: Path, root: etree._Element) -> None:
    names = [link.get("name") for link in root.findall("link")]
    if not names:
        raise MachineError(f"{path}: no <link>; this is not a machine")
    for name in names:
        if names.count(name) > 1:
            raise MachineError(f"{path}: link {name!r} is defined {names.count(name)} times")
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is not None:
            _check_inertial(path, f"link {link.get('name')!r}", inertial)


def _check_inertial(path: Path, where: str, inertial: etree._Element) -> None:
    mass_tag, tag = inertial.find("mass"), inertial.find("inertia")
    if mass_tag is None or tag is None:
        raise MachineError(f"{path}: {where}: <inertial> needs <mass> and <inertia>")
    mass = _number(path, f"{where} mass", mass_tag.get("value"))
    if mass < 0.0:
        raise MachineError(f"{path}: {where}: mass {mass:g} kg is negative")
    entries = {k: _number(path, f"{where} {k}", tag.get(k, "0")) for k in tag.attrib}
    xx, yy, zz = (entries.get(k, 0.0) for k in ("ixx", "iyy", "izz"))
    xy, xz, yz = (entries.get(k, 0.0) for k in ("ixy", "ixz", "iyz"))
    principal = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    slack = 1e-6 * max(abs(principal[-1]), 1e-12)
    if principal[0] < -slack:
        raise MachineError(
            f"{path}: {where}: inertia has a negative principal moment ({principal[0]:.3g} kg·m²)"
        )
    if principal[0] + principal[1] < principal[2] - 1e-2 * abs(principal[2]) - slack:
        raise MachineError(
            f"{path}: {where}: principal moments {np.array2string(principal, precision=4)} kg·m² "
            "break the triangle inequality; no rigid body has them"
        )


def _check_joints(path: Path, root: etree._Element) -> None:
    links = [link.get("name") for link in root.findall("link")]
    children: dict[str, str] = {}
    seen: set[str] = set()
    for joint in root.findall("joint"):
        name = joint.get("name") or "(unnamed)"
        if name in seen:
            raise MachineError(f"{path}: joint {name!r} is defined twice")
        seen.add(name)
        for end in ("parent", "child"):
            tag = joint.find(end)
            link = None if tag is None else tag.get("link")
            if link not in links:
                hint = nearest(str(link), [str(x) for x in links])
                raise MachineError(f"{path}: joint {name!r}: {end} link {link!r} not found; {hint}")
        child = str(joint.find("child").get("link"))  # type: ignore[union-attr]
        if child in children:
            raise MachineError(
                f"{path}: link {child!r} is the child of both {children[child]!r} and {name!r}; "
                "a URDF is a tree"
            )
        children[child] = name
        _check_axis(path, name, joint)
    roots = [link for link in links if link not in children]
    if len(roots) != 1:
        raise MachineError(
            f"{path}: {len(roots)} root links ({', '.join(map(str, roots)) or 'a loop'}); "
            "a URDF has exactly one: join or remove the dangling links"
        )


def _check_axis(path: Path, name: str, joint: etree._Element) -> None:
    kind = joint.get("type")
    if kind not in (*_MOVING, "fixed", "floating", "planar"):
        raise MachineError(f"{path}: joint {name!r}: unknown type {kind!r}; {nearest(str(kind), _MOVING)}")
    axis = joint.find("axis")
    if kind in _MOVING and axis is not None:
        words = (axis.get("xyz") or "1 0 0").split()
        values = [_number(path, f"joint {name!r} axis", w) for w in words]
        if len(values) != 3 or not any(values):
            raise MachineError(f"{path}: joint {name!r}: axis {axis.get('xyz')!r} is no direction")


def moving_joints(root: etree._Element) -> tuple[str, ...]:
    """Return the names of the prismatic, revolute and continuous joints, in file order."""
    return tuple(
        str(j.get("name")) for j in root.findall("joint") if j.get("type") in _MOVING
    )


def _without_turns(root: etree._Element) -> bytes:
    """Return the XML with continuous joints as revolute ones and every limit present."""
    copy = etree.fromstring(etree.tostring(root))
    for joint in copy.findall("joint"):
        if joint.get("type") not in _MOVING:
            continue
        limit = joint.find("limit")
        if limit is None:
            limit = etree.SubElement(joint, "limit")
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit.set("lower", "-" + _WIDE)
            limit.set("upper", _WIDE)
        for key, value in (("effort", _WIDE), ("velocity", _WIDE)):
            limit.set(key, limit.get(key, value))
        mimic = joint.find("mimic")
        if mimic is not None:
            joint.remove(mimic)
    for tag in ("visual", "collision"):
        for element in copy.iter(tag):
            element.getparent().remove(element)  # type: ignore[union-attr]
    return etree.tostring(copy)


def load_model(path: Path, joints: Sequence[str]) -> pin.Model:
    """Return the model in which only ``joints`` move; every other joint is locked at zero.

    Args:
        path: URDF file.
        joints: names of the joints to keep, one degree of freedom each.

    Raises:
        MachineError: see :func:`read_tree`; or a joint that does not exist or has no mass to move.
    """
    root = read_tree(path)
    known = moving_joints(root)
    for name in joints:
        if name not in known:
            raise MachineError(f"{path}: no moving joint {name!r}; {nearest(name, known)}")
    with _quiet():
        try:
            full = pin.buildModelFromXML(_without_turns(root))
        except (ValueError, RuntimeError) as error:
            raise MachineError(f"{path}: Pinocchio cannot build it: {error}") from None
    locked = [full.getJointId(n) for n in full.names if n != "universe" and n not in joints]
    return pin.buildReducedModel(full, locked, pin.neutral(full)) if locked else full


class _quiet:
    """Silence urdfdom, which writes its warnings straight to the process' standard error."""

    def __enter__(self) -> None:
        self._saved = os.dup(2)
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, 2)
        os.close(sink)

    def __exit__(self, *_: object) -> None:
        os.dup2(self._saved, 2)
        os.close(self._saved)


def check_inertia(model: pin.Model, where: str) -> None:
    """Refuse a model in which some joint moves nothing.

    Raises:
        MachineError: naming the joint whose branch has neither inertia nor rotor inertia.
    """
    data = model.createData()
    q = np.clip(np.full(model.nq, 0.3), model.lowerPositionLimit, model.upperPositionLimit)
    mass = pin.crba(model, data, q)
    diagonal = np.diag(mass)
    for joint in range(1, model.njoints):
        if diagonal[model.idx_vs[joint]] <= 1e-12:
            raise MachineError(
                f"{where}: joint {model.names[joint]!r} moves no inertia (massless link); give its "
                "link an <inertial> or the axis a rotor_inertia"
            )


def package_dirs(path: Path) -> list[str]:
    """Return folders in which ``package://`` meshes of a URDF may be found."""
    extra = [p for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
    parents = [str(p) for p in path.resolve().parents][:6]
    return _unique([*parents, *extra])


def _unique(items: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(items))


def with_inertias(path: Path, model: pin.Model) -> bytes:
    """Return the URDF text with the moving links' inertials replaced by those of ``model``.

    Comments and foreign tags stay. The inertias of children on fixed (or locked) joints are lumped
    into the moving link by Pinocchio; here the moving link gets the sum and those children lose
    their own ``<inertial>``, so that the tree as a whole has the model's inertias.
    """
    root = read_tree(path)
    owner = _owners(root, set(model.names))
    for link in root.findall("link"):
        joint = owner.get(str(link.get("name")))
        if joint is None:
            continue
        inertial = link.find("inertial")
        if inertial is not None:
            link.remove(inertial)
        child = _child(root, joint)
        if link.get("name") == child:
            link.insert(0, _inertial(model.inertias[model.getJointId(joint)]))
    return etree.tostring(root, xml_declaration=True, encoding="utf-8", pretty_print=True)


def _child(root: etree._Element, joint: str) -> str:
    for j in root.findall("joint"):
        if j.get("name") == joint:
            return str(j.find("child").get("link"))  # type: ignore[union-attr]
    raise MachineError(f"no joint {joint!r} in the URDF")


def _owners(root: etree._Element, kept: set[str]) -> dict[str, str]:
    """Return, for each link, the kept joint that moves it (links fixed to the base are absent)."""
    parent = {
        str(j.find("child").get("link")): (str(j.get("name")), str(j.find("parent").get("link")))  # type: ignore[union-attr]
        for j in root.findall("joint")
    }
    owner: dict[str, str] = {}
    for link in root.findall("link"):
        name = at = str(link.get("name"))
        while at in parent:
            joint, at = parent[at]
            if joint in kept:
                owner[name] = joint
                break
    return owner


def _inertial(inertia: pin.Inertia) -> etree._Element:
    def text(values: Iterable[float]) -> str:
        return " ".join(repr(float(x)) for x in values)

    element = etree.Element("inertial")
    etree.SubElement(element, "origin", xyz=text(inertia.lever), rpy="0 0 0")
    etree.SubElement(element, "mass", value=repr(float(inertia.mass)))
    m = inertia.inertia
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    etree.SubElement(element, "inertia", {k: repr(float(m[ij])) for k, ij in entries.items()})
    return element
