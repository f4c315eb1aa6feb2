"""Reading a URDF file: what no machine can have is refused with the element that has it.

Pinocchio and urdfdom accept negative masses, loops (some for ever) and numbers that are none.
"""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import numpy as np
from lxml import etree

from pinotwin.arrays import Floats
from pinotwin.errors import MachineError, nearest, require

MOVING = ("revolute", "continuous", "prismatic")  # joint types with one degree of freedom, which may be axes
FREE = ("floating", "planar")  # joint types of a base that is free: held here
SHAPES = ("box", "cylinder", "sphere", "mesh")  # what the geometry of a visual or a collision may be
_TYPES = (*MOVING, *FREE, "fixed")


def read_tree(path: Path, most: int = 2000) -> etree._Element:
    """Return the ``<robot>`` of a URDF file; MachineError for what no machine has, or more than ``most`` parts."""
    if not path.is_file():
        raise MachineError(f"{path}: no such URDF file; check `urdf` in machine.yaml")
    root = _parsed(path)
    try:
        _check_root(root, path.stem)
        if len(root) > most:
            raise MachineError(f"has {len(root)} links and joints; no machine has more than {most}")
        _check_links(root)
        _check_is_tree([str(link.get("name")) for link in root.findall("link")], _check_joints(root))
    except MachineError as error:
        raise MachineError(f"{path}: {error}") from None
    return root


def _parsed(path: Path, most: int = 50_000_000) -> etree._Element:
    """Return the root of an XML file; no entity of it is looked up, in the file or elsewhere."""
    try:
        if path.stat().st_size > most:
            raise MachineError(f"{path}: is larger than {most:.0e} bytes; a URDF names its meshes")
        content = path.read_bytes()
    except OSError as error:
        raise MachineError(f"{path}: cannot be read: {error.strerror}; check its access") from None
    parser = etree.XMLParser(remove_comments=False, resolve_entities=False, no_network=True)
    try:
        return etree.fromstring(content, parser)
    except (etree.LxmlError, ValueError, OSError) as error:
        what = " ".join(str(error).split())
        if "encoding" in what or "UTF-8" in what:
            hint = "save it as UTF-8, or name its encoding in the first line, <?xml encoding=...?>"
            raise MachineError(f"{path}: not valid XML: {what}; {hint}") from None
        raise MachineError(f"{path}: not valid XML: {what}; export it again") from None


def moving_joints(root: etree._Element) -> tuple[str, ...]:
    """Return the names of the prismatic, revolute and continuous joints, in file order."""
    return tuple(str(j.get("name")) for j in root.findall("joint") if j.get("type") in MOVING)


UNFIT = frozenset(',;:=+\n"/\\')
"""Characters that no axis' name may hold: it stands in options, channels and files."""


def axis_names(root: etree._Element) -> dict[str, str]:
    """Return axis -> joint: every joint that moves by itself, named as it is where that can name an axis."""
    followers = mimics(root)
    out: dict[str, str] = {}
    for joint in (j for j in moving_joints(root) if j not in followers):
        name = "".join("_" if c in UNFIT or c.isspace() else c for c in joint).strip("_") or "axis"
        fits = joint.strip() == joint and not UNFIT & set(joint)
        taken = (name, *(f"{name}_{k}" for k in range(2, len(out) + 3)))
        out[joint if fits else next(n for n in taken if n not in out)] = joint
    return out


def mimics(root: etree._Element) -> dict[str, str]:
    """Return the joints that follow another one: name -> the joint they follow."""
    pairs = [(j, j.find("mimic")) for j in root.findall("joint") if j.get("type") in MOVING]
    return {str(j.get("name")): str(leader.get("joint")) for j, leader in pairs if leader is not None}


def incomplete(root: etree._Element) -> dict[str, str]:
    """Return what other readers of URDFs stumble over, and Pinocchio does not: joint or link -> what is missing."""
    out = {}
    for joint in root.findall("joint"):
        limit, ends = joint.find("limit"), joint.get("type") in ("revolute", "prismatic")
        if limit is None and ends:
            out[str(joint.get("name"))] = f"a {joint.get('type')} joint needs a <limit>"
        elif limit is not None:
            needed = ("effort", "velocity", *(("lower", "upper") if ends else ()))
            lacking = ", ".join(key for key in needed if limit.get(key) is None)
            if lacking:
                out[str(joint.get("name"))] = f"its <limit> lacks {lacking}"
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            if sum(len(shape.findall(f"geometry/{kind}")) for kind in SHAPES) != 1:
                one = ", ".join(f"<{kind}>" for kind in SHAPES)
                out[str(link.get("name"))] = f"the <geometry> of a <{shape.tag}> needs one of {one}"
    return out


def _check_root(root: etree._Element, name: str) -> None:
    if etree.QName(root).localname == "robot" and etree.QName(root).namespace:
        raise MachineError("<robot> has an XML namespace; remove its xmlns attribute")
    if root.tag != "robot":
        raise MachineError(f"root element is <{root.tag}>; a URDF starts with <robot>")
    if any(element.prefix == "xacro" for element in root.iter()):
        raise MachineError("is a xacro file; expand it first: `xacro FILE > robot.urdf`")
    if not root.get("name"):
        root.set("name", name)  # urdfdom refuses a robot without name


def _number(where: str, text: str | None) -> float:
    try:
        value = float(text if text is not None else "")
    except ValueError:
        raise MachineError(f"{where}: {text!r} is not a number") from None
    if not np.isfinite(value):
        raise MachineError(f"{where}: {text!r} is not a finite number")
    return value


def _triple(where: str, text: str) -> Floats:
    words = text.split()
    if len(words) != 3:
        raise MachineError(f"{where}: {text!r} are {len(words)} numbers, expected 3")
    return np.array([_number(where, word) for word in words])


def _check_origin(where: str, element: etree._Element) -> None:
    origin = element.find("origin")
    for key in ("xyz", "rpy"):
        if origin is not None and origin.get(key) is not None:
            _triple(f"{where} origin {key}", str(origin.get(key)))


def _check_names(root: etree._Element, kind: str) -> None:
    seen: set[str] = set()
    for element in root.findall(kind):
        name = element.get("name")
        if not name:
            raise MachineError(f"line {element.sourceline}: a <{kind}> has no name; give it one")
        if name in seen:
            raise MachineError(f"{kind} {name!r} is defined twice; rename one of them")
        seen.add(name)


def _check_links(root: etree._Element) -> None:
    if root.find("link") is None:
        raise MachineError("no <link>; this is not a machine")
    _check_names(root, "link")
    for link in root.findall("link"):
        where, inertial = f"link {link.get('name')!r}", link.find("inertial")
        if inertial is None:
            continue
        _check_origin(where, inertial)
        mass_tag, tag = inertial.find("mass"), inertial.find("inertia")
        if mass_tag is None or tag is None:
            raise MachineError(f"{where}: <inertial> needs <mass> and <inertia>")
        mass = _number(f"{where} mass", mass_tag.get("value"))
        if mass < 0.0:
            raise MachineError(f"{where}: mass {mass:g} kg is negative; correct it")
        for key in tag.attrib:
            _number(f"{where} {key}", tag.get(key))


def _check_joints(root: etree._Element) -> dict[str, tuple[str, str]]:
    """Check every joint by itself and return child link -> (joint, parent link)."""
    _check_names(root, "joint")
    links = [str(link.get("name")) for link in root.findall("link")]
    parents: dict[str, tuple[str, str]] = {}
    for joint in root.findall("joint"):
        name = str(joint.get("name"))
        where = f"joint {name!r}"
        parent, child = (_end(where, joint, end, links) for end in ("parent", "child"))
        if child in parents:
            raise MachineError(
                f"link {child!r} is the child of both {parents[child][0]!r} and {name!r}; a URDF is a tree"
            )
        parents[child] = (name, parent)
        _check_origin(where, joint)
        _check_axis(where, joint)
        _check_limit(where, joint)
    return parents


def _end(where: str, joint: etree._Element, end: str, links: list[str]) -> str:
    tag = joint.find(end)
    link = None if tag is None else tag.get("link")
    if link is None:
        raise MachineError(f"{where}: has no <{end} link=...>; add it")
    if link not in links:
        raise MachineError(f"{where}: {end} link {link!r} not found; {nearest(link, links)}")
    return str(link)


def _check_axis(where: str, joint: etree._Element) -> None:
    kind = joint.get("type")
    require(kind, _TYPES, f"{where}: unknown type", MachineError)
    axis = joint.find("axis")
    xyz = None if axis is None else axis.get("xyz")
    if kind in MOVING and xyz is not None and not _triple(f"{where} axis", xyz).any():
        raise MachineError(f"{where}: axis {xyz!r} is no direction; give one, such as 0 0 1")


def _check_limit(where: str, joint: etree._Element) -> None:
    limit = joint.find("limit")
    if limit is None or joint.get("type") not in MOVING:
        return
    keys = ("lower", "upper", "effort", "velocity")
    given = {k: _number(f"{where} limit {k}", limit.get(k)) for k in keys if limit.get(k)}
    for key in ("effort", "velocity"):
        if given.get(key, 0.0) < 0.0:
            raise MachineError(f"{where}: {key} limit {given[key]:g} is negative; correct it")
    low, high = given.get("lower", 0.0), given.get("upper", 0.0)
    if joint.get("type") != "continuous" and low > high:
        raise MachineError(f"{where}: lower limit {low:g} is above the upper {high:g}; swap them")


def _check_is_tree(links: list[str], parents: dict[str, tuple[str, str]]) -> None:
    """Refuse loops, and links that hang on nothing."""
    try:
        TopologicalSorter({child: [parent] for child, (_, parent) in parents.items()}).prepare()
    except CycleError as error:
        joints = ", ".join(sorted({parents[link][0] for link in error.args[1]}))
        raise MachineError(f"joints {joints} form a loop; a URDF is a tree: cut the loop at one") from None
    roots = [link for link in links if link not in parents]
    if len(roots) != 1:
        raise MachineError(
            f"{len(roots)} root links ({', '.join(roots)}); a URDF has exactly one: join or "
            "remove the dangling links"
        )
