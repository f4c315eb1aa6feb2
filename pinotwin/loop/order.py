"""How many poles does the data pay for? Structures compared on blocks of rows held out in turn.

A structure is fitted to all blocks but one (each stretch that remains has its own free start) and
predicts the whole segment from its inputs; what counts is its error on the block it has not seen.
The simplest structure is taken whose error is within one standard error of the best (Breiman et al.
1984), the standard error being that of the *difference* between the two over the blocks, since
blocks differ far more than structures do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from pinotwin.arrays import Floats
from pinotwin.errors import DataError, InputError
from pinotwin.loop.data import LoopData
from pinotwin.loop.identify import identify_loop
from pinotwin.loop.layout import Bounds
from pinotwin.loop.model import LoopModel
from pinotwin.loop.structure import Structure

MOST_PAIRS = 4


@dataclass(frozen=True)
class Trial:
    """One structure on held-out data.

    Attributes:
        structure: the structure.
        model: fitted to all data.
        errors: mean square error over the signal's, mean over the outputs, per block, shape (k,).
    """

    structure: Structure
    model: LoopModel
    errors: Floats

    @property
    def nrmse(self) -> float:
        """Root of the mean held-out error."""
        return float(np.sqrt(np.mean(self.errors)))


@dataclass(frozen=True)
class OrderChoice:
    """Result of :func:`select_order`.

    Attributes:
        trials: all structures tried, fewest poles first.
        chosen: index of the one taken.
        best: index of the one with the lowest held-out error.
    """

    trials: tuple[Trial, ...]
    chosen: int
    best: int

    @property
    def model(self) -> LoopModel:
        """The chosen structure, fitted to all data."""
        return self.trials[self.chosen].model


def select_order(
    data: LoopData,
    structure: Structure | None = None,
    *,
    folds: int = 5,
    candidates: Sequence[Structure] | None = None,
    bounds: Bounds | None = None,
) -> OrderChoice:
    """Return the structure that the data pays for, with all that were tried.

    Args:
        data: inputs and outputs.
        structure: where to begin; its neighbours (a pair more, a pair less, a real pole less) are
            tried, and further pairs as long as the largest is the best.
        folds: number of blocks held out in turn.
        candidates: the structures to compare instead.
        bounds: see :func:`identify_loop`; entries for poles that a candidate lacks are left out.

    Raises:
        InputError: fewer than two folds, or no candidates.
        DataError: too short to hold blocks out.
    """
    if folds < 2 or (candidates is not None and not candidates):
        raise InputError("select_order needs at least 2 folds and one candidate")
    blocks = _blocks(data, folds)
    begin = structure or Structure()
    tried = list(candidates) if candidates is not None else _neighbours(begin)
    trials = [_trial(data, s, blocks, bounds) for s in tried]
    while candidates is None and _largest_wins(trials):
        largest = max(trials, key=lambda t: t.structure.order).structure
        if largest.pole_pairs >= MOST_PAIRS:
            break
        trials.append(_trial(data, replace(largest, pole_pairs=largest.pole_pairs + 1), blocks, bounds))
    trials.sort(key=lambda t: t.structure.order)
    best = int(np.argmin([np.mean(t.errors) for t in trials]))
    return OrderChoice(tuple(trials), _simplest(trials, best), best)


def _neighbours(s: Structure) -> list[Structure]:
    found = [s, replace(s, pole_pairs=s.pole_pairs + 1)]
    if s.feedback_order >= 4 and s.pole_pairs >= 1:
        found.append(replace(s, pole_pairs=s.pole_pairs - 1))
    if s.feedback_order >= 3 and s.real_poles > s.feedforward_count:
        found.append(replace(s, real_poles=s.real_poles - 1))
    return found


def _largest_wins(trials: list[Trial]) -> bool:
    best = min(trials, key=lambda t: float(np.mean(t.errors)))
    return best.structure.order == max(t.structure.order for t in trials)


def _simplest(trials: list[Trial], best: int) -> int:
    for i, trial in enumerate(trials[:best]):
        gap = trial.errors - trials[best].errors
        spread = float(np.std(gap, ddof=1) / np.sqrt(len(gap)))
        if np.mean(gap) <= spread:
            return i
    return best


def _blocks(data: LoopData, folds: int) -> list[list[slice]]:
    """Return the held-out rows of every fold: ``folds`` stretches of equal length."""
    edges = np.linspace(0, data.rows, folds + 1).astype(int)
    found: list[list[slice]] = [[] for _ in range(folds)]
    passed = 0
    for s in data.segments:
        for k in range(folds):
            start = max(s.start, s.start + edges[k] - passed)
            stop = min(s.stop, s.start + edges[k + 1] - passed)
            if stop > start:
                found[k].append(slice(int(start), int(stop)))
        passed += s.stop - s.start
    if edges[1] < 64:
        raise DataError(
            f"{data.axis}: {data.rows} samples are too few to hold {folds} blocks out; give a longer log"
        )
    return found


def _rest(data: LoopData, held: list[slice]) -> tuple[slice, ...]:
    """Return the segments without the held-out rows."""
    found = []
    for s in data.segments:
        at = s.start
        for h in [h for h in held if s.start <= h.start < s.stop]:
            found.append(slice(at, h.start))
            at = h.stop
        found.append(slice(at, s.stop))
    return tuple(s for s in found if s.stop - s.start >= 16)


def _trial(data: LoopData, structure: Structure, blocks: list[list[slice]], bounds: Bounds | None) -> Trial:
    layout_names = _names(structure, data.step)
    own = {k: v for k, v in (bounds or {}).items() if k in layout_names}
    with threadpool_limits(1, "blas"):
        model = identify_loop(data, structure, bounds=own)
        start = _theta(model)
        errors = []
        for held in blocks:
            part = data.within(_rest(data, held))
            fitted = identify_loop(part, structure, bounds=own, starts=start[None])
            errors.append(_error(data, fitted, held))
    return Trial(structure, model, np.array(errors))


def _names(structure: Structure, step: float) -> set[str]:
    free = [s.name for s in structure.sections(step) if s.free]
    return {*free, *(n.replace("wn", "zeta") for n in free)}


def _theta(model: LoopModel) -> Floats:
    """Return the logarithms of the searched parameters, in the order of the layout."""
    return np.log([model.sections[p.section].values[p.value] for p in model.layout.parameters])


def _error(data: LoopData, model: LoopModel, held: list[slice]) -> float:
    total, rows = np.zeros(data.outputs.shape[1]), 0
    inside = np.concatenate([np.arange(s.start, s.stop) for s in data.segments])
    size = np.mean(data.outputs[inside] ** 2, axis=0)
    for s in data.segments:
        here = [h for h in held if s.start <= h.start < s.stop]
        if not here:
            continue
        y = model.simulate(data.qr[s], data.d[s], vr=data.velocity[s], ar=data.acceleration[s])
        for h in here:
            gap = y[h.start - s.start : h.stop - s.start] - data.outputs[h]
            total += np.sum(gap**2, axis=0)
            rows += len(gap)
    return float(np.mean(total / rows / size))
