"""The sealed truth of a virtual machine: what ``virtual.yaml`` may say, SI unless the field says otherwise.

``None`` is filled in by a rule (:mod:`pinotwin.virtual.defaults`). The identification side never reads this file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pinotwin.virtual.axis_truth import AxisTruth


@dataclass(frozen=True)
class Passive:
    """Spring and damper on a joint without motor."""

    frequency: float | None = None  # natural frequency at home with all motors held [Hz]; sets stiffness
    stiffness: float | None = None  # [N/m or N·m/rad]
    damping_ratio: float = 0.03  # at that frequency [-]; sets damping
    damping: float | None = None  # [N·s/m or N·m·s/rad]
    hardening: float = 0.0  # cubic stiffness [N/m³ or N·m/rad³]
    hysteresis: float = 0.0  # Coulomb level of a bristle beside the spring [N or N·m]
    hysteresis_width: float = 1e-4  # deflection over which it builds up [m or rad]


@dataclass(frozen=True)
class Payload:
    """A mass that the URDF does not know."""

    joint: str  # joint whose body carries it
    mass: float  # [kg]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)  # in the joint frame [m]


@dataclass(frozen=True)
class Pulse:
    """A half-sine load on a link, in world axes."""

    link: str  # link of the URDF; the load acts at its frame
    time: float  # start [s]
    duration: float  # [s]
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)  # peak force [N]
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)  # peak moment [N·m]
    logged: bool = True  # whether the log holds it


@dataclass(frozen=True)
class Truth:
    """The whole sealed truth."""

    seed: int = 0  # of everything that is drawn once per machine
    control_rate: float = 4000.0  # [Hz]
    log_rate: float = 500.0  # [Hz]
    substeps: int | None = None  # integration steps per control period; None: by the stiffest element
    inertial_error: tuple[float, float] = (0.10, 0.20)  # least and largest of the inertials [-]
    scatter: float = 0.01  # relative run-to-run scatter of Coulomb and viscous friction [-]
    coupled: bool = True  # False removes every inertial coupling between the axes
    axes: Mapping[str, AxisTruth] = field(default_factory=dict)  # per axis
    passive: Mapping[str, Passive] = field(default_factory=dict)  # per passive joint
    payload: tuple[Payload, ...] = ()  # masses that the URDF does not know
    external: tuple[Pulse, ...] = ()  # loads on links
