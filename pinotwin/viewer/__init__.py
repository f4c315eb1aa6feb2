"""Looking at a machine: drawn by meshcat in the browser, as one page."""

from pinotwin.viewer.posture import configuration, joint_kinds, parse_posture
from pinotwin.viewer.scene import Scene, colour, draw, missing_meshes, scene, visual_model
from pinotwin.viewer.show import View, view

__all__ = [
    "Scene",
    "View",
    "colour",
    "configuration",
    "draw",
    "joint_kinds",
    "missing_meshes",
    "parse_posture",
    "scene",
    "view",
    "visual_model",
]
