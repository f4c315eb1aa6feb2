"""What a twin leaves of its own logs, predicted part by part from the others (blocked cross-validation).

That is noise *and* everything the model never had: the floor. A later log differs only by what exceeds it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.errors import TwinError
from pinotwin.motion import Motion

FILE = "misfit.npz"
_DOUBLE = ("t", "q", "qr", "ql")
"""Channels that are differentiated or compared closely; single precision does for the others."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """The twin's own logs, and what it leaves of them when it does not know them."""

    motion: Motion  # the own logs as prepared, long ones in part
    fold: Ints  # part of the cross-validation that each row belongs to, shape (n,)
    theta: Floats  # coefficients with which that part was predicted, shape (folds, p)
    # axis -> size by regime, spectrum and correlation time; what ``twin.json`` shows
    summary: Mapping[str, Any]
    log: Ints  # number of the log that each row is of, shape (n,)

    def __repr__(self) -> str:
        sizes = ", ".join(f"{k} {v['moving']:.3g} {v['unit']}" for k, v in self.summary.items())
        return f"Misfit({sizes}; {len(self.motion)} rows)"


def write_misfit(misfit: Misfit, path: Path) -> None:
    """Write the own logs and the parts' coefficients."""
    arrays: dict[str, Any] = {"fold": misfit.fold.astype(np.int8), "theta": misfit.theta, "log": misfit.log}
    for f in fields(Motion):
        value = getattr(misfit.motion, f.name)
        if isinstance(value, np.ndarray):
            single = value.dtype == np.float64 and f.name not in _DOUBLE
            arrays[f"motion_{f.name}"] = value.astype(np.float32) if single else value
        elif f.name == "segments":
            arrays["motion_segments"] = np.array([(s.start, s.stop) for s in value], dtype=np.int64)
        elif value is not None and f.name not in ("names", "rotary", "notes"):
            arrays[f"motion_{f.name}"] = np.array(value)
    with path.open("wb") as out:
        np.savez_compressed(out, **arrays)


def read_misfit(
    path: Path, names: tuple[str, ...], rotary: tuple[bool, ...], summary: Mapping[str, Any]
) -> Misfit:
    """Read what :func:`write_misfit` wrote; TwinError if it is damaged or of another machine."""
    try:
        with np.load(path, allow_pickle=False) as data:
            found = {k: data[k] for k in data.files}
        motion = _motion(found, names, rotary)
        fold, theta = found["fold"].astype(np.intp), found["theta"].astype(float)
        if len(fold) != len(motion) or motion.q.shape[1] != len(names):
            raise ValueError("its arrays do not fit the machine")
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise TwinError(f"{path}: damaged ({error}); identify the twin again") from None
    return Misfit(motion, fold, theta, summary, found.get("log", np.zeros_like(fold)))


def _motion(found: Mapping[str, Any], names: tuple[str, ...], rotary: tuple[bool, ...]) -> Motion:
    values: dict[str, Any] = {}
    for f in fields(Motion):
        key = f"motion_{f.name}"
        if key not in found:
            continue
        x = found[key]
        if f.name == "segments":
            values[f.name] = tuple(slice(int(a), int(b)) for a, b in x)
        elif x.ndim == 0:
            values[f.name] = x.item()
        elif f.name == "on_load":
            values[f.name] = tuple(x.tolist())
        else:
            values[f.name] = x.astype(float) if x.dtype == np.float32 else x
    return Motion(names=names, rotary=rotary, **values)
