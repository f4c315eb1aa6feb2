r"""Block sums of weighted rows, X'X, X'r, r'r, C'C, C'X, C'r: all that least squares on any choice of blocks needs.

``X`` are columns of the model as it stands, ``C`` of one candidate, ``r`` the residual, all over the floor of their
joint: fitting on some blocks and judging on the others costs no pass over the rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.data.samples import Sample


@dataclass(frozen=True, eq=False)
class Base:
    """The model as it stands on one sample."""

    sample: Sample  # the rows
    columns: Mapping[int, Floats]  # joint -> weighted columns of the model, shape (m, b)
    residual: Mapping[int, Floats]  # joint -> weighted residual, shape (m,)
    floor: Mapping[int, float]  # joint -> by what rows are divided [N or N·m]
    XX: Floats  # shape (blocks, joints, b, b)
    Xr: Floats  # shape (blocks, joints, b)
    rr: Floats  # shape (blocks, joints)


@dataclass(frozen=True, eq=False)
class Products:
    """Sums of one candidate's columns on one sample; blocks first, summed over its joints."""

    CC: Floats  # shape (blocks, p, p)
    CX: Floats  # shape (blocks, p, b)
    Cr: Floats  # shape (blocks, p)
    rr: Floats  # residual's own square at the joints the candidate acts on, shape (blocks,)


def base_of(sample: Sample, columns: Mapping[int, Floats], floor: Mapping[int, float], width: int) -> Base:
    """Return the sums of a model on a sample: joint -> columns of shape (m, b), none for zero; ``width`` is b."""
    K, joints = sample.blocks, sample.joints
    XX, Xr = np.zeros((K, len(joints), width, width)), np.zeros((K, len(joints), width))
    rr = np.zeros((K, len(joints)))
    weighted, residual = {}, {}
    for at, j in enumerate(joints):
        r = sample.residual[j] / floor[j]
        X = columns[j] / floor[j] if j in columns else np.zeros((len(r), width))
        weighted[j], residual[j] = X, r
        for k, part in _parts(sample, j):
            XX[k, at] = X[part].T @ X[part]
            Xr[k, at] = X[part].T @ r[part]
            rr[k, at] = r[part] @ r[part]
    return Base(sample, weighted, residual, floor, XX, Xr, rr)


def products(base: Base, columns: Mapping[int, Floats]) -> Products:
    """Return the sums of a candidate, given its columns (not weighted) at the joints it acts on."""
    first = next(iter(columns.values()))
    p, b, K = first.shape[1], base.Xr.shape[2], base.sample.blocks
    CC, CX, Cr, rr = np.zeros((K, p, p)), np.zeros((K, p, b)), np.zeros((K, p)), np.zeros(K)
    for j, raw in columns.items():
        C = raw / base.floor[j]
        X, r = base.columns[j], base.residual[j]
        for k, part in _parts(base.sample, j):
            c = C[part]
            CC[k] += c.T @ c
            if b:
                CX[k] += c.T @ X[part]
            Cr[k] += c.T @ r[part]
            rr[k] += r[part] @ r[part]
    return Products(CC, CX, Cr, rr)


def _parts(sample: Sample, joint: int) -> list[tuple[int, slice]]:
    starts = sample.starts[joint]
    return [(k, slice(int(a), int(b))) for k, (a, b) in enumerate(pairwise(starts))]
