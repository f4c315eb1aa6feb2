"""NumPy arrays: ``.npy`` (one array) and ``.npz`` (several by name)."""

from __future__ import annotations

import math
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import IO

import numpy as np

from pinotwin.errors import LogError
from pinotwin.logs.files.content import BROKEN, Content, held, limited, undamaged

_BROKEN = (*BROKEN, SyntaxError, tokenize.TokenError, zipfile.BadZipFile, zlib.error)


def _numbers(path: Path, source: str) -> int:
    """Return how many numbers the headers of a file promise, before they are made; LogError for Python objects."""
    if not zipfile.is_zipfile(path):
        with path.open("rb") as file:
            return _promised(file, source)
    total = 0
    with zipfile.ZipFile(path) as packed:
        for item in packed.infolist():
            with packed.open(item.filename) as file:
                total += _promised(file, source) if item.filename.endswith(".npy") else item.file_size // 8
    return total


def _promised(file: IO[bytes], source: str) -> int:
    """Return how many numbers the header of an array promises, one at least along each dimension."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = read(file)
    if kind.hasobject:
        raise LogError(f"{source}: holds Python objects, and a pickle can run code; save it as plain numbers")
    return math.prod(max(1, n) for n in shape) * held(kind)


def load(path: Path, source: str) -> Content:
    """Return the content of a NumPy file; a nameless array is ``stem[0]``, ``stem[1]``..."""
    content = Content()
    with undamaged(source, _BROKEN):
        limited(source, _numbers(path, source), path.stat().st_size)
        stored = np.load(path, allow_pickle=False)
        named = dict(stored) if isinstance(stored, np.lib.npyio.NpzFile) else {"": stored}
    for name, x in named.items():
        if not name and not x.dtype.names:
            name = (
                f"{path.stem}[0]" if x.ndim == 1 else path.stem
            )  # a mapping by `[0]` finds a single vector, too
        content.add(name, x)
    return content
