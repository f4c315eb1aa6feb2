"""NumPy arrays: ``.npy`` (one array) and ``.npz`` (several by name)."""

from __future__ import annotations

import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np

from pinotwin.errors import LogError
from pinotwin.logs.files.content import Content, damaged

# What NumPy lets through when header or body are damaged.
_BROKEN = (
    ValueError,
    TypeError,
    KeyError,
    SyntaxError,
    tokenize.TokenError,
    MemoryError,
    OverflowError,
    OSError,
    EOFError,
    zipfile.BadZipFile,
    zlib.error,
)


def load(path: Path, source: str) -> Content:
    """Return the content of a NumPy file; a nameless array is ``stem[0]``, ``stem[1]``..."""
    content = Content()
    try:
        stored = np.load(path, allow_pickle=False)
        named = dict(stored) if isinstance(stored, np.lib.npyio.NpzFile) else {"": stored}
    except _BROKEN as error:
        if "pickle" in str(error).lower() or "object array" in str(error).lower():
            raise LogError(
                f"{source}: holds Python objects, and a pickle can run code; save it as plain numbers"
            ) from None
        raise damaged(source, error) from None
    for name, x in named.items():
        if name or x.dtype.names:
            content.add(name, x)
        else:
            content.add(path.stem, x[None] if x.ndim == 1 else x)
            # One vector still is `stem[0]`, so that a mapping by `[0]` finds it.
            if x.ndim == 1 and path.stem in content.arrays:
                content.arrays[f"{path.stem}[0]"] = content.arrays.pop(path.stem)[0]
    return content
