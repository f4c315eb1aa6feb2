"""Base parameters: the smallest set that fixes the joint efforts of a machine.

With ``W`` the regressor at many random motions (beyond the limits: the rank is the same, and well conditioned), the
base columns W_b are independent columns of W, the others combinations of them, W = W_b P, and

    tau = W pi = W_b beta,   beta = P pi

Columns are taken from the base outwards, each kept if it is no combination of those before (QR, columns of unit
length): parameters of outer bodies are regrouped into inner ones (Gautier 1991, doi:10.1002/rob.4620080405; Khalil,
Dombre 2002, ISBN 978-1-903996-66-9). A joint's rotor inertia comes first and takes up what a link adds in the same
way: M_Y = m_Y + Ja_Y stays free of the axes that carry Y. Products of inertia are tensor elements. What one log can
distinguish: :mod:`pinotwin.dynamics.excitation`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy

from pinotwin.arrays import Floats, Ints
from pinotwin.dynamics.batch import regressor
from pinotwin.dynamics.parameters import body_count, parameter_count, parameter_names, parameter_units

# Order within a body: tensor (Iyy before Ixx, so that sums read Iyy - Ixx), first moments, mass.
_BODY_ORDER = (0, 1, 2, 3, 6, 4, 5, 7, 8, 9)


@dataclass(frozen=True)
class BaseParameters:
    """Which sums of standard parameters the joint efforts depend on."""

    P: Floats  # beta = P @ pi, shape (b, p); exactly 1 and 0 in the independent columns
    independent: Ints  # indices into ``pi``: W[:, :, independent] @ beta == W @ pi, shape (b,)
    names: tuple[str, ...]  # every base parameter written out, e.g. ``Iyy_B + Ixx_C + 0.0064 m_C + Ja_B``
    labels: tuple[str, ...]  # a short unique name each, e.g. ``Iyy_B*``; the star marks a sum
    units: tuple[str, ...]  # SI unit of each
    without_effect: tuple[str, ...]  # names of the standard parameters that no effort depends on

    def __len__(self) -> int:
        return len(self.independent)

    def from_standard(self, pi: Floats) -> Floats:
        """Return beta = P pi, shape (b,)."""
        return self.P @ np.asarray(pi, dtype=float)

    def regressor(self, model: pin.Model, q: Floats, v: Floats, a: Floats) -> Floats:
        """Return W_b with W_b @ beta = joint effort, shape (n, nv, b)."""
        return regressor(model, q, v, a, self.independent)


def base_parameters(model: pin.Model, *, seed: int = 0, tolerance: float = 1e-5) -> BaseParameters:
    """Return the base parameters of a model's geometry; the result does not depend on ``seed``.

    A column is a combination of others if all but the share ``tolerance`` of it is one: forgives angles as 1.5708.
    """
    names = parameter_names(model)
    rng, n = np.random.default_rng(seed), 50 + 4 * parameter_count(model) // max(model.nv, 1)
    q, v, a = (rng.uniform(-size, size, (n, model.nv)) for size in (np.pi, 3.0, 10.0))
    moves = regressor(model, q, v, a).reshape(n * model.nv, -1)  # at least four rows a column
    W = np.linalg.qr(moves, mode="r")  # the same products, fewer rows
    norms = np.linalg.norm(W, axis=0)
    alive = norms > 1e-12 * norms.max(initial=1e-300)
    priority: list[int] = []  # all parameters in the order in which they are tried as independent
    for i in range(1, model.njoints):
        joint = model.joints[i]
        priority += [10 * body_count(model) + joint.idx_v + k for k in range(joint.nv)]
        priority += [10 * (i - 1) + k for k in _BODY_ORDER]
    scaled = W / np.where(alive, norms, 1.0)
    kept, K, level = _regroup(scaled, [k for k in priority if alive[k]], tolerance)
    joint_by_joint = np.argsort([priority.index(k) for k in kept])
    chosen = np.array(kept, dtype=np.intp)[joint_by_joint]
    K = K[joint_by_joint] * (np.where(alive, norms, 0.0) / norms[chosen][:, None])
    whole = np.round(K)  # integers that K misses by rounding alone
    P = np.where(np.abs(K - whole) < level * np.abs(whole), whole, K) + 0.0  # no negative zeros
    P[:, chosen] = np.eye(len(chosen))
    units = parameter_units(model)
    return BaseParameters(
        P,
        chosen,
        tuple(combination(row, names) for row in P),
        labels(P, chosen.tolist(), names),
        tuple(units[k] for k in chosen),
        tuple(name for name, used in zip(names, alive, strict=True) if not used),
    )


def _regroup(scaled: Floats, order: Sequence[int], tolerance: float) -> tuple[list[int], Floats, float]:
    """Return the independent columns, K with scaled = scaled[:, independent] K, and K's noise."""
    Q = np.empty((len(scaled), len(order)))
    kept: list[int] = []
    rejected: list[tuple[int, float]] = []
    for k in order:
        base = Q[:, : len(kept)]
        rest = scaled[:, k] - base @ (base.T @ scaled[:, k])
        rest -= base @ (base.T @ rest)  # twice is enough (Giraud et al. 2005)
        size = float(np.linalg.norm(rest))
        if size > tolerance and len(kept) < len(scaled):
            Q[:, len(kept)] = rest / size
            kept.append(k)
        else:
            rejected.append((k, size))
    base = Q[:, : len(kept)]
    R = base.T @ scaled[:, kept]
    K = np.zeros((len(kept), scaled.shape[1]))
    K[range(len(kept)), kept] = 1.0
    for k, _ in rejected:
        K[:, k] = scipy.linalg.solve_triangular(R, base.T @ scaled[:, k])
    # Rounded angles in the URDF leave residues of their size; exact ones only those of arithmetic.
    level = max(1e-10, min(tolerance, 10.0 * max((size for _, size in rejected), default=0.0)))
    return kept, np.where(np.abs(K) > level, K, 0.0), level


def _rank(name: str, position: int) -> tuple[int, int, int]:
    """Return a sort key: from the base outwards inertias, moments, mass; then rotors."""
    kind = 1 if name.startswith(("mx_", "my_", "mz_")) else {"I": 0, "m": 2, "J": 3}[name[0]]
    body = 0 if kind == 3 else position // 10
    return (kind == 3, body, kind * 100 + position % 10)


def combination(coefficients: Floats, names: Sequence[str]) -> str:
    """Return a sum of parameters (p,) in words, such as ``Iyy_B + Ixx_C + 0.0064 m_C + Ja_B``."""
    terms = sorted(np.flatnonzero(coefficients).tolist(), key=lambda k: _rank(names[k], k))
    text = ""
    for k in terms:
        value = float(coefficients[k])
        size = f"{abs(value):.4g}"
        factor = "" if size == "1" else f"{size} "
        sign = (" - " if value < 0 else " + ") if text else ("-" if value < 0 else "")
        text += f"{sign}{factor}{names[k]}"
    return text


def labels(P: Floats, independent: Sequence[int], names: Sequence[str]) -> tuple[str, ...]:
    """Return one short, unique name for every row of ``P``; a star says that it is a grouping."""
    # After the innermost parameter of its own kind that enters a row with factor one, if still free.
    out: list[str] = []
    for row, own in zip(P, independent, strict=True):
        ones = sorted(np.flatnonzero(row == 1.0).tolist(), key=lambda k: _rank(names[k], k))
        star = "*" if np.count_nonzero(row) > 1 else ""
        kinds = ("I", "m_", "J") if names[own].startswith("J") else (names[own][:2],)
        choices = [names[k] for kind in kinds for k in ones if names[k].startswith(kind)]
        label = next((c for c in choices if f"{c}{star}" not in out), names[own])
        out.append(f"{label}{star}")
    return tuple(out)
