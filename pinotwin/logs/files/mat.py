"""MATLAB files up to v7.2 (v7.3 files are HDF5 and go to :mod:`pinotwin.logs.files.hdf5`)."""

from __future__ import annotations

import contextlib
import math
import warnings
import zlib
from pathlib import Path

import numpy as np
import scipy.io
from scipy.io.matlab import MatReadError, MatReadWarning, mat_struct

from pinotwin.logs.files.content import BROKEN, Content, limited, undamaged

_BROKEN = (*BROKEN, MatReadError, UnboundLocalError, zlib.error)  # an UnboundLocalError is scipy's own bug


def load(path: Path, source: str) -> Content:
    """Return the variables of a MAT file; fields of a struct get dotted names (``rec.act_pos``)."""
    content = Content()
    quiet = warnings.catch_warnings(action="ignore", category=MatReadWarning)
    with undamaged(source, _BROKEN), quiet:
        with contextlib.suppress(TypeError):  # scipy cannot list what stands beside objects
            stated = sum(math.prod(shape) for _, shape, _ in scipy.io.whosmat(path))
            limited(source, stated, path.stat().st_size)
        stored = scipy.io.loadmat(path, struct_as_record=False, squeeze_me=True)
    for name, value in stored.items():
        if not str(name).startswith("__") and str(name) != "None":
            _flatten(str(name), value, content)
    return content


def _flatten(name: str, value: object, content: Content) -> None:
    if isinstance(value, mat_struct):
        for part in value._fieldnames:
            _flatten(f"{name}.{part}", getattr(value, part), content)
    elif isinstance(value, np.ndarray) and value.dtype == object and value.size:
        structs = [x for x in value.flat if isinstance(x, mat_struct)]
        if len(structs) == value.size and value.size <= 16:
            for i, item in enumerate(structs):
                _flatten(f"{name}[{i}]", item, content)
        else:
            content.left_out.append(name)
    else:
        content.add(name, value)
