r"""A loop whose effort row follows from its error row: u - d must move the known mass.

With M_D and C known, u = d + M (ar - e'') + C (vr - e'). Over unit-gain states x' = A x + B w, e = c x, and with

    c B = 0,  c A B = 1/M   (own disturbance),      c B = 1,  c A B = 0   (velocity of the command)

all direct terms fall out and u = -(M c A² + C c A) x: one row of residues for both outputs. Fitted apart, the rows
agree only where the log has power; above, where a hammer has most of its own, the tie decides. One real pole is added
for the lag of drive and velocity filter. The poles are polished with the residues projected out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from pinotwin.arrays import Floats, Ints
from pinotwin.loop import LoopData, LoopModel, ModalStep, Section
from pinotwin.loop.identify import account
from pinotwin.loop.layout import lay_out
from pinotwin.loop.projection import Scales
from pinotwin.solve.sandwich import block_covariance


def with_lag(model: LoopModel, start: float = 150.0) -> LoopModel:
    """Return a loop with a real pole more, for drive and filters, from ``start`` [Hz] or what the sampling allows."""
    structure = replace(model.structure, real_poles=model.structure.real_poles + 1)
    count = sum(s.order == 1 and not s.feedforward for s in model.sections)
    shape = (len(model.disturbances), len(model.outputs))
    layout = lay_out(structure, model.step, shape)
    name = f"p{count + 1}"
    (bound,) = (p for p in layout.parameters if p.name == name)
    lag = 2.0 * np.pi * min(start, 0.9 * bound.upper)
    sections = (*model.sections[:count], Section(name, 1, (lag,)), *model.sections[count:])
    residues = np.zeros((shape[1], layout.residues))
    return replace(model, structure=structure, sections=sections, residues=residues, fit=None)


def tied(data: LoopData, model: LoopModel, inertia: float, viscous: float, most: int = 25) -> LoopModel:
    """Return a loop, if its form allows, with rows e and u tied by M_D [kg or kg·m²] and C, in ``most`` evaluations."""
    s = model.structure
    if len(model.outputs) != 2 or len(model.disturbances) != 1 or s.direct or s.numerators != "exact":
        return model
    problem, lengths = _Problem(data, model, inertia, viscous), [s.stop - s.start for s in data.segments]
    low, high = model.layout.box
    start = np.clip(model.theta, low + 1e-9, high - 1e-9)
    options = {"bounds": (low, high), "max_nfev": most, "xtol": 1e-4, "ftol": 1e-6}
    best = scipy.optimize.least_squares(lambda x: problem.solve(x)[1], start, diff_step=1e-4, **options)
    variances, ends = np.diag(block_covariance(best.jac, best.fun)), np.cumsum([2 * n for n in lengths])
    left = np.concatenate([part.reshape(2, -1) for part in np.split(best.fun, ends[:-1])], axis=1)
    told = account(
        data, model.layout, best.x, variances, left, blocks=len(lengths), evaluations=most, ends=(1.0,)
    )
    return replace(problem.model_at(best.x), fit=told)


@dataclass(frozen=True)
class _Problem:
    """Both rows of one loop as one linear problem at given poles."""

    data: LoopData
    model: LoopModel
    inertia: float
    viscous: float

    @cached_property
    def size(self) -> Floats:
        """RMS of the outputs inside the segments."""
        return Scales.of(self.data).outputs

    @cached_property
    def places(self) -> tuple[Ints, Ints]:
        """Block and state of every residue, shape (nc - 2,) each."""
        orders = [slot.order for slot in self.model.layout.slots]
        return np.repeat(np.arange(len(orders)), orders), np.concatenate([np.arange(n) for n in orders])

    def solve(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return the residues of the error row (nc - 2,) and the weighted residual."""
        modal = self._at(theta).modal()
        N, g = self._ties(modal)
        rows = [self._rows(modal, s) for s in self.data.segments]
        W = np.hstack([np.concatenate([r[0] for r in rows]), scipy.linalg.block_diag(*(r[1] for r in rows))])
        y = np.concatenate([r[2] for r in rows])
        Q, R = np.linalg.qr(np.vstack([N, np.zeros((W.shape[1] - len(N), 4))]), mode="complete")
        fixed = Q[:, :4] @ np.linalg.solve(R[:4].T, g)
        Z = Q[:, 4:]
        A = W @ Z
        size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        z = np.linalg.lstsq(A / size, y - W @ fixed, rcond=1e-12)[0] / size
        c = fixed + Z @ z
        return c[: len(N)], W @ c - y

    def _at(self, theta: Floats) -> LoopModel:
        return replace(self.model, sections=self.model.layout.shaped(theta), fit=None)

    def model_at(self, theta: Floats) -> LoopModel:
        """Return the loop at given poles."""
        trial = self._at(theta)
        c, _ = self.solve(theta)
        modal, (b, i) = trial.modal(), self.places
        own, residues = np.zeros((len(modal.A), 2)), np.zeros_like(self.model.residues)
        own[b, i] = c
        residues[0, : len(c)] = c
        residues[1, : len(c)] = np.einsum("ki,kij->kj", own, self._effort(modal.rate))[b, i]
        return replace(trial, residues=residues)

    def _effort(self, rate: Floats) -> Floats:
        """Return -(M A² + C A) of blocks, shape (k, 2, 2)."""
        return -(self.inertia * rate @ rate + self.viscous * rate)

    def _ties(self, modal: ModalStep) -> tuple[Floats, Floats]:
        """Return N (nc, 4) and g (4,): N.T c = g; in units in which both orders weigh alike."""
        b, i = self.places
        N, w, residues = np.zeros((len(b), 4)), float(np.abs(modal.rate).max()), np.arange(len(b))
        N[residues, 2 * modal.input[b]] = modal.drive[b, i]
        N[residues, 2 * modal.input[b] + 1] = np.einsum("kij,kj->ki", modal.rate, modal.drive)[b, i] / w
        return N, np.array([0.0, 1.0 / (self.inertia * w), 1.0, 0.0])

    def _rows(self, modal: ModalStep, s: slice) -> tuple[Floats, Floats, Floats]:
        """Return weighted columns of the residues and of the unknown start, and the outputs; e first, below it u."""
        w = np.column_stack([self.data.d[s], self.data.vr[s]])
        begun = np.zeros((len(modal.A), 2))
        begun[modal.input == 1, 0] = 1.0
        driven, still = _states(modal, w, modal.equilibrium(w[0])), _states(modal, np.zeros_like(w), begun)
        columns, effort = [], self._effort(modal.rate)
        every = np.ones(len(self.places[0]), dtype=bool)
        for x, kept in ((driven, every), (still, modal.input[self.places[0]] == 1)):
            b, i = (place[kept] for place in self.places)
            u = np.einsum("nkj,kj->nk", x[:, b], effort[b, i])
            columns.append(np.vstack([x[:, b, i] / self.size[0], u / self.size[1]]))
        return columns[0], columns[1], (self.data.outputs[s] / self.size).T.ravel()


def _states(modal: ModalStep, w: Floats, x0: Floats) -> Floats:
    """Return the states of all blocks, shape (n, k, 2)."""
    k = len(modal.A)
    out = np.zeros((len(w), 2 * k))
    modal.respond(w, x0, np.eye(2 * k).reshape(2 * k, k, 2), out)
    return out.reshape(len(w), k, 2)
