"""What a machine is made of: axes, passive joints, sensors, loop orders and how its logs are prepared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from pinotwin.effects import Effect

LeftOut = tuple[str, str | float, float]
"""Rows that are no measurement: (file, from, to) [s], or (file, channel, value); no file name: every log."""


@dataclass(frozen=True)
class Axis:
    """A joint with a motor and an encoder.

    Attributes:
        name: how the log names it.
        joint: its joint in the URDF.
        index: its column in the machine's arrays.
        rotary: True for rad and N·m, False for m and N.
        effects: what acts on it beside the rigid-body dynamics.
        rotor_inertia: nominal reflected inertia of motor and screw [kg or kg·m²].
        effort_limit: largest effort of the drive [N or N·m], inf when not given.
        zero: joint position where the log reads zero [m or rad].
        min_speed: rows slower than this are not used to identify the axis [m/s or rad/s].
        min_acceleration: unless they accelerate harder than this [m/s² or rad/s²].
        lead: time by which its logged effort is ahead of its position [s]; None leaves it to `identify`.
    """

    name: str
    joint: str
    index: int
    rotary: bool
    effects: tuple[Effect, ...]
    rotor_inertia: float = 0.0
    effort_limit: float = np.inf
    zero: float = 0.0
    min_speed: float | None = None
    min_acceleration: float = np.inf
    lead: float | None = None


@dataclass(frozen=True)
class Passive:
    """A joint without motor or encoder, held by a spring and a damper.

    Attributes:
        name: how results name it.
        joint: its joint in the URDF.
        index: its column in the machine's arrays.
        rotary: True for rad, False for m.
        stiffness: nominal stiffness [N/m or N·m/rad], None when unknown.
        damping: nominal damping [N·s/m or N·m·s/rad], None when unknown.
    """

    name: str
    joint: str
    index: int
    rotary: bool
    stiffness: float | None = None
    damping: float | None = None


@dataclass(frozen=True)
class Imu:
    """An inertial sensor fixed to a link."""

    name: str
    link: str


@dataclass(frozen=True)
class LoopShape:
    """An axis' closed loop (thesis Eq. 4.14), the free black box of it.

    Attributes:
        real_poles: all real poles, those of the feed-forward included.
        pole_pairs: complex pairs.
        feedforward_poles: preassigned poles that make the feed-forward causal [Hz], ``"search"`` for one double
            pole that is searched, () for none; None for two at the sampling frequency.
        numerators: ``"exact"``, or ``"source"`` for disturbance numerators without the feed-forward's poles.
        bounds: of the search, by parameter (``p1``, ``wn1``, ``zeta1``, ``pff``) [Hz] or [-].
        closed_on: which position the controller regulates: of the ``motor`` or, measured by a second encoder
            (channel ``<axis>.ql``), of the ``load``.
        stated: whether anything of the black box was given.
    """

    real_poles: int = 3
    pole_pairs: int = 1
    feedforward_poles: tuple[float, ...] | Literal["search"] | None = None
    numerators: Literal["exact", "source"] = "exact"
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    closed_on: str = "motor"
    stated: bool = True


@dataclass(frozen=True)
class DataSettings:
    """How a log of this machine is prepared; None leaves the choice to the data.

    Attributes:
        cutoff: corner of the zero-phase low-pass [Hz].
        order: order of the Butterworth filter.
        decimate: keep one row in so many when fitting.
        filter_effort: low-pass the effort as well (positions always are).
        drop: samples to drop at the start and at the end of a stretch.
        resample: rate of the even clock that logs are put on [Hz]; None keeps theirs.
        leave_out: rows that are no measurement, by time or by the value of a channel such as a feed rate.
    """

    cutoff: float | None = None
    order: int = 4
    decimate: int | None = None
    filter_effort: bool = True
    drop: tuple[int, int] | None = None
    resample: float | None = None
    leave_out: tuple[LeftOut, ...] = ()
