"""What a twin does not know of itself: the errors of its own coefficients, as columns of the effort."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.motion import Motion
from pinotwin.twin import Twin


def unsure(twin: Twin, m: Motion, most: int = 24) -> Floats:
    """Return efforts of every axis that the twin's errors may be off by, independent and of one sigma, (n, nv, most).

    They are the largest of all combinations of its coefficients.
    """
    known = np.nan_to_num(twin.covariance, posinf=0.0)
    values, vectors = np.linalg.eigh(known)
    spread, scene, nv = vectors * np.sqrt(np.maximum(values, 0.0)), twin.scene(m), twin.machine.nv
    each = np.zeros((len(m), nv, spread.shape[1]))
    for effect, where in zip(twin.effects, twin.slices, strict=True):
        columns = effect.columns(scene)
        each[:, list(columns.joints)] += columns.values @ spread[where]
    out = np.zeros((len(m), nv, most))
    for j in range(nv):
        U, size, _ = np.linalg.svd(each[:, j], full_matrices=False)
        out[:, j, : len(size)] = (U * size)[:, :most]
    return out
