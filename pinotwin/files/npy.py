"""NumPy arrays: ``.npy`` (one array) and ``.npz`` (several by name)."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from pinotwin.errors import LogError
from pinotwin.files.content import Content


def load(path: Path, source: str) -> Content:
    """Return the content of a NumPy file; a nameless array is ``stem[0]``, ``stem[1]``..."""
    content = Content()
    try:
        stored = np.load(path, allow_pickle=False)
        named = dict(stored) if isinstance(stored, np.lib.npyio.NpzFile) else {"": stored}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise LogError(f"{source}: {_remedy(error)}") from None
    for name, x in named.items():
        if name or x.dtype.names:
            content.add(name, x)
        else:
            content.add(path.stem, x[None] if x.ndim == 1 else x)
            # One vector still is `stem[0]`, so that a mapping by `[0]` finds it.
            if x.ndim == 1 and path.stem in content.arrays:
                content.arrays[f"{path.stem}[0]"] = content.arrays.pop(path.stem)[0]
    return content


def _remedy(error: Exception) -> str:
    if "pickle" in str(error).lower() or "object array" in str(error).lower():
        return "holds Python objects, and a pickle can run code; save it as plain numbers"
    return f"is damaged or cut off ({str(error).splitlines()[0][:80]}); record or copy it again"
