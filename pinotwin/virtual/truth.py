"""The sealed truth of a virtual machine: what ``virtual.yaml`` may say, as frozen dataclasses.

Everything is SI unless the field says otherwise. A value left at ``None`` is filled in by a rule
from the machine's inertia and limits (:mod:`pinotwin.virtual.defaults`), so any machine folder
can run. The identification side never reads this file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pinotwin.virtual.axis_truth import AxisTruth


@dataclass(frozen=True)
class Passive:
    """Spring and damper on a joint without motor.

    Attributes:
        frequency: natural frequency at home with all motors held [Hz]; sets ``stiffness``.
        stiffness: [N/m or N·m/rad].
        damping_ratio: at that frequency [-]; sets ``damping``.
        damping: [N·s/m or N·m·s/rad].
        hardening: cubic stiffness [N/m³ or N·m/rad³].
        hysteresis: Coulomb level of a bristle beside the spring [N or N·m].
        hysteresis_width: deflection over which it builds up [m or rad].
    """

    frequency: float | None = None
    stiffness: float | None = None
    damping_ratio: float = 0.03
    damping: float | None = None
    hardening: float = 0.0
    hysteresis: float = 0.0
    hysteresis_width: float = 1e-4


@dataclass(frozen=True)
class Payload:
    """A mass that the URDF does not know.

    Attributes:
        joint: joint whose body carries it.
        mass: [kg].
        centre: in the joint frame [m].
    """

    joint: str
    mass: float
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Pulse:
    """A half-sine load on a link, in world axes.

    Attributes:
        link: link of the URDF; the load acts at its frame.
        time: start [s].
        duration: [s].
        force: peak force [N].
        moment: peak moment [N·m].
        logged: whether the log holds it.
    """

    link: str
    time: float
    duration: float
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)
    logged: bool = True


@dataclass(frozen=True)
class Truth:
    """The whole sealed truth.

    Attributes:
        seed: of everything that is drawn once per machine.
        control_rate: [Hz].
        log_rate: [Hz].
        substeps: integration steps per control period; None chooses from the stiffest element.
        inertial_error: smallest and largest relative error of the shipped inertials [-].
        scatter: relative run-to-run scatter of Coulomb and viscous friction [-].
        coupled: False removes every inertial coupling between the axes.
        axes: per axis.
        passive: per passive joint.
        payload: masses that the URDF does not know.
        external: loads on links.
    """

    seed: int = 0
    control_rate: float = 4000.0
    log_rate: float = 500.0
    substeps: int | None = None
    inertial_error: tuple[float, float] = (0.10, 0.20)
    scatter: float = 0.01
    coupled: bool = True
    axes: Mapping[str, AxisTruth] = field(default_factory=dict)
    passive: Mapping[str, Passive] = field(default_factory=dict)
    payload: tuple[Payload, ...] = ()
    external: tuple[Pulse, ...] = ()
