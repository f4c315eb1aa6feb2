"""A twin for other tools: URDF, MuJoCo, and the inverse model as one NumPy or C file."""

from pinotwin.export.files import Export as Export
from pinotwin.export.files import export_twin as export_twin
