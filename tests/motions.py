"""Motions made of sums of sines, whose velocity and acceleration are known in closed form."""

from __future__ import annotations

import numpy as np

from pinotwin.motion import Motion


def multisine(
    names: tuple[str, ...] = ("Y", "A"),
    rotary: tuple[bool, ...] = (False, True),
    *,
    n: int = 4000,
    step: float = 1e-3,
    seed: int = 1,
) -> Motion:
    """Return a random multisine: 0.15 m or 1.2 rad of travel."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * step
    q, v, a = (np.zeros((n, len(names))) for _ in range(3))
    for j, turn in enumerate(rotary):
        size = 1.2 if turn else 0.15
        for k in range(6):
            w = 2 * np.pi * (0.2 + 0.45 * k + 0.1 * rng.random())
            amplitude, phase = size * rng.uniform(0.2, 0.5) / (1 + k), rng.uniform(0, 2 * np.pi)
            q[:, j] += amplitude * np.sin(w * t + phase)
            v[:, j] += amplitude * w * np.cos(w * t + phase)
            a[:, j] -= amplitude * w * w * np.sin(w * t + phase)
    return Motion(
        names=names,
        rotary=rotary,
        t=t,
        q=q,
        v=v,
        a=a,
        u=np.zeros_like(q),
        segments=(slice(0, n),),
        step=step,
        use=np.ones((n, len(names)), dtype=bool),
        source="multisine",
    )
