"""The triangles of a shape with their colours: a primitive, or a mesh file of any kind that trimesh reads.

As in Pinocchio and RViz, a COLLADA file's unit counts and its ``up_axis`` does not; a URDF's material goes first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.logs.files.content import BROKEN

Colour = tuple[float, float, float]
Rgba = tuple[float, float, float, float]
GREY: Colour = (0.66, 0.69, 0.72)


@dataclass(frozen=True)
class Part:
    """Triangles of one colour (0 to 1): vertices [m] (n, 3) in their shape's frame, twice along edges, faces (m, 3)."""

    vertices: Floats
    faces: Ints
    rgba: Rgba | None = None


def parts_of(shape: pin.GeometryObject) -> list[Part]:
    """Return the parts of a shape, none where it has no surface (a plane, an octree)."""
    path = Path(shape.meshPath)
    parts = _read(path, path.stat().st_mtime_ns) if path.is_file() else ()
    scale = np.asarray(shape.meshScale)
    if sum(len(part.faces) for part in parts) < getattr(shape.geometry, "num_tris", 1):
        parts, scale = _of_geometry(shape.geometry), np.ones(3)  # Pinocchio's reader found more of the file
    given = _given_colour(shape)
    joined: dict[Rgba, list[Part]] = {}
    for part in parts:
        joined.setdefault(given if shape.overrideMaterial else part.rgba or given, []).append(part)
    return [_joined(of_one, rgba, scale) for rgba, of_one in joined.items()]


def _joined(parts: list[Part], rgba: Rgba, scale: Floats) -> Part:
    """Return parts as one, in one colour."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([part.vertices for part in parts]) * scale
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts[:-1], strict=True)])
    return Part(vertices, faces, rgba)


def _given_colour(shape: pin.GeometryObject) -> Rgba:
    """Return the colour of the URDF's material, of its picture where it has one."""
    picture = Path(shape.meshTexturePath)
    if picture.is_file():
        from PIL import Image

        return _mean(Image.open(picture))
    red, green, blue, opacity = (float(x) for x in shape.meshColor)
    return (red, green, blue, opacity)


@lru_cache(maxsize=256)
def _read(path: Path, _changed: int) -> tuple[Part, ...]:
    """Return the parts of a file, none where trimesh cannot read it (Pinocchio's reader may) or it is broken."""
    import trimesh
    from collada.common import DaeError
    from trimesh.exchange.stl import HeaderError

    try:
        scene = trimesh.load_scene(path, process=False, group_material=True)
    except (*BROKEN, SyntaxError, DaeError, HeaderError):
        return ()
    found = []
    unit = _unit(scene) if path.suffix.lower() == ".dae" else 1.0
    for node in scene.graph.nodes_geometry:
        pose, name = scene.graph[node]
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            points = unit * (mesh.vertices @ pose[:3, :3].T + pose[:3, 3])
            found.append(Part(*_surface(points, np.asarray(mesh.faces)), _own_colour(mesh.visual)))
    return tuple(found)


def _unit(scene: Any) -> float:
    """Return the length [m] of the unit of a COLLADA scene."""
    words = str(next((mesh.units for mesh in scene.geometry.values() if mesh.units), "meters"))
    return float(words.split(" ")[0]) if "*" in words else 1.0


def _surface(points: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Return vertices and faces, a vertex once for every smooth surface: faces that turn by less than 30 degrees."""
    import trimesh

    points, where = np.unique(points.astype(np.float32), axis=0, return_inverse=True)
    mesh = trimesh.Trimesh(points, where.reshape(-1)[faces], process=False)
    smooth = trimesh.graph.smooth_shade(mesh, angle=math.radians(30.0), facet_minarea=None)
    return np.asarray(smooth.vertices, dtype=np.float32), np.asarray(smooth.faces)


def _own_colour(visual: Any) -> Rgba | None:
    """Return the colour of a file's body: of its material, the mean of its texture or of its vertices."""
    if not visual.defined:
        return None
    owner = visual.material if visual.kind == "texture" else visual
    picture = getattr(owner, "baseColorTexture", None) or getattr(owner, "image", None)
    if picture is not None:
        return _mean(picture)
    red, green, blue = np.asarray(owner.main_color, dtype=float)[:3] / 255.0
    return (red, green, blue, 1.0)


def _mean(picture: Any) -> Rgba:
    """Return the mean colour of a picture."""
    red, green, blue = np.asarray(picture.convert("RGB"), dtype=float).reshape(-1, 3).mean(axis=0) / 255.0
    return (red, green, blue, 1.0)


def _of_geometry(shape: Any) -> tuple[Part, ...]:
    """Return the part of a primitive, or of a mesh that Pinocchio has read."""
    import trimesh.creation as make

    if isinstance(shape, coal.BVHModelBase):
        corners = [[t[0], t[1], t[2]] for t in (shape.tri_indices(k) for k in range(shape.num_tris))]
        faces = np.array(corners, dtype=int).reshape(-1, 3)
        return (Part(*_surface(np.array(shape.vertices()), faces)),) if corners else ()
    if isinstance(shape, coal.Box):
        mesh = make.box(2.0 * shape.halfSide)
    elif isinstance(shape, coal.Cylinder):
        mesh = make.cylinder(shape.radius, 2.0 * shape.halfLength, sections=48)
    elif isinstance(shape, coal.Capsule):
        mesh = make.capsule(2.0 * shape.halfLength, shape.radius)
    elif isinstance(shape, coal.Cone):
        mesh = make.cone(shape.radius, 2.0 * shape.halfLength, sections=48)
        mesh.apply_translation([0.0, 0.0, -shape.halfLength])
    elif isinstance(shape, coal.Sphere):
        mesh = make.icosphere(3, shape.radius)
    else:
        return ()
    return (Part(*_surface(mesh.vertices, mesh.faces)),)
