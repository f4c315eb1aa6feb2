"""The small slide with friction and a ripple, its logs in closed form, and something put on top of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from pinotwin.log import Log
from pinotwin.machine import Machine
from tests.slide import slide

LISTED, OTHER = 0.0172, 0.031
RATE, SECONDS = 500.0, 12.0
Extra = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def listing(folder: Path, *effects: str) -> Machine:
    """Return the machine of a slide that lists some effects, friction and a ripple unless others are given."""
    made = slide(folder, ripple=True)
    content = yaml.safe_load((made / "machine.yaml").read_text())
    content["axes"]["X"]["effects"] = list(effects or ("viscous", "coulomb", "ripple"))
    (made / "machine.yaml").write_text(yaml.safe_dump(content))
    return Machine.load(made)


def log(
    seed: int,
    extra: Extra,
    *,
    path: int = 7,
    late: float = 0.0,
    noise: float = 0.5,
    ripple: float = 6.0,
    seconds: float = SECONDS,
) -> Log:
    """A slide of 70 kg with friction and a ripple, and what is put on top of it as a function of (t, q, v).

    ``path``: seed of its command. ``late``: how late the effort is logged [s]. ``noise``: of it, RMS [N].
    ``ripple``: amplitude [N]. ``seconds``: how long it is [s].
    """
    t = np.arange(0.0, seconds, 1.0 / RATE)
    f, phase = np.array([0.31, 0.77, 1.3]), 2.0 * np.pi * np.random.default_rng(path).random(3)
    size, w = np.array([0.12, 0.04, 0.02]), 2.0 * np.pi * f

    def moved(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angle = np.outer(t, w) + phase
        return np.sin(angle) @ size, np.cos(angle) @ (size * w), -np.sin(angle) @ (size * w**2)

    q, v, a = moved(t - late)
    u = 70.0 * a + 60.0 * v + 20.0 * np.tanh(v / 1e-3) + ripple * np.cos(2.0 * np.pi * q / LISTED)
    u = u + extra(t - late, q, v) + noise * np.random.default_rng(seed).normal(size=len(t))
    q = moved(t)[0]
    return Log({"t": t, "X.qr": q, "X.q": q, "X.u": u}, source=f"{seed}.csv")


def bristle(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return dry friction that takes 0.3 mm to turn round (Dahl 1968)."""
    z, out = 0.0, np.zeros(len(t))
    for k, dq in enumerate(np.diff(q, prepend=q[0])):
        z = float(np.clip(z + dq / 3e-4 * (1.0 - z * np.sign(dq)), -1.0, 1.0))
        out[k] = 5.0 * z
    return out - 5.0 * np.tanh(v / 1e-3)
