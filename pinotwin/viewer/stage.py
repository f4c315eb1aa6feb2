"""Light, background, floor and camera that show a machine whole, and its still picture, drawn without a browser.

The camera, front right and a little above, stands just far enough for every corner of the bounding boxes. The still, by
a depth buffer, is for pages that are printed or on a phone: edges are darkened where the body or the direction of the
surface changes, as in a technical drawing.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import meshcat
import meshcat.geometry as mg
import numpy as np
import pinocchio as pin

from pinotwin.arrays import Floats, Ints
from pinotwin.system.kernels import compiled
from pinotwin.viewer.meshes import GREY, Colour, Rgba, parts_of

FIELD_OF_VIEW = 28.0  # Vertical opening of the camera [deg]: a long lens keeps parallel edges nearly parallel

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
    key = {"intensity": 0.32, "castShadow": True, "angle": 0.45, "penumbra": 0.9}
    for name, at, looks in (
        ("SpotLight", (-1.1, -1.5, 2.4), key),
        ("PointLightNegativeX", (2.2, -1.4, 0.9), {"intensity": 0.16, "distance": 0.0}),
        ("PointLightPositiveX", (-2.2, -1.6, 0.7), {"intensity": 0.12, "distance": 0.0}),
        ("FillLight", (0.3, -0.4, 1.0), {"intensity": 0.12}),  # of this one the direction alone counts
        ("AmbientLight", None, {"intensity": 0.46}),
    ):
        path = f"/Lights/{name}/<object>"
        if at is not None:
            _set(viewer[path], position=[size * x for x in at])
        for look, value in looks.items():  # as a message, since meshcat lowers the case of their names
            viewer.window.take({"type": "set_property", "path": path, "property": look, "value": value})
    _set(viewer["/Lights/SpotLight"], visible=True)


BASE = (0.52, 0.55, 0.58)
_LIGHT = np.array([0.25, -0.65, 0.72]) / np.linalg.norm([0.25, -0.65, 0.72])


@dataclass(frozen=True)
class Still:
    """A PNG, its width and height, and joint name -> where the middle of what it carries lies in it [pixels]."""

    png: bytes
    size: tuple[int, int]
    joints: Mapping[str, tuple[float, float]]


def still(
    model: pin.Model,
    visual: pin.GeometryModel,
    q: Floats,
    colours: Mapping[str, Colour] | None = None,
    size: tuple[int, int] = (760, 480),
    fine: int = 2,
) -> Still:
    """Draw a machine at q (nq,), width and height [pixels], ``fine`` samples a pixel, in its or other ``colours``."""
    from PIL import Image

    bodies = triangles_of(model, visual, q)
    width, height = size[0] * fine, size[1] * fine
    camera = aim(corners(model, visual, q))
    shown = [_project(triangles, camera, width, height) for _, triangles, _ in bodies]
    depth = np.full((height, width), np.inf)
    shade, owner = np.zeros((height, width)), np.full((height, width), -1, dtype=np.int64)
    for k, ((_, triangles, _), flat) in enumerate(zip(bodies, shown, strict=True)):
        _fill(flat, _shades(triangles), k, depth, shade, owner)
    if colours is None:
        own = [rgba[:3] for _, _, rgba in bodies]
    else:
        own = [colours.get(model.names[j], BASE if j == 0 else GREY) for j, _, _ in bodies]
    paint = np.array(own or [GREY])
    rgb = paint[np.maximum(owner, 0)] * (0.45 + 0.55 * shade * _edges(owner, shade))[..., None]
    rgba = np.concatenate([rgb, (owner >= 0).astype(float)[..., None]], axis=2)
    rgba[..., :3] *= rgba[..., 3:]
    small = rgba.reshape(size[1], fine, size[0], fine, 4).mean(axis=(1, 3))
    small[..., :3] /= np.maximum(small[..., 3:], 1e-6)
    held = io.BytesIO()
    image = Image.fromarray(np.round(255 * np.clip(small, 0.0, 1.0)).astype(np.uint8), "RGBA")
    image.quantize(128, method=Image.Quantize.FASTOCTREE).save(held, "PNG", optimize=True)
    middles = _middles(model, bodies, shown, owner).items()
    return Still(held.getvalue(), size, {name: (x / fine, y / fine) for name, (x, y) in middles})


def _middles(
    model: pin.Model, bodies: Sequence[tuple[int, Floats, Rgba]], shown: Sequence[Floats], owner: Ints
) -> dict[str, tuple[float, float]]:
    """Return the middle of what is seen of every joint's body; of a hidden one, of what is there [samples]."""
    out = {}
    for j in range(1, model.njoints):
        mine = [k for k, (joint, _, _) in enumerate(bodies) if joint == j]
        if not mine:
            continue
        y, x = np.nonzero(np.isin(owner, mine))
        if len(x) > 50:
            middle = np.array([np.median(x), np.median(y)])
        else:
            middle = np.concatenate([shown[k] for k in mine])[..., :2].reshape(-1, 2).mean(axis=0)
        out[str(model.names[j])] = (float(middle[0]), float(middle[1]))
    return out


def triangles_of(model: pin.Model, visual: pin.GeometryModel, q: Floats) -> list[tuple[int, Floats, Rgba]]:
    """Return joint, triangles in the world, of shape (m, 3, 3) [m], and colour of every part of every shape."""
    placed, out = visual.createData(), []
    pin.updateGeometryPlacements(model, model.createData(), visual, placed, q)
    for shape, pose in zip(visual.geometryObjects, placed.oMg, strict=True):
        for part in parts_of(shape):
            world = part.vertices @ pose.rotation.T + pose.translation
            out.append((int(shape.parentJoint), world[part.faces], part.rgba or (*GREY, 1.0)))
    return out


def _project(triangles: Floats, camera: Camera, width: int, height: int) -> Floats:
    """Return corners as column, row [samples] and depth [m], shape (m, 3, 3)."""
    right, up, back = camera.axes()
    seen = triangles - camera.target
    deep = float(np.linalg.norm(camera.offset)) - seen @ back
    scale = 0.5 * height / math.tan(math.radians(FIELD_OF_VIEW) / 2)
    x = 0.5 * width + scale * (seen @ right) / deep
    y = 0.5 * height - scale * (seen @ up) / deep
    return np.stack([x, y, deep], axis=-1)


def _shades(triangles: Floats) -> Floats:
    """Return how bright each triangle is, 0 to 1, whichever way it is wound."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    lit = np.abs(normal @ _LIGHT)
    return np.asarray(0.25 + 0.75 * lit)


@compiled
def _fill(flat: Floats, bright: Floats, own: int, depth: Floats, shade: Floats, owner: Ints) -> None:
    """Draw projected triangles into the buffers."""
    height, width = depth.shape
    for k in range(flat.shape[0]):
        (x0, y0, z0), (x1, y1, z1), (x2, y2, z2) = flat[k, 0], flat[k, 1], flat[k, 2]
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if abs(area) < 1e-9 or min(z0, z1, z2) <= 0.0:
            continue
        left, right = max(0, int(min(x0, x1, x2))), min(width - 1, int(max(x0, x1, x2)) + 1)
        top, bottom = max(0, int(min(y0, y1, y2))), min(height - 1, int(max(y0, y1, y2)) + 1)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                a = ((x1 - column) * (y2 - row) - (x2 - column) * (y1 - row)) / area
                b = ((x2 - column) * (y0 - row) - (x0 - column) * (y2 - row)) / area
                c = 1.0 - a - b
                if a >= 0.0 and b >= 0.0 and c >= 0.0:
                    z = a * z0 + b * z1 + c * z2
                    if z < depth[row, column]:
                        depth[row, column] = z
                        shade[row, column] = bright[k]
                        owner[row, column] = own


def _edges(owner: Ints, shade: Floats) -> Floats:
    """Return 1, and less where the body or the brightness changes from one sample to the next."""
    out = np.ones(shade.shape)
    for axis in (0, 1):
        for step in (1, -1):
            other, bright = np.roll(owner, step, axis), np.roll(shade, step, axis)
            out[other != owner] = 0.45
            out[(other == owner) & (np.abs(bright - shade) > 0.12)] *= 0.75
    return out
