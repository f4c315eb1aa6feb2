"""A machine tool's URDF from the letters of its axes.

    XYZAC       linear axes carry the tool, rotary axes the workpiece (``rotary="head"``: all carry the tool)
    XYZ-BC      what carries the tool, then what carries the workpiece, each from the base outward
    0-YAC       everything under the workpiece

ISO 841: X Y Z (U V W) move along x, y, z (right, back, up), A B C turn about them; a positive command moves the tool
relative to the workpiece. Masses and lengths are starting values: ``identify`` finds the inertias.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import yourdfpy
from lxml import etree
from trimesh.transformations import translation_matrix

from pinotwin.errors import MachineError

LINEAR = {"X": (1, 0, 0), "Y": (0, 1, 0), "Z": (0, 0, 1), "U": (1, 0, 0), "V": (0, 1, 0), "W": (0, 0, 1)}
ROTARY = {"A": (1, 0, 0), "B": (0, 1, 0), "C": (0, 0, 1)}
ENDLESS = 1e9

SIZE = {"linear": (0.40, 0.40, 0.15), "rotary": (0.30, 0.30, 0.12)}
"""Box of a carriage and of a rotary body [m]; with the mass it gives a starting inertia."""
MASS = {"linear": 100.0, "rotary": 40.0}  # starting mass of a carriage and of a rotary body [kg]
TRAVEL = {"linear": (-0.25, 0.25), "tilt": (-2.0, 2.0), "turn": (-ENDLESS, ENDLESS)}
"""Limits where neither an option nor a log gives them [m or rad]."""
COLOURS = ((0.62, 0.65, 0.68), (0.21, 0.44, 0.60), (0.80, 0.62, 0.24), (0.36, 0.55, 0.40), (0.55, 0.40, 0.55))


@dataclass(frozen=True)
class Sizes:
    """What the user knows of the machine."""

    mass: Mapping[str, float] = field(default_factory=dict)  # axis -> mass that its joint moves alone [kg]
    # axis -> lower and upper limit [m or rad]
    travel: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # axis -> its joint's place in the frame of the joint before it [m], shape (3,)
    offset: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    # axis -> effort of one unit of its column in the log [N or N·m]: torque constant x gear
    factor: Mapping[str, float] = field(default_factory=dict)
    apart: float = 0.15  # distance from one joint to the next along z where no offset is given [m]


@dataclass(frozen=True)
class Chain:
    """Axes from the base to the tool, and from the base to the workpiece."""

    tool: tuple[str, ...]
    work: tuple[str, ...]

    @property
    def axes(self) -> tuple[str, ...]:
        """All axes."""
        return (*self.tool, *self.work)


def is_chain(text: str) -> bool:
    """Whether a text is letters of axes rather than a name or a path."""
    return re.fullmatch(r"[XYZUVWABC]+(-[XYZUVWABC]*)?|0?-[XYZUVWABC]+", text) is not None


def parse_chain(text: str, rotary: str = "table") -> Chain:
    """Return the chain that a text means, see the module; ``rotary`` (table, head) is for one without ``-``."""
    text = text.lstrip("0")
    letters = text.replace("-", "")
    twice = next((a for a in letters if letters.count(a) > 1), None)
    if twice or not letters:
        raise MachineError(f"{text}: axis {twice or 'letters'} {'is there twice' if twice else 'missing'}")
    if "-" in text:
        tool, _, work = text.partition("-")
        return Chain(tuple(tool), tuple(work))
    if rotary == "head":
        return Chain(tuple(text), ())
    return Chain(tuple(a for a in text if a in LINEAR), tuple(a for a in text if a in ROTARY))


def write_urdf(name: str, chain: Chain, sizes: Sizes) -> bytes:
    """Return the URDF of a chain; MachineError for a size that cannot be, or of an axis that there is not."""
    for kind in ("mass", "travel", "offset"):
        for axis in getattr(sizes, kind):
            if axis not in chain.axes:
                raise MachineError(f"--{kind} {axis}: no such axis; axes: {', '.join(chain.axes)}")
    bad = next((axis for axis, mass in sizes.mass.items() if mass <= 0.0), None)
    if bad:
        raise MachineError(f"--mass {bad}: {sizes.mass[bad]:g} kg must be positive")
    robot = yourdfpy.Robot(name=name)
    robot.links.append(yourdfpy.Link("base_link", visuals=[_box((0.8, 0.8, 0.1), (0, 0, -0.05), 0)]))
    for axes, sign in ((chain.tool, 1.0), (chain.work, -1.0)):
        parent = "base_link"
        for depth, axis in enumerate(axes):
            start = 0.6 if sign > 0 and depth == 0 and chain.work else sizes.apart  # the tool stands above
            offset = sizes.offset.get(axis, (0.0, 0.0, start if sign < 0 or depth == 0 else -sizes.apart))
            robot.joints.append(_joint(axis, parent, offset, sign, sizes))
            robot.links.append(_link(axis, len(robot.links), sizes))
            parent = f"{axis}_link"
    root = yourdfpy.URDF(robot=robot, build_scene_graph=False, load_meshes=False).write_xml().getroot()
    tool, work = (" ".join(axes) or "nothing" for axes in (chain.tool, chain.work))
    sides = f"{tool} under the tool, {work} under the workpiece, from the base outward"
    said = f" Written by `pinotwin new`: {sides}. Masses and sizes are starting values. "
    root.insert(0, etree.Comment(said))
    return bytes(etree.tostring(root, pretty_print=True, xml_declaration=True, encoding="utf-8"))


def assumed(chain: Chain, sizes: Sizes, measured: set[str]) -> list[str]:
    """Return what a machine starts with, a sentence each; ``measured``: axes whose travel is from a log."""
    sides = f"{' '.join(chain.tool) or 'none'} under the tool, {' '.join(chain.work) or 'none'} under the workpiece"
    said = [f"axes from the base outward: {sides}"]
    for axis in chain.axes:
        unit = "m" if kind_of(axis) == "linear" else "rad"
        low, high = sizes.travel.get(axis, default_travel(axis))
        how = "a tenth beyond the log" if axis in measured else "given" if axis in sizes.travel else "assumed"
        mass = sizes.mass.get(axis, MASS[kind_of(axis)])
        travel = "endless" if high - low > 1e8 else f"{low:g} to {high:g} {unit} ({how})"
        weight = f"{mass:g} kg ({'given' if axis in sizes.mass else 'assumed'})"
        said.append(f"{axis}: travel {travel}, mass {weight}")
    if any(axis not in sizes.offset for axis in chain.axes):
        said.append(f"joints are {sizes.apart:g} m apart; --offset changes that")
    return said


def kind_of(axis: str) -> str:
    """Return ``linear`` or ``rotary``."""
    return "linear" if axis in LINEAR else "rotary"


def default_travel(axis: str) -> tuple[float, float]:
    """Return the limits of an axis of which nothing is known [m or rad]."""
    return TRAVEL["linear" if axis in LINEAR else "turn" if axis == "C" else "tilt"]


def _joint(axis: str, parent: str, offset: tuple[float, ...], sign: float, sizes: Sizes) -> yourdfpy.Joint:
    low, high = sizes.travel.get(axis, default_travel(axis))
    if not low < high:
        raise MachineError(f"--travel {axis}: {low:g} is not below {high:g}")
    endless = high - low >= ENDLESS
    direction = sign * np.array(LINEAR.get(axis) or ROTARY[axis], dtype=float)
    kind = "prismatic" if axis in LINEAR else "continuous" if endless else "revolute"
    limit = None if endless else yourdfpy.Limit(effort=ENDLESS, velocity=ENDLESS, lower=low, upper=high)
    return yourdfpy.Joint(
        axis,
        kind,
        parent,
        f"{axis}_link",
        origin=translation_matrix(offset),
        axis=direction + 0.0,
        limit=limit,
    )


def _link(axis: str, number: int, sizes: Sizes) -> yourdfpy.Link:
    kind = kind_of(axis)
    size, mass = np.array(SIZE[kind]), sizes.mass.get(axis, MASS[kind])
    inertia = mass / 12.0 * np.diag(np.sum(size**2) - size**2)
    # A tilting body whose centre lies on its axis would show no gravity: it starts a little off it.
    centre = (0.0, 0.0, 0.0 if kind == "linear" or axis == "C" else -0.02)
    inertial = yourdfpy.Inertial(origin=translation_matrix(centre), mass=mass, inertia=inertia)
    return yourdfpy.Link(f"{axis}_link", inertial=inertial, visuals=[_box(tuple(size), centre, number)])


def _box(size: tuple[float, ...], at: tuple[float, ...], number: int) -> yourdfpy.Visual:
    rgba = np.array([*COLOURS[number % len(COLOURS)], 1.0])
    material = yourdfpy.Material(name=f"colour_{number}", color=yourdfpy.Color(rgba=rgba))
    geometry = yourdfpy.Geometry(box=yourdfpy.Box(size=np.array(size)))
    return yourdfpy.Visual(origin=translation_matrix(at), geometry=geometry, material=material)
