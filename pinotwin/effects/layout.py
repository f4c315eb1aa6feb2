"""How the coefficients of several effects lie in one vector, and what each effect is called there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinotwin.effects.effect import Effect
from pinotwin.effects.rigid_body import RigidBody


def effect_keys(effects: Sequence[Effect]) -> tuple[str, ...]:
    """Return a unique key for each effect."""
    keys: list[str] = []
    for effect in effects:
        plain = effect.name if effect.axis is None else f"{effect.axis}.{effect.name}"
        count = sum(k == plain or k.startswith(plain + "#") for k in keys)
        keys.append(plain if count == 0 else f"{plain}#{count + 1}")
    return tuple(keys)


def effect_slices(effects: Sequence[Effect]) -> tuple[slice, ...]:
    """Return where each effect's coefficients lie when all are put end to end."""
    counts = [len(effect.coefficients()) for effect in effects]
    ends = np.cumsum(counts)
    return tuple(slice(int(e - c), int(e)) for e, c in zip(ends, counts, strict=True))


def rigid_body_of(effects: Sequence[Effect]) -> tuple[RigidBody, slice]:
    """Return the rigid bodies among some effects, and where their base parameters lie in the vector."""
    pairs = zip(effects, effect_slices(effects), strict=True)
    return next((effect, where) for effect, where in pairs if isinstance(effect, RigidBody))
