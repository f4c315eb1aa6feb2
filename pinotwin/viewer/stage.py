"""Light, background, floor and camera: what surrounds a machine so that it can be seen whole.

The camera looks from the front right, a little from above, and stands just far enough that every
corner of the geometry's bounding boxes lies inside the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import meshcat
import meshcat.geometry as mg
import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats
from pinotwin.viewer.page import Message

FIELD_OF_VIEW = 28.0
"""Vertical opening of the camera [deg]: a long lens keeps parallel edges nearly parallel."""

ASPECT = 4.0 / 3.0
_MARGIN = 1.09
_VIEW_FROM = np.array([0.62, -0.95, 0.52])
_SKY = ([0.97, 0.98, 0.99], [0.83, 0.87, 0.90])
_FLOOR = (0xD4D8DB, 0x666768)  # colour, own light: bright, yet it shows shadows


@dataclass(frozen=True)
class Bounds:
    """Axis-aligned box in the world [m].

    Attributes:
        low: smallest coordinates, shape (3,).
        high: largest coordinates, shape (3,).
    """

    low: Floats
    high: Floats

    @property
    def centre(self) -> Floats:
        """Centre of the box [m]."""
        return np.asarray((self.low + self.high) / 2)

    @property
    def size(self) -> float:
        """Diagonal of the box [m]."""
        return float(np.linalg.norm(self.high - self.low))


def corners(model: pin.Model, visual: pin.GeometryModel, q: Floats) -> Floats:
    """Return the corners of every shape's bounding box in the world [m], shape (8 shapes, 3).

    A machine without shapes gives boxes around its joints' origins instead.
    """
    data, placed = model.createData(), visual.createData()
    pin.updateGeometryPlacements(model, data, visual, placed, q)
    unit = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    found = []
    for shape, pose in zip(visual.geometryObjects, placed.oMg, strict=True):
        shape.geometry.computeLocalAABB()
        low, high = shape.geometry.aabb_local.min_, shape.geometry.aabb_local.max_
        local = low + unit * (high - low)  # of a mesh: scaled as it was read
        found.append(local @ pose.rotation.T + pose.translation)
    if not found:
        found = [pose.translation + 0.1 * (unit - 0.5) for pose in data.oMi]
    return np.concatenate(found)


def bounds(points: Floats) -> Bounds:
    """Return the box around points of shape (n, 3)."""
    return Bounds(points.min(axis=0), points.max(axis=0))


@dataclass(frozen=True)
class Camera:
    """Where the camera looks and where it stands.

    Attributes:
        target: the point in the middle of the picture, world [m], shape (3,).
        offset: from there to the camera [m], shape (3,).
    """

    target: Floats
    offset: Floats


def framing(points: Floats) -> dict[str, Any]:
    """Return what a page needs to aim its camera itself, as :func:`aim` does, at a window of any shape."""
    from scipy.spatial import ConvexHull

    outer = points[ConvexHull(points, qhull_options="QJ").vertices]  # joggled: points may lie in a plane
    return {"points": outer.tolist(), "from": _VIEW_FROM.tolist(), "fov": FIELD_OF_VIEW, "margin": _MARGIN}


def aim(points: Floats) -> Camera:
    """Return the camera that shows all points as large as they fit, in the middle of the picture.

    Args:
        points: what has to be seen, shape (n, 3).
    """
    back = _VIEW_FROM / np.linalg.norm(_VIEW_FROM)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    slope = math.tan(math.radians(FIELD_OF_VIEW) / 2)
    target = bounds(points).centre
    distance = 1.0
    for _ in range(4):  # moving the target changes the perspective a little, hence again
        relative = points - target
        x, y, z = relative @ right, relative @ up, relative @ back
        distance = _MARGIN * float(np.max(np.maximum(np.abs(y), np.abs(x) / ASPECT) / slope + z))
        depth = distance - z
        for coordinate, direction in ((x / depth, right), (y / depth, up)):
            target = target + distance * (coordinate.min() + coordinate.max()) / 2 * direction
    return Camera(target, distance * back)


def set_stage(viewer: meshcat.Visualizer, points: Floats) -> None:
    """Set light, background, floor and camera for a machine that fills ``points``.

    Meshcat's camera orbits the origin of its world and nothing else, so the drawing is moved until
    the camera's target lies there; ``viewer`` must be the root of the drawing.
    """
    box, camera = bounds(points), aim(points)
    to_target = np.eye(4)
    to_target[:3, 3] = -camera.target
    viewer.set_transform(to_target)
    _set_background(viewer, box)
    _set_lights(viewer, box.size)
    _set_camera(viewer, camera.offset, box.size)


def _set_background(viewer: meshcat.Visualizer, box: Bounds) -> None:
    top, bottom = _SKY
    viewer["/Background"].set_property("top_color", top)
    viewer["/Background"].set_property("bottom_color", bottom)
    viewer["/Grid"].set_property("visible", False)
    viewer["/Axes"].set_property("visible", False)
    floor = viewer["floor"]
    square = 8.0 * box.size * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    sheet = mg.TriangularMeshGeometry(square, np.array([[0, 1, 2], [0, 2, 3]]))
    # One-sided (side=0): from below one looks through it.
    floor.set_object(sheet, mg.MeshLambertMaterial(color=_FLOOR[0], emissive=_FLOOR[1], side=0))
    pose = np.eye(4)
    pose[:3, 3] = [*box.centre[:2], box.low[2] - 1e-4 * box.size]
    floor.set_transform(pose)


def _set_lights(viewer: meshcat.Visualizer, size: float) -> None:
    """One key light with soft shadows from the upper left, two weak ones, and the ambient."""
    _place(viewer, "SpotLight", size * np.array([-1.1, -1.5, 2.4]))
    viewer["/Lights/SpotLight"].set_property("visible", True)
    _light(viewer, "SpotLight", intensity=0.32, castShadow=True, angle=0.45, penumbra=0.9)
    _place(viewer, "PointLightNegativeX", size * np.array([2.2, -1.4, 0.9]))
    _light(viewer, "PointLightNegativeX", intensity=0.16, distance=0.0)
    _place(viewer, "PointLightPositiveX", size * np.array([-2.2, -1.6, 0.7]))
    _light(viewer, "PointLightPositiveX", intensity=0.12, distance=0.0)
    _place(viewer, "FillLight", np.array([0.3, -0.4, 1.0]))
    _light(viewer, "FillLight", intensity=0.12)
    _light(viewer, "AmbientLight", intensity=0.46)


def _place(viewer: meshcat.Visualizer, name: str, at: Floats) -> None:
    viewer[f"/Lights/{name}/<object>"].set_property("position", [float(x) for x in at])


def _light(viewer: meshcat.Visualizer, name: str, **properties: Any) -> None:
    """Set properties of a light; as a message, since meshcat lowers the case of their names."""
    path = f"/Lights/{name}/<object>"
    for key, value in properties.items():
        viewer.window.send(Message({"type": "set_property", "path": path, "property": key, "value": value}))


def _set_camera(viewer: meshcat.Visualizer, offset: Floats, size: float) -> None:
    x, y, z = (float(value) for value in offset)
    lens = viewer["/Cameras/default/rotated/<object>"]
    lens.set_property("fov", FIELD_OF_VIEW)
    lens.set_property("near", 0.01 * size)
    lens.set_property("far", 100.0 * size)
    lens.set_property("position", [x, z, -y])  # the camera's own frame has y up
