"""The sealed truth of one axis; see :mod:`pinotwin.virtual.truth`."""

from __future__ import annotations

from dataclasses import dataclass, field

from pinotwin.trajectories.moves import Limits

CONTACT = 300.0
"""Mode of motor against load behind backlash where the drive is rigid otherwise [Hz]: above what a log shows."""


@dataclass(frozen=True)
class Controller:
    """Sampled position controller of an axis.

    ``p_pi``: ``u = kv (kp e + vff vr - v) + ki int(kp e + vff vr - v) + aff ar``;
    ``pid``: ``u = kp e + ki int(e) + kd (w vr - v) + vff vr + aff ar`` (kd is ``kv``).
    """

    kind: str = "p_pi"  # p_pi or pid
    kp: float | None = None  # position gain [1/s] of p_pi, [N/m or N·m/rad] of pid
    kv: float | None = None  # velocity gain [N·s/m or N·m·s/rad]
    ki: float | None = None  # integral gain: of velocity error for p_pi, of position error for pid
    bandwidth: float | None = None  # of the velocity loop [Hz]; sets the gains of p_pi that are not given
    poles: tuple[float, float, float] | None = None  # real pole [Hz], pair [Hz], its damping; sets pid
    velocity_feedforward: float = 1.0  # share of the command's velocity (p_pi) or of viscous friction
    acceleration_feedforward: float = 0.95  # share of the CAD inertia
    # w, share of the command's velocity in the derivative part of pid (set-point weight); 1 differentiates
    # the error
    derivative_weight: float = 1.0
    velocity_filter: float = 400.0  # corner of the first-order filter on the measured velocity [Hz]
    effort_limit: float | None = None  # [N or N·m]
    # anti-windup limit of the integral part [N or N·m]; by default the limit of the effort and what the
    # set-point weight asks of the integral part at top speed
    integral_limit: float | None = None
    delay: int = 0  # whole control periods between measuring and acting
    current_bandwidth: float = 1200.0  # of the current loop [Hz]


@dataclass(frozen=True)
class Friction:
    """Friction that sticks."""

    # gms, elastoplastic, lugre or none (viscous only). At rest the dither of an encoder's steps makes LuGre,
    # and less so elasto-plastic friction, lose an effort that machines keep; generalised Maxwell slip keeps it.
    kind: str = "gms"
    coulomb: float | None = None  # level at speed [N or N·m]
    static: float = 1.35  # breakaway over Coulomb level [-], 1 for no Stribeck effect
    stribeck_speed: float | None = None  # [m/s or rad/s]
    viscous: float | None = None  # [N·s/m or N·m·s/rad]
    presliding: float | None = None  # distance over which the bristles take up the Coulomb level [m or rad]
    damping: float = 0.3  # damping ratio of the bristles against the axis' inertia [-]
    asymmetry: float = 0.0  # relative difference of the Coulomb level between the directions [-]
    load: float = 0.0  # rise of the Coulomb level per transmitted effort [-]
    quadratic: float = 0.0  # drag proportional to the speed squared
    warming: float = 0.0  # relative change of viscosity once warm [-]
    warming_time: float = 30.0  # its time constant [s]
    wander: float = 0.0  # relative change of the Coulomb level along the travel [-]
    wander_period: float = 1.0  # period of that change [m or rad]
    chatter: float = 0.0  # relative random part of friction at low speed [-]
    drag: float = 0.0  # effort of cables and hoses once they follow [N or N·m]
    drag_distance: float = 0.01  # over which it builds up after a reversal [m or rad]
    drag_sharpness: float = 1.0  # how suddenly it gives way [-]


@dataclass(frozen=True)
class Harmonic:
    """One ripple: ``amplitude (1 + m |sin(q + m_phase)|) sin(2 pi q/period + phase)``."""

    amplitude: float  # [N or N·m]
    period: float = 1.0  # [m or rad]
    phase: float = 0.0  # [rad]
    modulation: float = 0.0  # [-]
    modulation_phase: float = 0.0  # [rad]
    speed: float = 0.0  # [m/s or rad/s]
    rate: float = 0.0  # [Hz]


@dataclass(frozen=True)
class Cable:
    """An irregular, repeatable effort along the travel: cables, covers, guideways."""

    amplitude: float = 0.0  # RMS of the irregular curve [N or N·m]
    length: float = 0.02  # shortest wave in it [m or rad]
    end: float = 0.0  # effort added at the ends of the travel [N or N·m]
    seed: int = 0  # seed of the curve


@dataclass(frozen=True)
class Drive:
    """What lies between motor and joint."""

    # reflected rotor inertia [kg or kg·m²]; None takes the machine's, off by the error of its inertials
    rotor: float | None = None
    frequency: float = 0.0  # mode of motor against load [Hz]; 0 for a rigid drive
    damping: float = 0.03  # damping ratio of that mode [-]
    motor_share: float = 0.35  # share of the axis' inertia on the motor side [-] if there is no rotor
    # the rotor is a part of the axis' inertia as it was, not an addition to it: what an elastic drive that
    # is put into a rigid machine must be, or it would also be a payload
    inside: bool = False
    encoder: str = "motor"  # motor or load
    backlash: float = 0.0  # dead zone between motor and load [m or rad]


@dataclass(frozen=True)
class Encoder:
    """Position sensor."""

    resolution: float | None = None  # [m or rad]
    noise: float | None = None  # RMS of white noise before quantisation [m or rad]
    error: float = 0.0  # amplitude of a periodic error [m or rad]
    period: float = 6.283185307179586  # its period [m or rad]
    phase: float = 0.0  # its phase [rad]
    pitch: float = 0.0  # relative error of scale [-]


@dataclass(frozen=True)
class EffortSensor:
    """Measured motor effort."""

    white: float | None = None  # RMS of white noise [N or N·m]
    coloured: float | None = None  # RMS of slow noise [N or N·m]
    corner: float = 5.0  # corner of the slow noise [Hz]
    resolution: float | None = None  # quantisation step [N or N·m]
    scale: float = 1.0  # logged over true effort [-]
    lag: float = 0.0  # how late the logged effort is against position [s]; negative for a lead


@dataclass(frozen=True)
class Bend:
    """A hidden joint behind an axis, of the same direction: its carriage or housing bends."""

    frequency: float  # mode with the motor held [Hz]
    damping: float = 0.03  # damping ratio [-]
    share: float = 0.7  # share of the axis' own body that lies behind the spring [-]


@dataclass(frozen=True)
class AxisTruth:
    """Everything about one axis."""

    limits: Limits = field(default_factory=Limits)
    controller: Controller = Controller()
    friction: Friction = Friction()
    ripple: tuple[Harmonic, ...] = ()
    cable: Cable = Cable()
    drive: Drive = Drive()
    encoder: Encoder = Encoder()
    effort: EffortSensor = EffortSensor()
    bend: Bend | None = None
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
