"""Looking at a machine: meshcat through Pinocchio's visualiser, as one page or in the browser."""

from pinotwin.viewer.play import Live, play, save_html, show
from pinotwin.viewer.posture import configuration, joint_kinds, parse_posture
from pinotwin.viewer.scene import Scene, colour, draw, missing_meshes, scene, visual_model

__all__ = [
    "Live",
    "Scene",
    "colour",
    "configuration",
    "draw",
    "joint_kinds",
    "missing_meshes",
    "parse_posture",
    "play",
    "save_html",
    "scene",
    "show",
    "visual_model",
]
