"""What a machine is made of: axes, passive joints, sensors, loop orders and how its logs are prepared.

The types are those of machine.yaml, too: see :mod:`pinotwin.system.reading`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta

from pinotwin.effects import Effect
from pinotwin.system.reading import Count, NotNegative, Number, Positive, from_file

LeftOut = tuple[str, str | float, float]
"""Rows that are no measurement: (file, from, to) [s], or (file, channel, value); no file name: every log."""

EffectList = Annotated[list[Any], Meta(description="a list such as [viscous, coulomb]")]
_Poles = Annotated[int, Meta(ge=0, le=20, description="a whole number from 0 to 20")]
_Ends = Annotated[tuple[Positive, Positive], Meta(description="[lower, upper]")]
_Feedforward = Annotated[
    Literal["search"] | list[Positive], Meta(description="search, or a list of frequencies [Hz]")
]
_Drop = Annotated[Count | list[Count], Meta(description="samples at the start and the end")]
_Effort = Annotated[
    dict[str, str | Number | dict[str, dict[str, Number]]],
    Meta(description="what the logged effort is: {kind: current}, or a law that makes it: {law: pd, kp: 40}"),
]
_Time = Annotated[Number | str, Meta(description="a time such as 3.5 ms")]
_Row = (
    Annotated[list[Number], Meta(min_length=2, max_length=2, description="[from, to] in s")]
    | dict[str, Number | list[Number]]
)
_Rows = Annotated[
    list[_Row] | dict[str, list[_Row]],
    Meta(description="a list such as [[1.5, 2.0]] in s or [{feedrate: 50}]"),
]


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
        effort: what the logged effort is, ``{kind: raw}``, ``gravity_compensated``, ``magnitude``, ``external``,
            ``percent`` or ``current``; or the law ``{law: pd, kp: ..., kd: ...}`` of a servo without a logged torque.
    """

    name: str = field(metadata=from_file())
    joint: str
    index: int = field(metadata=from_file())
    rotary: bool = field(metadata=from_file())
    effects: tuple[Effect, ...] = field(metadata=from_file(EffectList))
    rotor_inertia: NotNegative = 0.0
    effort_limit: Positive = np.inf
    zero: Number = 0.0
    min_speed: NotNegative | None = None
    min_acceleration: Positive = np.inf
    lead: float | None = field(default=None, metadata=from_file(_Time))
    effort: Mapping[str, Any] | None = field(default=None, metadata=from_file(_Effort))


@dataclass(frozen=True)
class Passive:
    """A joint without motor or encoder, held by a spring and a damper."""

    name: str = field(metadata=from_file())  # how results name it
    joint: str  # its joint in the URDF
    index: int = field(metadata=from_file())  # its column in the machine's arrays
    rotary: bool = field(metadata=from_file())  # True for rad, False for m
    stiffness: NotNegative | None = None  # nominal stiffness [N/m or N·m/rad], None when unknown
    damping: NotNegative | None = None  # nominal damping [N·s/m or N·m·s/rad], None when unknown


@dataclass(frozen=True)
class Imu:
    """An inertial sensor fixed to a link."""

    name: str = field(metadata=from_file())
    link: str


@dataclass(frozen=True)
class LoopShape:
    """An axis' closed loop (thesis Eq. 4.14), the free black box of it."""

    real_poles: _Poles = 3  # all real poles, those of the feed-forward included
    pole_pairs: _Poles = 1  # complex pairs
    # preassigned poles that make the feed-forward causal [Hz], ``"search"`` for one double pole that is
    # searched, () for none; None for two at the sampling frequency
    feedforward_poles: tuple[float, ...] | Literal["search"] | None = field(
        default=None, metadata=from_file(_Feedforward)
    )
    numerators: Literal["exact", "source"] = "exact"  # "source": disturbance's without feed-forward poles
    # of the search, by parameter (``p1``, ``wn1``, ``zeta1``, ``pff``) [Hz] or [-]
    bounds: Mapping[str, tuple[float, float]] = field(
        default_factory=dict, metadata=from_file(dict[str, _Ends])
    )
    # which position the controller regulates: of the ``motor`` or, measured by a second encoder (channel
    # ``<axis>.ql``), of the ``load``
    closed_on: Literal["motor", "load"] = "motor"
    stated: bool = field(default=True, metadata=from_file())  # whether anything of the black box was given


@dataclass(frozen=True)
class DataSettings:
    """How a log of this machine is prepared; None leaves the choice to the data."""

    cutoff: Positive | None = None  # corner of the zero-phase low-pass [Hz]
    # order of the Butterworth filter
    order: Annotated[int, Meta(ge=1, le=10, description="a whole number from 1 to 10")] = 4
    # keep one row in so many when fitting
    decimate: Annotated[int, Meta(ge=1, description="a whole number from 1")] | None = None
    filter_effort: bool = True  # low-pass the effort as well (positions always are)
    # samples to drop at the start and at the end of a stretch
    drop: tuple[int, int] | None = field(default=None, metadata=from_file(_Drop))
    resample: Positive | None = None  # rate of the even clock that logs are put on [Hz]; None keeps theirs
    # rows that are no measurement, by time or by the value of a channel such as a feed rate
    leave_out: tuple[LeftOut, ...] = field(default=(), metadata=from_file(_Rows))


@dataclass(frozen=True)
class MachineFile:
    """The keys of machine.yaml; see docs/machine.md."""

    name: str
    urdf: str
    axes: dict[str, Axis]
    passive: dict[str, Passive] = field(default_factory=dict)
    gravity: Annotated[
        tuple[Number, Number, Number], Meta(description="[x, y, z] in m/s² along the axes of the URDF's root")
    ] = (0.0, 0.0, -9.81)
    imus: dict[str, Imu] = field(default_factory=dict)
    loop: dict[str, LoopShape] = field(default_factory=dict)
    effort: _Effort = field(default_factory=dict)
    columns: dict[str, Any] = field(default_factory=dict)
    transmission: dict[str, dict[str, Number]] = field(default_factory=dict)
    data: DataSettings = field(default_factory=DataSettings)
    meshes: Annotated[str | list[str], Meta(description="a folder or a list of folders")] = ""
