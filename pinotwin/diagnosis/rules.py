"""Every threshold of a decision, in one place: what it means, its unit, its value.

Those in :data:`DERIVED` are limits of false alarms that ``python -m benchmarks calibrate`` derives from healthy
machines and writes here; the others were set on healthy and faulty logs of simulated and real machines.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Rules:
    """Thresholds of the diagnosis."""

    block_time: float = 0.5
    """[s] Shortest stretch of a log that counts as one witness."""
    standing: float = 0.002
    """[of the top commanded speed] Below it a command stands."""
    settles: float = 0.2
    """[s] After a command has stopped, an axis still slides to its place."""
    starting: float = 0.25
    """[s] As a log begins an axis may swing though its command has not moved it yet: that is not judged."""
    trembling: float = 0.05
    """[of the top speed] An axis that is no faster while its command stands rests: dry friction holds any effort up
    to its level there."""

    runs_change: float = 1.3
    """[misfits] RMS by which two runs of one command may differ (over sqrt 2)."""
    runs_structure: float = 1.15
    """[of what is left of both] The same where the machine was fitted to both: it then lies between them, and no
    fault brings more than sqrt 2."""
    good_model: float = 0.01
    """[of the effort's variation] What a good model of a healthy axis leaves: the floor of a structure question."""

    unsure: float = 3.0
    """[standard errors] Of the twin's effort, by which it may be off beside its misfit where it has hardly been."""

    knows: float = 0.95
    """[of the effort's variation] Misfit from which a twin knows nothing of an axis."""
    guessed: float = 3.0
    """[of the largest on the twin's own rows] Standard error of its effort from which a row is not judged."""
    guessed_size: float = 0.5
    """[misfits] Least that this error is."""

    at_bound: float = 0.01
    """[standard errors] A coefficient of a machine nearer to its bound than this rests on it and stays there."""

    share: float = 0.10
    """[of the squared residual] Least that a change closes on rows not fitted, of the joints it acts on."""
    share_structure: float = 0.2
    """The same for what a machine lacks, of the squared residual without its noise if repeats tell it."""
    share_played: float = 0.35
    """The same for play and springs: stepped along the measured motion they look like whatever a small axis leaves."""
    noise_part: float = 0.5
    """[of the squared residual] Most of it that counts as noise there."""
    strength_change: float = 12.0
    """[squared standard errors per number] Least size of a change against the twin's own logs."""
    strength_structure: float = 12.0
    """The same for what a machine lacks."""
    size_structure: float = 0.011
    """[of the effort's variation] Least that what a machine lacks closes of its axis' effort, RMS."""
    turning: float = 0.02
    """[of the effort's variation] The same for what friction keeps in mind as it turns round (presliding, hysteresis),
    which a model of dry friction always misses a little."""
    turning_share: float = 0.75
    """[of the squared residual without its noise] Less than that is named if it closes this."""
    cycle: float = 0.5
    """[of the log's step] Least delay that is missing in a machine: a drive holds its effort over a cycle, so that what
    is logged leads by half of one, and a log's step is one cycle at least."""
    longest_cycle: float = 7.5e-4
    """[s] Most that is asked so, however slow the log: half of a drive's longest cycle."""
    complete: float = 0.45
    """[of the squared residual without its noise] A cause that closes more than this of what repeats share is named
    though it is smaller than `excess` and `size_structure` ask for. Not friction about rest, which differs from run to
    run by as much."""
    complete_strength: float = 100.0
    """[squared standard errors per number] Least size of such a cause."""
    complete_size: float = 0.004
    """[of the effort's variation] Least that it closes, RMS."""
    complete_numbers: int = 6
    """Most numbers that it has: a table or a curve closes what it likes."""
    size_change: float = 0.005
    """The same for a change, whose twin knows its misfit: for so little nobody stops a machine."""
    excess: float = 0.86
    """[squared misfit per row] Least that a change closes: nothing smaller than the misfit itself is named."""
    scatter: float = 0.05
    """[of an axis' friction, RMS] Change of friction, or of what follows no law, that is not named: by so much friction
    differs from run to run of one machine, and a twin of one log cannot know how much."""
    scatter_part: float = 0.5
    """[of what such a change closes] Least that the twin's own friction closes where it is not named, each part of it
    scaled in every run."""
    as_good: float = 0.97
    """[of the best gain] A candidate with fewer numbers that reaches this is taken instead."""
    as_good_most: float = 30.0
    """[squared misfits per row, of a change] Most that a candidate which is no relative of the best may leave more than
    it, however large the gap."""
    met: float = 1.2
    """[squared misfits per row, of a change] A cause that leaves less than this leaves what the twin does anyway."""
    as_good_left: float = 0.2
    """The same as `as_good_most` where the best is such a cause."""
    as_good_kin: float = 0.92
    """The same where it is a relative of the best, or an effect beside a pattern of few numbers."""
    as_good_curve: float = 0.6
    """The same for an effect beside a pattern that is a free curve."""
    outdone: float = 3.0
    """[standard deviations of trials] So far must the gain of a richer relative lie off what the simpler one would have
    left to it."""
    nearer: float = 0.5
    """[of that distance] Most that it may lie off what the richer one's own trials leave."""
    least_spread: float = 0.01
    """[of the logarithm of the gains' ratio] Trials that agree better tell no more."""
    least_left: float = 0.06
    """[squared misfits per row] The same of what the richer one closes more, where it leaves what the twin
    does anyway."""
    rich: int = 8
    """[numbers] From here a cause is a table or a curve, which two plain ones together may stand for."""
    first_part: float = 0.5
    """[of its gain] Least that the first of these two closes."""
    second_share: float = 0.1
    """[of the squared gap] Least that a further cause closes on an axis that has one: less is its form."""
    second_share_kin: float = 0.3
    """The same for an effect that the first one imitates."""
    second_part: float = 0.5
    """[of what the causes found so far leave of the axis, squared] A further one that closes more than this is none of
    their forms' traces, however large the first gap was; no relative of them."""
    second_rows: float = 3.0
    """[squared misfits per row] Least that it closes then."""
    needless: float = 0.1
    """[of its gain] A cause that closes less than this beside a later one is dropped."""
    most: int = 8
    """Most causes of one diagnosis."""

    habit: float = 0.8
    """[of the twin's own misfit, RMS] What a habit may leave of it at most: one that leaves more is none."""
    habit_unit: float = 0.5
    """[misfits] Unit of a push beside a habit at least: how much of a habit differs from run to run is not known."""
    push: float = 2.2
    """[of the twin's own largest window] Least squared sum over length of all pushes on an axis."""
    push_also: float = 2.0
    """The same of each."""
    push_strong: float = 2.0
    """[misfits] Mean force from which a push is named although it lasts a moment."""
    push_long: float = 1.5
    """[misfits] The same of pushes that close more than the misfit in all."""
    push_short: float = 0.25
    """[s] Shorter pushes must be twice as strong."""
    push_better: float = 1.1
    """[of the gain of the best cause on the axis, named or not] Pushes must close more than what comes with motion."""
    stands: float = 0.01
    """[of the top speed] Below it an axis stands."""
    push_moving: float = 0.2
    """[of a push's rows] Least at which the axis moves: at rest dry friction holds any effort up to its level."""
    push_size: float = 0.0125
    """[of the effort's variation] Least that pushes close, RMS."""
    push_often: float = 2.0
    """[1/s] More pushes than that are a vibration."""
    push_swings: float = 0.5
    """[of the pushes] Of a machine more go to and fro in a shock or a vibration."""
    most_of_time: float = 0.9
    """[of the rows] Pushes that fill more than this are no episodes."""

    other_state: float = 0.5
    """[of the gap over the effort's variation in the diagnosed logs] A validation log with less on an axis that
    nothing explains may be of before the change. Advice only."""

    encoder_share: float = 0.2
    """[of the squared twist between motor and load] Least that elasticity, lost motion or a table closes of it."""
    encoder_noise: float = 1.0
    """[noise of one row] The same, RMS; of a change no less than what the own logs leave either."""

    open_change: float = 1.8
    """[misfit and noise together] What stays of a gap beyond this is open."""
    open_structure: float = 0.085
    """[of the effort's variation, without the noise] The same for a machine."""
    open_tracking: float = 6.0
    """[misfits] The same for the tracking error, simulated from the command, and for motor against load."""
    odd: float = 1.5
    """[misfits] Beyond this an axis is spoken of though nothing is named."""

    named: float = 0.5
    """Confidence from which a cause is named; one that is less sure is listed as possible and names nothing."""
    prior_right: float = 1.0
    """Trials counted as right before any is made."""
    prior_wrong: float = 0.5
    """Trials counted as wrong."""
    quick_confidence: float = 0.7
    """Stated, not measured."""

    vibration_gap: float = 0.35
    """[of the noise's power] Power above the noise that counts as a gap of a passive joint."""
    vibration_form: float = 0.1
    """[of the vibration's RMS] What a twin may be off by without a name."""
    vibration_share: float = 0.2
    """[of the gap's power above the noise] Least that another spring must take away."""
    vibration_moved: float = 4.0
    """[standard errors] By which stiffness or damping must have moved."""
    vibration_stays: float = 0.15
    """[of the gap's power above the noise] What may stay."""
    vibration_quiet: float = 0.25
    """[of the blocks] Those that leave least are the noise where there are no repeats."""

    explained_known: float = 0.5
    """[of the squared gap above the level] Share closed from which a gap counts as explained where what stays is known
    to be no more than an open gap of that model."""
    explained_unknown: float = 0.9
    """The same where no misfit is known."""
    explained_part: float = 0.2
    """The same, below which nothing worth a word is explained."""

    def least_size(self, *, change: bool) -> float:
        """Return the least that a cause must close of its axis' effort [of the effort's variation]."""
        return self.size_change if change else self.size_structure


RULES = Rules()
"""The thresholds in force; `diagnose(..., rules=Rules(...))` takes others."""

DERIVED: Mapping[str, tuple[float, float, int]] = {
    "excess": (0.86, 0.813, 34),
    "push": (2.2, 0, 34),
    "open_change": (1.8, 1.63, 34),
    "size_structure": (0.011, 0.01, 25),
}
"""Rule -> its value, what the most demanding healthy question needs, and how many questions there were."""
COMMAND = "python -m benchmarks calibrate --seed 780"
"""That derived them."""
DATE = "2026-11-25"
"""When."""
