"""The numbers by which :func:`pinotwin.identify` decides, for a caller to hand over, and the rule that they serve."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")
Tell = Callable[[str, float], None]  # Takes a stage and the share of it done [0 to 1]


@dataclass(frozen=True)
class Settings:
    """What is taken into a twin, and how much of a log is looked at for it.

    Attributes:
        pays: error on unseen rows, over that of the simpler or usual model, below which an optional part is taken: a
            further shape of an effect, a pair of poles more, another form of the loop, a position without its
            steps; and what one turn of loop and friction must bring for another. Less is within the noise.
        no_worse: error on unseen rows, over that before, up to which a change is kept that adds no number: refined
            friction, a loop tied to the known mass. Its own noise moves an error by about that.
        much_worse: error of a single signal, over that before, from which a gain of the others does not count: ten
            times what is no change.
        law_pays: error of a controller on windows not fitted, over that of one with fewer gains or shapes, below which
            it is taken: a law is one for all windows, so that less tells than on a plant.
        simpler_law: the same above which a law with fewer gains is kept although it has the larger error.
        moments_worse: error of e or u on those windows, over that of the output error, up to which the gains are those
            of the law's own signals: they are nearer the truth, and the output error's hide errors of the plant.
        missed: error of e on those windows, over its RMS, from which a controller is searched afresh and warned of.
        good_tracking: error of the predicted tracking error, over its RMS, below which no free black box is needed:
            an effort that is missed otherwise is the plant's, whatever the form of the loop.
        poor_loop: mean error of a black box, each signal over its RMS, from which its poles are searched afresh: the
            thesis has 3 to 7 %, and a search from everywhere costs three times as much.
        most_pairs: pole pairs of a black box at most; a rigid axis under a cascade has two.
        turns: turns of loop and friction at most; they settle in two or three.
        slowest: sampling interval up to which a closed loop is identified [s]: five rows a time constant of 0.1 s.
        folds: parts of a log that are predicted from the others, the usual compromise of bias and cost.
        long: fitted rows beyond which shapes and loops are searched on pieces of a log: ten poles need no hour.
        short: rows of these pieces together; 48 s at 500 Hz, where the thesis took 12 s.
        kept: rows of the own logs that a twin keeps: two minutes at 500 Hz say what it leaves.
        judged: longest stretch at the end of a log on which the forms of a loop are compared [s]: some tens of
            moves, and simulating more costs more than it tells.
        beginning: longest stretch from its beginning on which another form may not be worse than the usual one [s]:
            a form that drifts off does so within seconds.
        one_speed: share of its middle speed within which four fifths of an axis' travel are one speed to its friction:
            between nearer ones viscous friction changes by less than dry friction does in a day.
        condition: scaled condition number above which parameters trade off against each other: four digits of the
            effort are lost then, which is more than a drive logs.
        sure: standard error over size below which a base parameter from the motors' rows takes the CAD's place: CAD
            values are no better than that.
        urdf_rows: independent rows as which the URDF's bodies count: the first number, unless another predicts
            unseen rows better; a log has too few independent blocks to choose among more.
        other_rows: numbers of rows that are tried beside, to know the least error of bodies that can exist.
        urdf_share: share of a mass that is the URDF's from which it is no result of the log.
        cad_doubt: share of itself by which a CAD value that no motor sees may be off: cables and screws are not in it.
    """

    pays: float = 0.95
    no_worse: float = 1.01
    much_worse: float = 1.1
    law_pays: float = 0.98
    simpler_law: float = 0.97
    moments_worse: float = 1.05
    missed: float = 0.2
    good_tracking: float = 0.05
    poor_loop: float = 0.1
    most_pairs: int = 3
    turns: int = 4
    slowest: float = 0.02
    folds: int = 5
    long: int = 50_000
    short: int = 24_000
    kept: int = 60_000
    judged: float = 20.0
    beginning: float = 60.0
    one_speed: float = 0.1
    condition: float = 1e4
    sure: float = 0.25
    urdf_rows: tuple[float, ...] = (5.0, 3.0, 10.0)
    other_rows: tuple[float, ...] = (0.3, 1.0, 30.0)
    urdf_share: float = 0.7
    cad_doubt: float = 0.5


USUAL = Settings()  # The numbers of :func:`pinotwin.identify` where none are handed over


def better(usual: T, others: Iterable[T], score: Callable[[T], float], pays: float) -> T:
    """Return the candidate of the least error; the usual one unless another's is below ``pays`` of its [-]."""
    candidates = [usual, *others]
    limits = [score(x) / (pays if k else 1.0) for k, x in enumerate(candidates)]
    return candidates[limits.index(min(limits))]
