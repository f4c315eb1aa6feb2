r"""Gains that have changed, told from the tracking error alone, where noise hides it in the effort.

It is simulated from the command with one factor on some of the gains, moved to where the log's own error is met,

    f <- f + (s . r) / (s . s),     r = e - e_simulated(f),  s = d e_simulated / d f,

and judged on stretches that it was not fitted to, of axes whose effort is the twin's: there the plant is as it was.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.data.comparison import Comparison
from pinotwin.diagnosis.evidence.bootstrap import share_interval
from pinotwin.diagnosis.rules import RULES, Rules
from pinotwin.diagnosis.search.injections import posterior
from pinotwin.diagnosis.search.trials import TRIALS
from pinotwin.diagnosis.signals.servo import SAID, ServoChange, turned
from pinotwin.diagnosis.signals.tracking import TURNED, own_run, simulated_errors
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.simulation import preferred
from pinotwin.solve.jackknife import jackknife, without_each
from pinotwin.twin import Twin

Runs = Sequence[tuple[Log, Motion]]  # Logs with their motions

BLOCKS = 12  # Stretches that an error is cut into
STEPS, FIRST = 4, 0.1  # Corrections of a factor, and the change by which its slope is taken first
LARGEST = 3.0  # Factor beyond which none is sought
HOPELESS = 0.3  # Share that the first slope promises to close below which no step is taken


@dataclass(frozen=True, eq=False)
class _Fit:
    """A factor on some gains with what it closes of one axis' tracking error."""

    effect: str  # ``feedforward`` or ``loop_gain``
    factor: float  # what the gains are, of what they were
    error: float  # its standard error
    before: Floats  # squared error of every block
    after: Floats  # the same with the factor fitted to the other blocks

    @property
    def share(self) -> float:
        """Of the squared error that is closed."""
        return float(1.0 - self.after.sum() / max(self.before.sum(), 1e-300))


def retuned(
    c: Comparison, axes: Collection[str], leave_out: Collection[str] = (), rules: Rules = RULES
) -> list[ServoChange]:
    """Return the gains by whose change the tracking error of some axes is met."""
    if preferred(c.twin) != "coupled":
        return []
    runs = [(one.log, one.motion) for one in c.logs] if axes else []
    found = []
    for axis in axes:
        if axis not in c.twin.servos or not c.gate.asks("servo", axis):
            continue
        fits = [fit for effect in TURNED if (fit := _fitted(c.twin, runs, axis, effect)) is not None]
        best = max(fits, key=lambda fit: fit.share, default=None)
        if best is None or best.share <= rules.retuned or best.effect in leave_out:
            continue
        known = _known(c, axis, best.effect)
        interval = turned(best.effect, best.factor, best.error, known, rules)
        if interval is not None:
            found.append(_change(axis, best, interval, fits, rules))
    return found


def _known(c: Comparison, axis: str, effect: str) -> float:
    """Return how well the gains are known: how far the twin's own logs ask for another factor, and its error."""
    own = own_run(c)
    fit = None if own is None else _fitted(c.twin, [own], axis, effect)
    return 0.0 if fit is None else float(np.hypot(fit.factor - 1.0, fit.error))


def _fitted(twin: Twin, runs: Runs, axis: str, effect: str) -> _Fit | None:
    """Return the factor that meets the tracking error best; None where it does not move it or cannot be simulated."""

    def errors(factor: float) -> tuple[Floats, Floats]:
        servo = twin.servos[axis].scaled(**dict.fromkeys(TURNED[effect], factor))
        return _errors(replace(twin, servos={**twin.servos, axis: servo}), runs, axis)

    try:
        factor, slope, left, before = _search(errors)
    except PinotwinError:
        return None
    if not np.any(slope):
        return None
    blocks = [np.array_split(x, BLOCKS) for x in (slope, left, before)]
    ss, sr = (np.array([b @ x for b, x in zip(blocks[0], part, strict=True)]) for part in blocks[:2])
    each = (without_each(sr) / np.maximum(without_each(ss), 1e-300))[:-1]
    after = np.array([np.sum((r - s * d) ** 2) for s, r, d in zip(blocks[0], blocks[1], each, strict=True)])
    whole = np.array([x @ x for x in blocks[2]])
    return _Fit(effect, factor, float(np.sqrt(jackknife(each[:, None])[0, 0])), whole, after)


def _search(errors: Callable[[float], tuple[Floats, Floats]]) -> tuple[float, Floats, Floats, Floats]:
    """Return the factor that leaves least, the slope there, what is left, and what was left with none."""
    measured, said = errors(1.0)
    before = measured - said
    factor, best = 1.0, (rms(before), 1.0, said)
    other = 1.0 - FIRST
    slope = np.zeros(0)
    for _ in range(STEPS):
        moved = errors(other)[1]
        slope = (moved - said) / (other - factor)
        left = measured - moved
        closes = float(slope @ before) ** 2 / max(float(slope @ slope) * float(before @ before), 1e-300)
        if factor == 1.0 and closes < HOPELESS:
            break
        best = min(best, (rms(left), other, moved), key=lambda x: x[0])
        step = float(slope @ left) / max(float(slope @ slope), 1e-300)
        factor, said = other, moved
        other = float(np.clip(factor + step, 0.0, LARGEST))
        if abs(other - factor) < 1e-3:
            break
    return best[1], slope, measured - best[2], before


def _errors(twin: Twin, runs: Runs, axis: str) -> tuple[Floats, Floats]:
    """Return the tracking error of one axis on all logs, measured and simulated."""
    joint = twin.machine.axes[axis].index
    parts = [simulated_errors(twin, log, motion)[joint] for log, motion in runs]
    return np.concatenate([m for m, _ in parts]), np.concatenate([s for _, s in parts])


def _change(
    axis: str, best: _Fit, interval: tuple[float, float], fits: Sequence[_Fit], rules: Rules
) -> ServoChange:
    low = share_interval(best.before, best.after)[0]
    rng = np.random.default_rng(0)
    wins = 0
    for _ in range(TRIALS):
        at = rng.integers(BLOCKS, size=BLOCKS)
        shares = {f.effect: 1.0 - f.after[at].sum() / max(f.before[at].sum(), 1e-300) for f in fits}
        wins += max(shares, key=lambda k: shares[k]) == best.effect and shares[best.effect] > rules.retuned
    return ServoChange(
        best.effect,
        axis,
        SAID[best.effect],
        1.0,
        best.factor,
        interval,
        "of what it was",
        best.share,
        (0.0, 0.0),
        posterior(wins, TRIALS, rules) if low > 0.0 else 0.0,
    )
