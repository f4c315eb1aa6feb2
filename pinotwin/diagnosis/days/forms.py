"""Forms of effort that a twin has no effect for: the effects of the catalogue bring their own columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np
from scipy.optimize import minimize_scalar

from pinotwin.arrays import Floats
from pinotwin.diagnosis.candidates.catalogue import APART, SAME, SUMS, Joined, Worn, instances
from pinotwin.diagnosis.days.mechanisms import GROUP
from pinotwin.diagnosis.days.places import Felt, Sought, Whitened
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.stretch import Stretch
from pinotwin.diagnosis.settings import SETTINGS
from pinotwin.effects import Effect
from pinotwin.effects.family import FRICTION
from pinotwin.effects.known import known as known_effects
from pinotwin.effects.tree import Tree
from pinotwin.motion import Motion
from pinotwin.twin import Twin

Gain = Callable[[Effect], float]


def forms(r: Reference, w: Whitened, name: str) -> dict[str, Sought]:
    """Return efforts of an axis that its twin may lack, each at the shapes that explain most of what is left.

    The search costs the logarithm of the number of shapes that were tried: what explains more is searched between them.
    """
    twin = r.twin
    tree = Tree(twin.model, twin.machine.names, twin.machine.rotary)
    thin = Motion.join([s.motion.at(s.rows) for s in w.logs])
    gain = cache(partial(_gain, w, thin))
    longest = max((s.motion for s in w.logs), key=len)
    out = {}
    every = known_effects(twin.machine.effects)
    # judged in another way, sums or other laws of what is tried, faster than the low-pass; a tilt acts on every axis
    laws = [k for k, x in every.items() if x.family is FRICTION and x.contains]
    other = (*GROUP, *APART, *SAME, *SUMS, *laws, "geometric_error", "backlash")
    for kind in (x for k, x in every.items() if k not in other and x.family.acts != "loop"):
        tried = instances(kind, tree, name, longest)
        price = float(np.log(max(len(tried), 1)))
        if tried and np.isfinite(gain(best := _best(tried, gain))):
            out[kind.name] = _local(w, _polished(tried, best, gain) if gain(best) > price else best, price)
    return out


def _best(tried: Sequence[Effect], gain: Gain) -> Effect:
    """Return the best of some forms, the first of its shapes at one value of the others."""
    first = max({e.shape_values()[:1]: e for e in tried}.values(), key=gain)
    return max((e for e in tried if e.shape_values()[:1] == first.shape_values()[:1]), key=gain)


def _polished(tried: Sequence[Effect], one: Effect, gain: Gain) -> Effect:
    """Return the best form, its shapes searched between those beside them, one after the other."""
    every = [sorted(set(x)) for x in zip(*(e.shape_values() for e in tried), strict=True)]
    for _ in every:  # a shape hangs on those that were searched after it
        for k, values in enumerate(every):
            one = _along(one, k, values, gain)
    return one


def _along(one: Effect, k: int, values: Sequence[float], gain: Gain) -> Effect:
    """Return a form with its shape number ``k`` where it gains most between the values beside it."""
    at = list(one.shape_values())
    near = [*[x for x in values if x < at[k]][-1:], at[k], *[x for x in values if x > at[k]][:1]]

    def moved(x: float) -> Effect:
        return one.shaped([*at[:k], x, *at[k + 1 :]])

    return moved(peak(lambda x: gain(moved(x)), near)) if len(near) > 1 else one


def peak(gain: Callable[[float], float], tried: Sequence[float]) -> float:
    """Return the number [any unit] of the largest gain, searched between those beside the best of some."""
    every = sorted(tried)
    at = max(range(len(every)), key=lambda k: gain(every[k]))
    span = every[max(at - 1, 0)], every[min(at + 1, len(every) - 1)]
    found = minimize_scalar(
        lambda x: -max(gain(x), -1e9), bounds=span, method="bounded", options={"maxiter": 15}
    )
    return max((every[at], float(found.x)), key=gain)


def _gain(w: Whitened, thin: Motion, effect: Effect) -> float:
    """Return what a form may explain less what its numbers cost [nats], by its columns on the rows that are kept."""
    parts = np.split(_columns(effect, thin)[w.name], np.cumsum([len(s.t) for s in w.logs])[:-1])
    x = np.concatenate([w.passed(k, part) for k, part in enumerate(parts)])
    both, own = np.concatenate(w.left) @ x, x.T @ x
    size = np.diag(own)
    if not size.any():
        return -np.inf
    explains = both @ np.linalg.solve(own + np.diag(1e-6 * size + (size == 0.0)), both)
    return 0.5 * float(explains) - SETTINGS.number * np.count_nonzero(size)


def _columns(effect: Effect, m: Motion) -> Felt:
    """Return the columns of a form on every axis on which it acts, shape (n, p) each."""
    found = effect.columns(m)
    return {m.names[j]: np.asarray(found.values[:, k]) for k, j in enumerate(found.joints)}


def _local(w: Whitened, effect: Effect, price: float) -> Sought:
    """Return the columns of a form in every stretch, of the size of the effort."""
    own = [s.taken(_columns(effect, s.motion)[w.name]) for s in w.logs]
    scale = w.effort / np.maximum(np.std(np.concatenate(own), axis=0), 1e-300)

    def again(s: Stretch) -> Felt:
        return {k: np.asarray(s.taken(x) * scale) for k, x in _columns(effect, s.motion).items()}

    return Sought([again(s) for s in w.logs], price, form=effect, scale=scale, again=again)


def parts(form: Effect) -> tuple[Effect, ...]:
    """Return the effects whose columns stand side by side in a form."""
    return form.parts if isinstance(form, Joined) else (form,)


def known(twin: Twin, form: Effect) -> Floats:
    """Return what a twin holds of the coefficients of a form, shape (p,); 0 of what it has not."""
    if isinstance(form, Worn):
        return np.ones(1)
    out = []
    for part in parts(form):
        count = len(part.coefficients())
        key = (part.name, part.axis, part.shapes())
        same = [theta for e, theta in twin.pairs if (e.name, e.axis, e.shapes()) == key]
        out.append(same[0] if same and len(same[0]) == count else np.zeros(count))
    return np.concatenate(out)


def possible(r: Reference, found: Sought, numbers: Floats, errors: Floats) -> bool:
    """Whether a machine can have the coefficients of a form after the change, within two standard errors."""
    assert found.form is not None
    low, high = np.transpose([(c.lower, c.upper) for part in parts(found.form) for c in part.coefficients()])
    after, slack = known(r.twin, found.form) + numbers * found.scale, 2.0 * errors * found.scale
    return bool(np.all((low - slack <= after) & (after <= high + slack)))
