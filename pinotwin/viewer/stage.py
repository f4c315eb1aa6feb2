"""Light, background, floor and camera: what surrounds a machine so that it can be seen whole.

The camera, front right and a little above, stands just far enough for every corner of the bounding boxes.
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

FIELD_OF_VIEW = 28.0
"""Vertical opening of the camera [deg]: a long lens keeps parallel edges nearly parallel."""

ASPECT = 4.0 / 3.0
_MARGIN = 1.09
_VIEW_FROM = np.array([0.62, -0.95, 0.52])
_SKY = ([0.97, 0.98, 0.99], [0.83, 0.87, 0.90])
_FLOOR = (0xD4D8DB, 0x666768)  # colour, own light: bright, yet it shows shadows


def corners(model: pin.Model, visual: pin.GeometryModel, q: Floats) -> Floats:
    """Return the corners of every shape's bounding box, or of boxes around the joints, in the world [m], (k, 3)."""
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


def diagonal(points: Floats) -> float:
    """Return the diagonal of the box around points of shape (n, 3) [m]."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


@dataclass(frozen=True)
class Camera:
    """Where the camera looks and, from there, where it stands; in the world [m], shape (3,)."""

    target: Floats
    offset: Floats

    def axes(self) -> tuple[Floats, Floats, Floats]:
        """Return the directions to the right, up and back."""
        back = self.offset / np.linalg.norm(self.offset)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        return right, np.cross(back, right), back


def framing(points: Floats) -> dict[str, Any]:
    """Return what a page needs to aim its camera itself, as :func:`aim` does, at a window of any shape."""
    from scipy.spatial import ConvexHull

    outer = points[ConvexHull(points, qhull_options="QJ").vertices]  # joggled: points may lie in a plane
    return {"points": outer.tolist(), "from": _VIEW_FROM.tolist(), "fov": FIELD_OF_VIEW, "margin": _MARGIN}


def aim(points: Floats) -> Camera:
    """Return the camera that shows all points (n, 3) as large as they fit, in the middle of the picture."""
    slope = math.tan(math.radians(FIELD_OF_VIEW) / 2)
    target = 0.5 * (points.min(axis=0) + points.max(axis=0))
    right, up, back = Camera(target, _VIEW_FROM).axes()
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
    """Set light, background, floor and camera for points (n, 3) [m], moved to the origin that the camera orbits."""
    size, camera = diagonal(points), aim(points)
    viewer.set_transform(pin.SE3(np.eye(3), -camera.target).homogeneous)
    _set_background(viewer, points, size)
    _set_lights(viewer, size)
    x, y, z = (float(value) for value in camera.offset)
    lens = {"fov": FIELD_OF_VIEW, "near": 0.01 * size, "far": 100.0 * size}
    _set(viewer["/Cameras/default/rotated/<object>"], **lens, position=[x, z, -y])  # its own frame has y up


def _set(node: meshcat.Visualizer, **properties: Any) -> None:
    for key, value in properties.items():
        node.set_property(key, value)


def _set_background(viewer: meshcat.Visualizer, points: Floats, size: float) -> None:
    top, bottom = _SKY
    _set(viewer["/Background"], top_color=top, bottom_color=bottom)
    _set(viewer["/Grid"], visible=False)
    _set(viewer["/Axes"], visible=False)
    square = 8.0 * size * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    sheet = mg.TriangularMeshGeometry(square, np.array([[0, 1, 2], [0, 2, 3]]))
    # One-sided (side=0): from below one looks through it.
    viewer["floor"].set_object(sheet, mg.MeshLambertMaterial(color=_FLOOR[0], emissive=_FLOOR[1], side=0))
    low, high, pose = points.min(axis=0), points.max(axis=0), np.eye(4)
    pose[:3, 3] = [*(0.5 * (low + high))[:2], low[2] - 1e-4 * size]
    viewer["floor"].set_transform(pose)


def _set_lights(viewer: meshcat.Visualizer, size: float) -> None:
    """One key light with soft shadows from the upper left, two weak ones, and the ambient."""
    for name, at, looks in (
        (
            "SpotLight",
            (-1.1, -1.5, 2.4),
            {"intensity": 0.32, "castShadow": True, "angle": 0.45, "penumbra": 0.9},
        ),
        ("PointLightNegativeX", (2.2, -1.4, 0.9), {"intensity": 0.16, "distance": 0.0}),
        ("PointLightPositiveX", (-2.2, -1.6, 0.7), {"intensity": 0.12, "distance": 0.0}),
        ("FillLight", (0.3, -0.4, 1.0), {"intensity": 0.12}),  # of this one the direction alone counts
        ("AmbientLight", None, {"intensity": 0.46}),
    ):
        path = f"/Lights/{name}/<object>"
        if at is not None:
            _set(viewer[path], position=[size * x for x in at])
        for key, value in looks.items():  # as a message, since meshcat lowers the case of their names
            viewer.window.take({"type": "set_property", "path": path, "property": key, "value": value})
    _set(viewer["/Lights/SpotLight"], visible=True)
