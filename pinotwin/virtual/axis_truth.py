"""The sealed truth of one axis; see :mod:`pinotwin.virtual.truth`."""

from __future__ import annotations

from dataclasses import dataclass

CONTACT = 300.0
"""Mode of motor against load behind a gap where the drive is rigid otherwise [Hz].

Above what a log shows: at 90 Hz play came with an elastic drive, which was most of what a log had of it.
"""


@dataclass(frozen=True)
class Limits:
    """Kinematic limits of an axis.

    Attributes:
        speed: [m/s or rad/s].
        acceleration: [m/s² or rad/s²].
        jerk: [m/s³ or rad/s³].
        travel: lowest and highest position that a trajectory visits [m or rad].
    """

    speed: float | None = None
    acceleration: float | None = None
    jerk: float | None = None
    travel: tuple[float, float] | None = None


@dataclass(frozen=True)
class Controller:
    """Sampled position controller of an axis.

    ``p_pi``: ``u = kv (kp e + vff vr - v) + ki int(kp e + vff vr - v) + aff ar``;
    ``pid``: ``u = kp e + ki int(e) + kd (w vr - v) + vff vr + aff ar`` (kd is ``kv``).

    Attributes:
        kind: ``p_pi`` or ``pid``.
        kp: position gain [1/s] of ``p_pi``, [N/m or N·m/rad] of ``pid``.
        kv: velocity gain [N·s/m or N·m·s/rad].
        ki: integral gain: of velocity error for ``p_pi``, of position error for ``pid``.
        bandwidth: of the velocity loop [Hz]; sets the gains of ``p_pi`` that are not given.
        poles: real pole [Hz], pole pair [Hz] and its damping ratio; sets the gains of ``pid``.
        velocity_feedforward: share of the command's velocity (``p_pi``) or of viscous friction.
        acceleration_feedforward: share of the CAD inertia.
        derivative_weight: w, share of the command's velocity in the derivative part of ``pid``
            (set-point weight); 1 differentiates the error.
        velocity_filter: corner of the first-order filter on the measured velocity [Hz].
        effort_limit: [N or N·m].
        integral_limit: anti-windup limit of the integral part [N or N·m]; by default the limit of the effort and what
            the set-point weight asks of the integral part at top speed.
        delay: whole control periods between measuring and acting.
        current_bandwidth: of the current loop [Hz].
    """

    kind: str = "p_pi"
    kp: float | None = None
    kv: float | None = None
    ki: float | None = None
    bandwidth: float | None = None
    poles: tuple[float, float, float] | None = None
    velocity_feedforward: float = 1.0
    acceleration_feedforward: float = 0.95
    derivative_weight: float = 1.0
    velocity_filter: float = 400.0
    effort_limit: float | None = None
    integral_limit: float | None = None
    delay: int = 0
    current_bandwidth: float = 1200.0


@dataclass(frozen=True)
class Friction:
    """Friction that sticks.

    Attributes:
        kind: ``gms``, ``elastoplastic``, ``lugre`` or ``none`` (viscous only). At rest the dither of an
            encoder's steps let LuGre lose 9 to 52 % of an axis' RMS effort in 5 s and elasto-plastic
            friction up to 5 % (trunnion, rig, driller); generalised Maxwell slip keeps it, as machines
            do, and is the default. LuGre is there because much of the literature uses it.
        coulomb: level at speed [N or N·m].
        static: breakaway over Coulomb level [-], 1 for no Stribeck effect.
        stribeck_speed: [m/s or rad/s].
        viscous: [N·s/m or N·m·s/rad].
        presliding: distance over which the bristles take up the Coulomb level [m or rad].
        damping: damping ratio of the bristles against the axis' inertia [-].
        asymmetry: relative difference of the Coulomb level between the directions [-].
        load: rise of the Coulomb level per transmitted effort [-].
        quadratic: drag proportional to the speed squared.
        warming: relative change of viscosity once warm [-].
        warming_time: its time constant [s].
        wander: relative change of the Coulomb level along the travel [-].
        wander_period: period of that change [m or rad].
        chatter: relative random part of friction at low speed [-].
        drag: effort of cables and hoses once they follow [N or N·m].
        drag_distance: over which it builds up after a reversal [m or rad].
        drag_sharpness: how suddenly it gives way [-].
    """

    kind: str = "gms"
    coulomb: float | None = None
    static: float = 1.35
    stribeck_speed: float | None = None
    viscous: float | None = None
    presliding: float | None = None
    damping: float = 0.3
    asymmetry: float = 0.0
    load: float = 0.0
    quadratic: float = 0.0
    warming: float = 0.0
    warming_time: float = 30.0
    wander: float = 0.0
    wander_period: float = 1.0
    chatter: float = 0.0
    drag: float = 0.0
    drag_distance: float = 0.01
    drag_sharpness: float = 1.0


@dataclass(frozen=True)
class Harmonic:
    """One ripple: ``amplitude (1 + m |sin(q + m_phase)|) sin(2 pi q/period + phase)``.

    ``speed`` > 0 makes the amplitude grow as ``|v| / speed``; ``rate`` > 0 replaces position by
    time.

    Attributes:
        amplitude: [N or N·m].
        period: [m or rad].
        phase: [rad].
        modulation: [-].
        modulation_phase: [rad].
        speed: [m/s or rad/s].
        rate: [Hz].
    """

    amplitude: float
    period: float = 1.0
    phase: float = 0.0
    modulation: float = 0.0
    modulation_phase: float = 0.0
    speed: float = 0.0
    rate: float = 0.0


@dataclass(frozen=True)
class Cable:
    """An irregular, repeatable effort along the travel: cables, covers, guideways.

    Attributes:
        amplitude: RMS of the irregular curve [N or N·m].
        length: shortest wave in it [m or rad].
        end: effort added at the ends of the travel [N or N·m].
        seed: seed of the curve.
    """

    amplitude: float = 0.0
    length: float = 0.02
    end: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Drive:
    """What lies between motor and joint.

    Attributes:
        rotor: reflected rotor inertia [kg or kg·m²]; None takes the machine's, off by the error of
            its inertials.
        frequency: mode of motor against load [Hz]; 0 for a rigid drive.
        damping: damping ratio of that mode [-].
        motor_share: share of the axis' inertia on the motor side [-] if there is no rotor.
        inside: the rotor is a part of the axis' inertia as it was, not an addition to it: what an
            elastic drive that is put into a rigid machine must be, or it would also be a payload.
        encoder: ``motor`` or ``load``.
        backlash: dead zone between motor and load [m or rad].
        friction_on_load: share of friction that acts on the load [-].
    """

    rotor: float | None = None
    frequency: float = 0.0
    damping: float = 0.03
    motor_share: float = 0.35
    inside: bool = False
    encoder: str = "motor"
    backlash: float = 0.0
    friction_on_load: float = 0.0


@dataclass(frozen=True)
class Encoder:
    """Position sensor.

    Attributes:
        resolution: [m or rad].
        noise: RMS of white noise before quantisation [m or rad].
        error: amplitude of a periodic error [m or rad].
        period: its period [m or rad].
        phase: its phase [rad].
        pitch: relative error of scale [-].
    """

    resolution: float | None = None
    noise: float | None = None
    error: float = 0.0
    period: float = 6.283185307179586
    phase: float = 0.0
    pitch: float = 0.0


@dataclass(frozen=True)
class EffortSensor:
    """Measured motor effort.

    Attributes:
        white: RMS of white noise [N or N·m].
        coloured: RMS of slow noise [N or N·m].
        corner: corner of the slow noise [Hz].
        resolution: quantisation step [N or N·m].
        scale: logged over true effort [-].
        lag: how late the logged effort is against position [s]; negative for a lead.
    """

    white: float | None = None
    coloured: float | None = None
    corner: float = 5.0
    resolution: float | None = None
    scale: float = 1.0
    lag: float = 0.0


@dataclass(frozen=True)
class Bend:
    """A hidden joint behind an axis, of the same direction: its carriage or housing bends.

    Attributes:
        frequency: mode with the motor held [Hz].
        damping: damping ratio [-].
        share: share of the axis' own body that lies behind the spring [-].
    """

    frequency: float
    damping: float = 0.03
    share: float = 0.7


@dataclass(frozen=True)
class AxisTruth:
    """Everything about one axis."""

    limits: Limits = Limits()
    controller: Controller = Controller()
    friction: Friction = Friction()
    ripple: tuple[Harmonic, ...] = ()
    cable: Cable = Cable()
    drive: Drive = Drive()
    encoder: Encoder = Encoder()
    effort: EffortSensor = EffortSensor()
    bend: Bend | None = None
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
