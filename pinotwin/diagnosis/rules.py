"""Thresholds of what is judged, graded and said, in one place: what each means, its unit, its value.

They were set on healthy and faulty logs of simulated and real machines. Causes are not judged by them.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Rules:
    """Thresholds of the diagnosis."""

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
    """[standard errors] Of the twin's effort where it has hardly been, and of friction from day to day."""

    knows: float = 0.95
    """[of the effort's variation] Misfit from which a twin knows nothing of an axis."""
    guessed: float = 3.0
    """[of the largest on the twin's own rows] Standard error of its effort from which a row is not judged."""
    guessed_size: float = 0.5
    """[misfits] Least that this error is."""

    share: float = 0.10
    """[of the squared residual] Least that a cause closes of an axis that it acts on, to be worth a word there."""
    scatter: float = 0.05
    """[of an axis' friction, RMS] By so much friction differs from run to run of one machine, of which a twin of one
    log knows nothing."""

    other_state: float = 0.5
    """[of the gap over the effort's variation in the diagnosed logs] A validation log with less on an axis that
    nothing explains may be of before the change. Advice only."""

    encoder_share: float = 0.2
    """[of the squared twist between motor and load] Least that elasticity, lost motion or a table closes of it."""
    encoder_strength: float = 12.0
    """[squared standard errors] Least size of what lies between motor and load."""

    open_change: float = 1.8
    """[misfit and noise together] What stays of a gap beyond this is open."""
    open_structure: float = 0.085
    """[of the effort's variation, without the noise] The same for a machine."""
    open_tracking: float = 6.0
    """[misfits] The same for the tracking error, simulated from the command, and for motor against load."""
    odd: float = 1.5
    """[misfits] Beyond this an axis is spoken of though nothing is named."""

    vibration_gap: float = 0.35
    """[of the noise's power] Power above the noise that counts as a gap of a passive joint."""
    vibration_form: float = 0.1
    """[of the vibration's RMS] What a twin may be off by without a name."""
    vibration_share: float = 0.2
    """[of the gap's power above the noise] Least that another spring must take away."""
    vibration_moved: float = 4.0
    """[standard errors] By which stiffness or damping must have moved."""
    vibration_quiet: float = 0.25
    """[of the blocks] Those that leave least are the noise where there are no repeats."""

    explained_known: float = 0.5
    """[of the squared gap above the level] Share closed from which a gap counts as explained where what stays is known
    to be no more than an open gap of that model."""
    explained_unknown: float = 0.9
    """The same where no misfit is known."""
    explained_part: float = 0.2
    """The same, below which nothing worth a word is explained."""


RULES = Rules()
"""The thresholds in force."""
