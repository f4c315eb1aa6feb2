"""Names for arrays in signatures, and their plain form for JSON; times run down the rows.

Shapes are told in the docstrings: ``n`` samples, ``nv`` joints of the model, ``p`` parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Mask = NDArray[np.bool_]


def mapped(value: Any, leaf: Callable[[Any], Any]) -> Any:
    """Return nested dicts, lists and tuples as dicts and lists, with ``leaf`` of what is none of them."""
    if isinstance(value, dict):
        return {key: mapped(x, leaf) for key, x in value.items()}
    return [mapped(x, leaf) for x in value] if isinstance(value, list | tuple) else leaf(value)


def plain(value: Any) -> Any:
    """Return ``value`` with arrays as lists and numbers that JSON has no word for as None."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, set)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray | np.generic):
        good = value.dtype.kind in "biu" or (value.dtype.kind == "f" and bool(np.isfinite(value).all()))
        return value.tolist() if good else plain(value.tolist())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
