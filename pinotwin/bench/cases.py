"""The cases of the withheld bench: machine, situation, what is put into the truth, and nothing else."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import count

import numpy as np

from pinotwin.bench import catalogue
from pinotwin.bench.plants import listing, public_machine

MACHINES = ("trunnion", "laser_driller", "emps", "random:33", "random:34", "random:35", "random:36")
"""Machines of a bench by default; random machines of smaller numbers were seen in development."""

HEALTHY_CASES, DOUBLE_CASES, LEFT_OUT_CASES = 26, 10, 8
"""Of one round, over both situations. Four rounds make a whole bench."""

FORM_CASES = {
    "structure": ("gms", "gms", "ripple_triangle"),
    # A controller's dead time that was there when it was identified is no fault of the model.
    "change": ("gms", "loop_delay"),
}


@dataclass(frozen=True)
class Case:
    """One case."""

    number: int  # running number
    machine: str  # bundled machine, random:SEED or folder
    situation: str  # structure or change
    # healthy, single, double, outside (nobody knows it), left_out (the catalogue lost it), form (the
    # catalogue knows it in another functional form)
    kind: str
    effects: tuple[tuple[str, str, float], ...]  # (effect, axis, size) put into the truth
    seed: int  # of trajectory, noise and whatever the effects leave to chance
    leave_out: tuple[str, ...] = ()  # effects taken out of the catalogue
    twin: int = 0  # seed of the healthy twin that a change is seen against

    def key(self, *circumstances: object) -> str:
        """Return a name that another case, or the same in other circumstances, does not have."""
        text = json.dumps([asdict(self), [str(c) for c in circumstances]], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def draw_cases(
    machines: Sequence[str] = MACHINES,
    rounds: int = 1,
    *,
    situations: Sequence[str] = ("structure", "change"),
    seed: int = 0,
) -> list[Case]:
    """Return the cases of a bench; every round has each effect once per situation, so that a short bench is even."""
    rng = np.random.default_rng([seed, 7])
    out: list[Case] = []
    turns = (machines[k] for _ in count() for k in rng.permutation(len(machines)))
    for _ in range(rounds):
        wanted = [(s, k, n) for s in situations for k, n in _round(s, rng)]
        for at in rng.permutation(len(wanted)):
            situation, kind, names = wanted[at]
            for machine in (next(turns) for _ in range(2 * len(machines))):
                effects = _placed(rng, machine, situation, names)
                if effects is not None:
                    away = catalogue.left_out_with(effects[0][0]) if kind == "left_out" else ()
                    seed, twin = int(rng.integers(1 << 30)), int(rng.integers(2))
                    out.append(Case(len(out), machine, situation, kind, effects, seed, away, twin))
                    break
    return out


def some(cases: Sequence[Case], count: int | None) -> list[Case]:
    """Return so many of the cases, evenly spread; all of them for None."""
    if count is None or count >= len(cases):
        return list(cases)
    return [cases[k] for k in np.linspace(0, len(cases) - 1, count).round().astype(int)]


def _round(situation: str, rng: np.random.Generator) -> Iterator[tuple[str, tuple[str, ...]]]:
    pool = catalogue.STRUCTURE if situation == "structure" else catalogue.CHANGE
    yield from [("healthy", ())] * (HEALTHY_CASES // 2)
    yield from (("single", (name,)) for name in pool)
    for _ in range(DOUBLE_CASES // 2):
        yield "double", _two(rng, pool)
    yield from (("outside", (name,)) for name in catalogue.OUTSIDE[situation == "change" :: 2])
    away = rng.choice(np.array(pool), LEFT_OUT_CASES // 2, replace=False)
    yield from (("left_out", (str(name),)) for name in away)
    yield from (("form", (name,)) for name in FORM_CASES[situation])


def _two(rng: np.random.Generator, pool: Sequence[str]) -> tuple[str, str]:
    """Return two effects that do not say the same in other words."""
    while True:
        a, b = (str(x) for x in rng.choice(np.array(pool), 2, replace=False))
        if not any({a, b} <= group for group in catalogue.IMITATORS):
            return a, b


def _placed(
    rng: np.random.Generator, machine: str, situation: str, names: Sequence[str]
) -> tuple[tuple[str, str, float], ...] | None:
    """Return the effects with axis and size; None where a machine has no place for one."""
    axes, turning = list(listing(machine)), public_machine(machine).axes
    out = []
    for name in names:
        free = [a for a in axes if name not in catalogue.ROTARY or turning[a].rotary]
        if not free or (name in catalogue.MANY_AXES and len(axes) < 2):
            return None
        sizes = catalogue.SIZES | (catalogue.CHANGE_SIZES if situation == "change" else {})
        low, high = np.log(sizes[name])
        out.append((name, str(rng.choice(np.array(free))), float(np.exp(rng.uniform(low, high)))))
    return tuple(out)


def truth_of(case: Case) -> tuple[tuple[str, str], ...]:
    """Return the right answers: catalogue name and axis of each effect that was put in."""
    return tuple((catalogue.FORMS.get(effect, effect), axis) for effect, axis, _ in case.effects)
