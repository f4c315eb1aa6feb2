"""A twin for other tools: URDF, MuJoCo, and the inverse model as one NumPy or C file.

``pt.export`` is the verb, too: a loaded package takes its place as an attribute of ``pinotwin``, so it can be called.
"""

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from pinotwin.export.files import Export as Export
from pinotwin.export.files import export_twin as export_twin
from pinotwin.twin.twin import TwinLike

export = export_twin


class _Verb(ModuleType):
    def __call__(self, twin: TwinLike, format: str, out: str | Path, **options: Any) -> Export:
        return export_twin(twin, format, out, **options)


sys.modules[__name__].__class__ = _Verb
