"""Looking at a machine: drawn by meshcat in the browser, as one page."""

from pinotwin.viewer.scene import Scene, colour, draw, missing_meshes, visual_model
from pinotwin.viewer.show import View, parse_posture, view

__all__ = ["Scene", "View", "colour", "draw", "missing_meshes", "parse_posture", "view", "visual_model"]
