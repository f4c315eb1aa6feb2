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

from pinotwin.arrays import Floats
from pinotwin.loop import LoopData, LoopFit, LoopModel, ModalStep, Section
from pinotwin.loop.identify import on_bound, pole_fit
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
    problem = _Problem(data, model, inertia, viscous)
    low, high = model.layout.box
    start = np.clip(model.theta, low + 1e-9, high - 1e-9)
    ends = {"bounds": (low, high), "max_nfev": most, "xtol": 1e-4, "ftol": 1e-6}
    best = scipy.optimize.least_squares(lambda x: problem.solve(x)[1], start, diff_step=1e-4, **ends)
    return replace(problem.model_at(best.x), fit=_account(problem, best.x, best.jac, best.fun, most))


def _account(problem: _Problem, theta: Floats, J: Floats, residual: Floats, most: int) -> LoopFit:
    """Return the poles with their intervals and the errors of the fit."""
    data, layout = problem.data, problem.model.layout
    variances = np.diag(block_covariance(J, residual))
    numbers = zip(layout.parameters, theta, on_bound(layout, theta), variances, strict=True)
    ends = np.cumsum([2 * (s.stop - s.start) for s in data.segments])
    parts = (part.reshape(2, -1) for part in np.split(residual, ends[:-1]))
    nrmse = np.sqrt(sum(np.sum(part**2, axis=1) for part in parts) / data.rows)
    return LoopFit(
        parameters=tuple(pole_fit(p, x, int(side), variance, 1.96) for p, x, side, variance in numbers),
        nrmse=dict(zip(data.output_names, nrmse.tolist(), strict=True)),
        rms=dict(zip(data.output_names, (nrmse * problem.size).tolist(), strict=True)),
        samples=data.rows,
        blocks=len(data.segments),
        evaluations=most,
        ends=(1.0,),
    )


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

    def solve(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return the residues of the error row (nc - 2,) and the weighted residual."""
        modal = self._at(theta).modal()
        places = [(b, i) for b, slot in enumerate(self.model.layout.slots) for i in range(slot.order)]
        N, g = self._ties(modal, places)
        rows = [self._rows(modal, places, s) for s in self.data.segments]
        W = np.hstack([np.concatenate([r[0] for r in rows]), scipy.linalg.block_diag(*(r[1] for r in rows))])
        y = np.concatenate([r[2] for r in rows])
        Q, R = np.linalg.qr(np.vstack([N, np.zeros((W.shape[1] - len(places), 4))]), mode="complete")
        fixed = Q[:, :4] @ np.linalg.solve(R[:4].T, g)
        Z = Q[:, 4:]
        A = W @ Z
        size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        z = np.linalg.lstsq(A / size, y - W @ fixed, rcond=1e-12)[0] / size
        c = fixed + Z @ z
        return c[: len(places)], W @ c - y

    def _at(self, theta: Floats) -> LoopModel:
        return replace(self.model, sections=self.model.layout.shaped(theta), fit=None)

    def model_at(self, theta: Floats) -> LoopModel:
        """Return the loop at given poles."""
        trial = self._at(theta)
        c, _ = self.solve(theta)
        modal = trial.modal()
        residues = np.zeros_like(self.model.residues)
        residues[0, : len(c)] = c
        at = 0
        for b, slot in enumerate(self.model.layout.slots):
            own = np.zeros(2)
            own[: slot.order] = c[at : at + slot.order]
            residues[1, at : at + slot.order] = (own @ self._effort(modal.rate[b]))[: slot.order]
            at += slot.order
        return replace(trial, residues=residues)

    def _effort(self, rate: Floats) -> Floats:
        """Return -(M A² + C A) of one block."""
        return -(self.inertia * rate @ rate + self.viscous * rate)

    def _ties(self, modal: ModalStep, places: list[tuple[int, int]]) -> tuple[Floats, Floats]:
        """Return N (nc, 4) and g (4,): N.T c = g; in units in which both orders weigh alike."""
        N = np.zeros((len(places), 4))
        w = float(np.abs(modal.rate).max())
        for k, (b, i) in enumerate(places):
            first = 2 * int(modal.input[b])
            N[k, first] = modal.drive[b, i]
            N[k, first + 1] = (modal.rate[b] @ modal.drive[b])[i] / w
        return N, np.array([0.0, 1.0 / (self.inertia * w), 1.0, 0.0])

    def _rows(
        self, modal: ModalStep, places: list[tuple[int, int]], s: slice
    ) -> tuple[Floats, Floats, Floats]:
        """Return weighted columns of the residues and of the unknown start, and the outputs."""
        w = np.column_stack([self.data.d[s], self.data.vr[s]])
        x = _states(modal, w, modal.equilibrium(w[0]))
        sections = [b for b in range(len(modal.A)) if modal.input[b] == 1]
        begun = np.zeros((len(modal.A), 2))
        begun[sections, 0] = 1.0
        still = _states(modal, np.zeros_like(w), begun)
        scale = 1.0 / self.size
        orders = [slot.order for slot in self.model.layout.slots]
        own = [(b, i) for b in sections for i in range(orders[b])]
        parts = [self._both(modal, v, p, scale) for v, p in ((x, places), (still, own))]
        return parts[0], parts[1], (self.data.outputs[s] * scale).T.ravel()

    def _both(self, modal: ModalStep, x: Floats, places: list[tuple[int, int]], scale: Floats) -> Floats:
        """Return the columns of e and below them those of u, shape (2 n, p)."""
        effort = np.stack([self._effort(rate) for rate in modal.rate])
        e = np.stack([x[:, b, i] for b, i in places], axis=1)
        u = np.stack([x[:, b] @ effort[b, i] for b, i in places], axis=1)
        return np.vstack([e * scale[0], u * scale[1]])


def _states(modal: ModalStep, w: Floats, x0: Floats) -> Floats:
    """Return the states of all blocks, shape (n, k, 2)."""
    k = len(modal.A)
    out = np.zeros((len(w), 2 * k))
    modal.respond(w, x0, np.eye(2 * k).reshape(2 * k, k, 2), out)
    return out.reshape(len(w), k, 2)
