"""What `check` and `prepare` decide by, in one place, to be handed over where a machine is an unusual one."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """The limits beyond which something is said of a log, or done to it.

    Attributes:
        slow_rate: [Hz] below it a servo's accelerations (10 to 100 ms long) fall between the samples.
        same_rate: relative difference of two rates up to which they are one clock, measured twice.
        shortest: [s] log below which no axis has gone to and fro, and nothing is identified.
        bridged: missing samples in a row that are interpolated: a motion changes little in two.
        jitter: [steps] scatter of the stamps from which the motion is asked for the clock.
        no_clock: share of intervals off by half a step or more, from which there is no clock.
        smoother: ratio of the positions' roughness from which one clock is better than another.
        other_speed: RMS difference of a measured speed from the position's, over its RMS, that is another channel's.
        coarse: steps of its encoder over a motion, below which speeds from it are coarse.
        spoiled: share of the rows, from which copies or sentinels spoil a log as a whole.
        oversampled: share of rows like the row before, from which a log is sampled faster than it is measured.
        twice: share of equal numbers that no two measurements have while they change.
        rescaled: by which a position at rest differs from its command's size, whatever the controller.
        rescaled_sure: standard errors by which that must be known.
        follows: share of a position's variation up to which its tracking error is one.
        hunts: [1/s] swings between the largest efforts of either sign, beyond those of the command, from which a
            loop is unstable: stable machines stay below 1, an unstable loop reaches 7.
        lead_reach: [s] longest lead that is looked for between channels.
        lead_gain: fall of the residual's power below which a lead is not worth telling.
        lag_reach: [s] longest lag of an effort that is looked for.
        late: [s] lag that no drive and no bus has.
        sure: standard errors by which a sign must differ from zero, a lag from what a drive has.
        gain: share of what is left of an effort that its best lag must take away.
        plain: share of an effort's power below which a better fit is not worth a word,
        most: unless it takes away this share of what is left.
        explained: share of an effort's power that must be explained before its sign or size means anything.
        poor: share of an effort's power left, from which the motion does not explain it.
        rubs: share of friction from which it is nearly all of an effort: presliding friction is late by itself.
        nearly_all: share that the URDF's masses must explain to say a sign by themselves.
        standing: spread of an effort over its level below which it stands; a drive's noise is 0.01 to 0.03.
        factor: masses of a URDF are nominal, but not off by more than this.
        closer: what is left of two efforts once exchanged, the product of both shares over that of today.
        neither: the same of each of them alone: neither may be spoiled for the other's sake.
        clear: share left of an effort from which its position is doubted.
    """

    slow_rate: float = 50.0
    same_rate: float = 0.01
    shortest: float = 0.5
    bridged: int = 2
    jitter: float = 0.02
    no_clock: float = 0.3
    smoother: float = 0.5
    other_speed: float = 0.5
    coarse: float = 500.0
    spoiled: float = 0.02
    oversampled: float = 0.3
    twice: float = 0.99
    rescaled: float = 0.02
    rescaled_sure: float = 5.0
    follows: float = 0.5
    hunts: float = 3.0
    lead_reach: float = 0.010
    lead_gain: float = 0.05
    lag_reach: float = 0.06
    late: float = 0.012
    sure: float = 3.0
    gain: float = 0.2
    plain: float = 0.005
    most: float = 0.6
    explained: float = 0.5
    poor: float = 0.3
    rubs: float = 0.8
    nearly_all: float = 0.85
    standing: float = 0.1
    factor: float = 6.0
    closer: float = 0.2
    neither: float = 0.9
    clear: float = 0.05


USUAL = Settings()
"""The settings of a call that names none."""
