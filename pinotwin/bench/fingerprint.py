"""A fingerprint of the code that makes answers: an answer of other code is not the same answer."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
ONLY_SHOWN = ("report", "viewer", "cli", "imu", "reconstruction")
"""Parts of the package that no answer depends on."""
ONLY_COUNTED = ("scoring", "table", "statistics")
"""Modules of the bench that look at answers which are there already."""


@functools.cache
def fingerprint() -> str:
    """Return a hash of all sources that an answer depends on, and of the bundled machines."""
    from pinotwin.machine.bundled import machines

    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        part = path.relative_to(PACKAGE).parts
        if part[0] in ONLY_SHOWN or (part[0] == "bench" and path.stem in ONLY_COUNTED):
            continue
        digest.update("/".join(part).encode() + path.read_bytes())
    for folder in machines().values():
        for path in sorted(folder.iterdir()):
            digest.update(path.read_bytes() if path.is_file() else b"")
    return digest.hexdigest()[:12]
