"""What the judgement takes for granted of every machine, before anything of it is measured."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Settings:
    """Constants of the method.

    Attributes:
        corner: of the low-pass that every column goes through [Hz]. cell: length of one cell of evidence [s].
        folds: parts of a log that are left out in turn. order: of the autoregression of the misfit.
        freedom: of Student's t, by which one bad cell decides nothing.
        number: what one more number costs [nats]. place: what a place or an instant costs, for it was searched [nats].
        widths: prior width of a healthy day: friction parts over their size, offset over the effort's RMS, a delay in
            half cycles; zero [m or rad] and scale between two encoders, and give of what lies between over its size.
        share: of the effort, below which a cause is not worth a word, five times that of what acts for a while; of a
            squared residual that others close, below which a further one is none.
        trace: of what a cause does, RMS, so much may be left of it because its form is not quite right.
        told: the least number worth a word, by group: of a gain its change, of two encoders tenths of a millimetre.
        likely: probability of a cause that has acted from which it is named.
        prior_days: how many days that prior counts for.
        rate: rows a second [Hz] of what a model lacks; beyond half of it a drive holds its effort otherwise.
        floor: of an effort's variation, what no model leaves less than.
        wide: prior width of the twin's columns, in units of the noise.
        late: standard deviation of half of a drive's cycle [s]. blur: of a row's smoothing of the effort [1].
        far: standard deviations from which that is no habit of a healthy axis, but a finding.
    """

    corner: float = 25.0
    cell: float = 0.5
    folds: int = 6
    order: int = 6
    freedom: float = 4.0
    number: float = 2.0
    place: float = 8.0
    share: float = 0.01
    trace: float = 1.0 / 3.0
    told: dict[str, float] = field(default_factory=lambda: {"law": 0.01, "play": 0.02, "encoder": 0.02})
    likely: float = 0.5
    prior_days: int = 3
    rate: float = 100.0
    floor: float = 0.005
    wide: float = 1e3
    late: float = 2.5e-4
    blur: float = 0.25
    far: float = 3.0
    widths: dict[str, float] = field(
        default_factory=lambda: {
            "friction": 0.05,
            "dry": 0.03,
            "viscous": 0.05,
            "warm": 0.05,
            "offset": 0.01,
            "late": 1.0,
            "zero": 5e-6,
            "scale": 1e-5,
            "give": 0.05,
        }
    )


SETTINGS = Settings()
