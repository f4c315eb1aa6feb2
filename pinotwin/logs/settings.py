"""What `check` and `prepare` decide by, in one place, to be handed over where a machine is an unusual one."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """The limits beyond which something is said of a log, or done to it."""

    slow_rate: float = 50.0  # [Hz] below it a servo's accelerations (10 to 100 ms) fall between the samples
    same_rate: float = 0.01  # relative difference of two rates up to which they are one clock, measured twice
    shortest: float = 0.5  # [s] log below which no axis has gone to and fro, and nothing is identified
    bridged: int = 2  # missing samples in a row that are interpolated: a motion changes little in two
    jitter: float = 0.02  # [steps] scatter of the stamps from which the motion is asked for the clock
    scatter: float = 0.005  # [steps] of set points from which they jitter; smooth ones stay below 0.0005
    no_clock: float = 0.3  # share of intervals off by half a step or more, from which there is no clock
    smoother: float = 0.5  # ratio of the positions' roughness from which one clock is better than another
    other_speed: float = 0.5  # RMS difference of a speed from the position's, over its RMS: another channel
    coarse: float = 500.0  # steps of its encoder over a motion, below which speeds from it are coarse
    spoiled: float = 0.02  # share of the rows, from which copies or sentinels spoil a log as a whole
    oversampled: float = 0.3  # share of rows like the row before, from which a log outruns the measuring
    twice: float = 0.99  # share of equal numbers that no two measurements have while they change
    rescaled: float = 0.02  # by which a position at rest differs from its command's, whatever the controller
    rescaled_sure: float = 5.0  # standard errors by which that must be known
    slipped: float = (
        1e-4  # share of the travel by which a position rests off its command from where it is told
    )
    follows: float = 0.5  # share of a position's variation up to which its tracking error is one
    # [1/s] swings between the largest efforts of either sign, beyond those of the command, from which a loop is
    # unstable: stable machines stay below 1, an unstable loop reaches 7
    hunts: float = 3.0
    lead_reach: float = 0.010  # [s] longest lead that is looked for between channels
    lead_gain: float = 0.05  # least fall of the residual's power by which a lead or a late command is told
    lag_reach: float = 0.06  # [s] longest lag of an effort, or of a command, that is looked for
    late: float = 0.012  # [s] lag that no drive and no bus has
    sure: float = 3.0  # standard errors by which a sign must differ from zero, a lag from what a drive has
    gain: float = 0.2  # share of what is left of an effort that its best lag must take away
    plain: float = 0.005  # share of an effort's power below which a better fit is not worth a word,
    most: float = 0.6  # unless it takes away this share of what is left
    explained: float = 0.5  # share of an effort's power explained before its sign or size means anything
    poor: float = 0.3  # share of an effort's power left, from which the motion does not explain it
    rubs: float = 0.8  # share of friction that is nearly all of an effort: presliding is late by itself
    nearly_all: float = 0.85  # share that the URDF's masses must explain to say a sign by themselves
    standing: float = 0.1  # spread of an effort over its level below which it stands; noise: 0.01 to 0.03
    factor: float = 6.0  # masses of a URDF are nominal, but not off by more than this
    closer: float = 0.2  # what is left of two efforts once exchanged: product of their shares over today's
    neither: float = 0.9  # the same of each of them alone: neither may be spoiled for the other's sake
    clear: float = 0.05  # share left of an effort from which its position is doubted


USUAL = Settings()  # the settings of a call that names none
