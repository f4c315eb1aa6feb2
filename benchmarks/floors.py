"""What others would do: stepwise BIC, and orthogonal matching pursuit, on inverse-dynamics regressors.

Both take measured motion, filtered and differentiated, white noise for granted, nothing held out, and one
column (or few) per effect of the catalogue. The base model's friction shapes are given to them as the truth
has them, an advantage that no user has. Each returns its best effect with a score; the threshold is set so that
they accuse healthy machines as often as the diagnosis does on the same cases.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks._floor_columns import Atom, Scene, atoms
from pinotwin.arrays import Floats
from pinotwin.bench.answers import Answer
from pinotwin.bench.cases import MACHINES, Case, draw_cases, some
from pinotwin.bench.plants import virtual
from pinotwin.bench.produce import Sealed, healthy_twin, produce
from pinotwin.bench.ratio import at_truth
from pinotwin.bench.run import Plan, run_bench
from pinotwin.bench.scoring import FAINT, VISIBLE
from pinotwin.bench.statistics import Share
from pinotwin.effects import Effect
from pinotwin.logs.prepare import prepare
from pinotwin.twin import Twin

ROWS = 700
"""Samples of each log that are used."""
Pick = tuple[str, str | None, float]


def floors(case: Case, sealed: Sealed, twin: Twin | None) -> dict[str, Pick]:
    """Return the first effect that each floor would name, with its score."""
    scenes = _scenes(case, sealed, twin)
    axes = [a.name for a in sealed.machine.axes.values()]
    joints = [sealed.machine.axes[a].index for a in axes]
    base = np.concatenate([s.base for s in scenes], axis=1)[joints]
    gap = np.concatenate([s.gap for s in scenes], axis=1)[joints]
    W = base.reshape(-1, base.shape[2])
    y = gap.reshape(-1)
    # Every axis counts by the size of what its own model leaves.
    left = np.sqrt(np.mean(_rest(_basis(W), y[:, None])[:, 0].reshape(gap.shape) ** 2, axis=1))
    weight = np.repeat(1.0 / np.maximum(left, 1e-9 * max(left.max(), 1e-12)), gap.shape[1])
    Q = _basis(W * weight[:, None])
    r = _rest(Q, (y * weight)[:, None])[:, 0]
    best: dict[str, Pick] = {}
    for j, axis in zip(joints, axes, strict=True):
        for atom in atoms(scenes, sealed.machine, j, axis, case.situation, case.leave_out):
            X = atom.values[joints].reshape(len(r), -1) * weight[:, None]
            _better(best, "stepwise_bic", atom, _bic(Q, X, r, atom.shapes))
            _better(best, "pursuit", atom, _correlation(X, r))
    return best


def _scenes(case: Case, sealed: Sealed, twin: Twin | None) -> list[Scene]:
    effects: Sequence[Effect]
    if twin is None:
        truth = virtual(case.machine)
        effects = [at_truth(e, truth) for e in sealed.machine.effects]
    else:
        effects = twin.effects
    motions = [prepare(sealed.machine, log) for log in sealed.logs]
    if twin is None:
        effects = [e.fitted_to(motions[0]) for e in effects]
    return [Scene.of(m, effects, sealed.machine, twin, ROWS) for m in motions]


def _better(best: dict[str, Pick], name: str, atom: Atom, score: float) -> None:
    if name not in best or score > best[name][2]:
        best[name] = (atom.effect, atom.axis, score)


def _basis(W: Floats) -> Floats:
    """Return orthonormal columns that span others, shape (n, rank)."""
    size = np.linalg.norm(W, axis=0)
    A = W[:, size > 0.0] / size[size > 0.0]
    power, V = np.linalg.eigh(A.T @ A)
    keep = power > 1e-10 * power.max()
    return np.asarray(A @ (V[:, keep] / np.sqrt(power[keep])))


def _rest(Q: Floats, X: Floats) -> Floats:
    """Return what of some columns lies outside the span of a basis."""
    rows = np.flatnonzero(X.any(axis=1))  # a column of one axis is zero at all others
    return np.asarray(X - Q @ (Q[rows].T @ X[rows]))


def _bic(Q: Floats, X: Floats, r: Floats, shapes: int) -> float:
    """Return by how much the Bayesian information criterion falls when columns are added."""
    rest, total, n = _rest(Q, X), float(r @ r), len(r)
    size = np.linalg.norm(rest, axis=0)
    keep = size > 1e-3 * np.linalg.norm(X, axis=0)
    if not keep.any():
        return -float(np.log(n))
    A = rest[:, keep] / size[keep]
    solved = np.linalg.solve(A.T @ A + 1e-9 * np.eye(A.shape[1]), A.T @ r)
    gain = min(float(solved @ (A.T @ r)), 0.999999 * total)
    return n * float(np.log(total / (total - gain))) - (A.shape[1] + shapes) * float(np.log(n))


def _correlation(X: Floats, r: Floats) -> float:
    """Return the largest correlation of a column with the residual, as matching pursuit takes it."""
    size = np.linalg.norm(X, axis=0)
    keep = size > 0.0
    whole = float(np.linalg.norm(r))
    if not keep.any() or whole <= 0.0:
        return 0.0
    return float(np.max(np.abs(r @ X[:, keep]) / size[keep])) / whole


WORDS = {"stepwise_bic": "stepwise BIC", "pursuit": "orthogonal matching pursuit"}


@dataclass(frozen=True)
class FloorScore:
    """One method on all cases.

    Attributes:
        name: method.
        threshold: of its own score; None for ours.
        alarms: healthy machines of which it names an effect.
        visible: first answer right, rho at least 0.1, classes merged.
        faint: the same for 0.02 to 0.1.
    """

    name: str
    threshold: float | None
    alarms: Share
    visible: Share
    faint: Share


def floor_scores(answers: Sequence[Answer], picks: Mapping[int, Mapping[str, Pick]]) -> list[FloorScore]:
    """Return our line and that of every floor, its threshold set to our rate of named healthy machines.

    Args:
        answers: ours.
        picks: number of the case -> floor -> what it names.

    The threshold is the lowest that accuses no more healthy cases than we do, read off these very cases:
    kinder to the floors than to us, whose thresholds never saw them.
    """
    healthy = [a for a in answers if a.kind == "healthy"]
    single = [a for a in answers if a.kind == "single"]
    ours = Share.over([bool(a.named) for a in healthy])
    out = [FloorScore("pinotwin", None, ours, *_shares(single, lambda a: a.right()))]
    for name in sorted({k for found in picks.values() for k in found}):
        mine = {number: found[name] for number, found in picks.items() if name in found}
        known = sorted((mine[a.number][2] for a in healthy if a.number in mine), reverse=True)
        level = known[min(ours.hits, len(known) - 1)] if known else 0.0

        def right(a: Answer, mine: Mapping[int, Pick] = mine, level: float = level) -> bool:
            pick = mine.get(a.number)
            return pick is not None and pick[2] > level and a.agrees(pick[:2], a.truth[0])

        alarms = Share.over([a.number in mine and mine[a.number][2] > level for a in healthy])
        words = WORDS.get(name, name)
        out.append(FloorScore(words, float(level), alarms, *_shares(single, right)))
    return out


def _shares(single, right) -> tuple[Share, Share]:  # type: ignore[no-untyped-def]
    visible = [a for a in single if a.size >= VISIBLE]
    faint = [a for a in single if FAINT <= a.size < VISIBLE]
    return Share.over([right(a) for a in visible]), Share.over([right(a) for a in faint])


def beaten(scores: Sequence[FloorScore]) -> bool | None:
    """Whether our line is above every floor; None where there is nothing to compare."""
    values = [s.visible.value for s in scores]
    if len(values) < 2 or any(v is None for v in values):
        return None
    return bool(values[0] > np.max(np.array(values[1:], dtype=float)))  # type: ignore[operator]


def main() -> None:
    """Diagnose withheld-effect cases, ask the floors about the same ones, and print both."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks floors", description=__doc__)
    parser.add_argument("--seeds", type=int, default=1, help="rounds of about 95 cases each (1)")
    parser.add_argument("--cases", type=int, default=12, help="only so many of them, evenly spread (12)")
    parser.add_argument("--seconds", type=float, default=8.0, help="length of every log [s] (8)")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    parser.add_argument("--out", default="out/bench", help="of `pinotwin blind`: its answers are used")
    args = parser.parse_args()
    plan = Plan(Path(args.out), args.seconds, args.workers)
    cases = some(draw_cases(MACHINES, args.seeds), args.cases)
    answers = run_bench(cases, plan)
    picks = {}
    for case in cases:
        twin = healthy_twin(plan.twins, case.machine, case.twin) if case.situation == "change" else None
        picks[case.number] = floors(case, produce(case, seconds=plan.seconds).sealed, twin)
    scores = floor_scores(answers, picks)
    print(f"{'method':<28}{'healthy named':>14}{'rho >= 0.1':>12}{'0.02 to 0.1':>13}")
    for s in scores:
        shares = [f"{x.hits}/{x.of}" for x in (s.alarms, s.visible, s.faint)]
        print(f"{s.name:<28}{shares[0]:>14}{shares[1]:>12}{shares[2]:>13}")
    print(f"ours above every floor: {beaten(scores)}")
