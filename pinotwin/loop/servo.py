r"""A servo controller in continuous time: one law for cascade, set-point weight and PID alike.

    u0  = k_e e + I - k_v v_f + k_vr vr + k_ar ar,      I' = k_i e + k_w vr
    v_f = v / (1 + s T_v)                               the velocity that the drive sees, late
    u   = N(s) u0 / (1 + s T_u)                         notch and current loop

u acts ``dead`` seconds later on the axis. A cascade (P-PI) with gains kp and kv, integral time ti, feed-forwards ffv
and ffa of velocity and acceleration, and set-point weight w of the proportional part is

    k_e = kv (kp + 1/ti),  k_i = kv kp / ti,      k_v = kv (1 - T_v / ti),
    k_vr = kv w ffv,       k_w = kv (ffv - 1) / ti,  k_ar = ffa

since the integral of its velocity error sees the late velocity too: that of v_f is q - T_v v_f. Left out, the term (1
to 2 % of k_v) makes a quarter of kp and a third of 1/ti, a small difference of nearly equal roots. In a PID k_w is
zero. At given shapes (T_v, T_u, the notch) the law is linear in its six gains: least squares finds them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import msgspec
import numpy as np

from pinotwin.arrays import Floats, plain
from pinotwin.errors import InputError, require

if TYPE_CHECKING:
    import control


class Roots(NamedTuple):
    """What the feedback says of kp and 1/ti of a cascade: two roots of one equation, often nearly equal.

        (1 + T A) r² - (A + T B) r + B = 0     for r = 1/ti,     kp = A - (1 + T A) r

    with A = k_e / k_v, B = k_i / k_v and the lag T of the velocity; kp is, but for the lag, the other root. They lie
    sqrt(apart) from one another, apart = (A - T B)² - 4 B; where they meet, a linear estimate of their error grows
    without bound. Intervals are therefore made from ``apart`` and its error, not from the slopes of the roots.
    """

    kp: float  # middle of the kp that there may be [1/s]
    rate: float  # the same of 1/ti [1/s]
    square: float  # 1 + T A, by which a change of 1/ti moves kp the other way [-]
    apart: float  # square of the difference of the roots [1/s²]; below zero where noise left no real ones
    product: float  # kp / ti [1/s²]

    @classmethod
    def of(cls, gains: Sequence[float], lag: float) -> Self:
        """Return the roots of six gains and a lag of the velocity [s]."""
        A, B = gains[0] / gains[2], gains[1] / gains[2]
        square = 1.0 + lag * A
        rate = 0.5 * (A + lag * B) / square
        return cls(0.5 * (A - lag * B), rate, square, (A - lag * B) ** 2 - 4.0 * B, B * (1.0 - lag * rate))

    def half(self, more: float = 0.0) -> float:
        """Return half the difference of the two 1/ti [1/s], ``more`` added to what they are apart [1/s²]."""
        return 0.5 * math.sqrt(max(self.apart + more, 0.0)) / self.square

    def rates(self, named: float, error: float, *, tied: bool) -> tuple[float, float]:
        """Return the lowest and the highest 1/ti [1/s] at 90 %, on both sides of the middle where ``tied``."""
        far, near = self.half(error), self.half(-error)
        if tied:
            return self.rate - far, self.rate + far
        side = 1.0 if named >= self.rate else -1.0
        ends = self.rate + side * near, self.rate + side * far
        return min(ends), max(ends)


GAINS = ("e", "integral", "v", "vr", "slip", "ar")
"""Names of the six gains, in the order of the arrays: k_e, k_i, k_v, k_vr, k_w, k_ar."""
TWO_SIDED = 1.645  # Standard errors on either side of a value that make 90 %
NARROW = 0.10
"""A gain is determined where its 90 % interval reaches no further from it than this share of it: a simulation
or a new tuning that takes it for the truth is then off by no more than a tenth."""
SHAPES = ("velocity_lag", "output_lag", "dead")
INPUTS = ("e", "v", "vr", "ar")
"""What a law takes: tracking error, velocity, velocity and acceleration of the command."""
DISTANCE = "apart"
"""Name under which the error of what kp and 1/ti are apart is kept, see :class:`pinotwin.loop.servo.Roots`."""
LOST = "lost motion"
FOLLOWING = "1/Kv"
"""Name under which the error of :meth:`Servo.following` is kept: smooth where Kv itself goes through infinity."""
Form = Literal["general", "cascade", "pid", "proportional"]


@dataclass(frozen=True)
class Servo:
    """The controller of one axis as identified; SI with the effort in N or N·m.

    Attributes:
        gains: the six of :data:`GAINS`.
        velocity_lag: T_v [s].
        output_lag: T_u [s].
        notch: frequency [Hz], damping ratio of the zeros and of the poles; a frequency of 0 for none.
        dead: from the effort as logged to the effort that acts [s].
        limit: largest effort [N or N·m]; the integrator stops there.
        form: ``cascade`` where set-point weight 1 was imposed, ``pid`` where k_w = 0 was, ``proportional``
            where there is no integral; ``general`` has all six gains free.
        offset: what I holds for ever in the proportional form [N or N·m].
        errors: standard errors by the names of :meth:`named` and :meth:`combined`; those of a cascade with kp and
            1/ti in the middle between their roots, and as :data:`DISTANCE` that of the square of their distance.
        other: another cascade that the log speaks for as well, by the same names; empty where there is none.
        step: sampling interval of the log [s].
        encoder: step and origin of the position that the law sees [m or rad]; a step of 0 for any position. An axis
            at rest is off by a part of a step, and an integral winds up on that.
        lost: motion lost between motor and load [m or rad], where both are measured.
    """

    gains: tuple[float, ...]
    velocity_lag: float = 0.0
    output_lag: float = 0.0
    notch: tuple[float, float, float] = (0.0, 0.0, 1.0)
    dead: float = 0.0
    limit: float = math.inf
    form: Form = "general"
    offset: float = 0.0
    errors: Mapping[str, float] = field(default_factory=dict)
    other: Mapping[str, float] = field(default_factory=dict)
    step: float = 0.001
    encoder: tuple[float, float] = (0.0, 0.0)
    lost: float | None = None

    @classmethod
    def of_cascade(
        cls, kp: float, kv: float, rate: float, ffv: float, ffa: float, weight: float = 1.0, **shapes: Any
    ) -> Self:
        """Return the law of a cascade: rate is 1/ti, weight that of the set point in the proportional part."""
        seen = 1.0 - rate * shapes.get("velocity_lag", 0.0)
        gains = (kv * (kp + rate), kv * kp * rate, kv * seen, kv * weight * ffv, kv * rate * (ffv - 1.0), ffa)
        form = "proportional" if rate == 0.0 else "cascade" if weight == 1.0 else "general"
        return cls(gains, **{"form": form, **shapes})

    def cascades(self) -> list[dict[str, float]]:
        """Return the cascades that have these gains: two, since kp and 1/ti enter k_e and k_i alike.

        Each has kp, kv, rate (1/ti), ffv, ffa and the set-point weight; they differ in ffv and weight. The one
        whose feed-forward is nearest to a set-point weight of 1 comes first. A double root stands for a pair that is
        not real. A law without an integral has no 1/ti: its other root, an integral in place of kp, is none of a drive.
        """
        if self.gains[1] == 0.0 and self.gains[4] == 0.0:
            return [self._without_integral()]
        roots = Roots.of(self.gains, self.velocity_lag)
        half = roots.half()
        found = (self.with_rate(rate) for rate in (roots.rate - half, roots.rate + half))
        real = (f for f in found if f is not None and f["kp"] >= 0.0)
        return sorted(real, key=lambda f: abs(self.gains[3] / f["kv"] - f["ffv"]))

    def with_rate(self, rate: float) -> dict[str, float] | None:
        """Return the cascade with this 1/ti [1/s] and the feedback of these gains, None where there is none."""
        k_e, _, k_v, k_vr, k_w, ffa = self.gains
        seen = 1.0 - rate * self.velocity_lag
        if rate <= 0.0 or seen == 0.0 or k_v / seen <= 0.0:
            return None
        kv = k_v / seen
        ffv = 1.0 + k_w / (kv * rate)
        weight = k_vr / (kv * ffv) if ffv != 0.0 else 1.0 if k_vr == 0.0 else math.inf
        return {"kp": k_e / kv - rate, "kv": kv, "rate": rate, "ffv": ffv, "ffa": ffa, "weight": weight}

    def cascade(self) -> dict[str, float]:
        """Return kp, kv, rate (1/ti), ffv, ffa and the set-point weight; of two alike kp is the larger."""
        found = self.cascades()
        return found[0] if found else self._without_integral()

    def _without_integral(self) -> dict[str, float]:
        k_e, _, kv, k_vr, _, ffa = self.gains
        return {"kp": k_e / kv, "kv": kv, "rate": 0.0, "ffv": k_vr / kv, "ffa": ffa, "weight": 1.0}

    def named(self) -> dict[str, float]:
        """Return the gains by the names that the form of the law gives them, and its shapes [s]."""
        shapes = {name: float(getattr(self, name)) for name in SHAPES}
        return {**(self.pid() if self.form == "pid" else self.cascade()), **shapes}

    def combined(self) -> dict[str, float]:
        """Return what is determined where single gains are not: ``kp + rate``, ``kp * rate``, of a PID ``kd + ffv``."""
        if self.form == "pid":
            return {"kd + ffv": self.gains[3]}
        found = self.cascade()
        if found["rate"] <= 0.0:
            return {}
        return {"kp + rate": found["kp"] + found["rate"], "kp * rate": found["kp"] * found["rate"]}

    def following(self) -> float:
        """Return 1/Kv [s]: following error over command velocity, at constant velocity."""
        k_e, k_i, k_v, k_vr, k_w, _ = self.gains
        error, size = (-k_w, k_i) if k_i != 0.0 else (k_v - k_vr, k_e)
        return error / size if size != 0.0 else math.inf

    def service(self) -> dict[str, tuple[float, float, float]]:
        """Return the numbers a drive is set up with [SI]: value and ends of the 90 % interval (NaN: not known).

        Kv [1/s] is the command's velocity over the following error, infinite where none is certain.
        """
        named, unknown = self.named(), (math.nan, math.nan)
        late, ends = self.following(), self.intervals()
        half = TWO_SIDED * self.errors.get(FOLLOWING, math.nan)
        out = {FOLLOWING: (late, late - half, late + half)}
        value, low, high = _inverse(*out[FOLLOWING])
        out["Kv"] = (math.inf if abs(late) <= half else value, low, high)
        if named.get("rate", 0.0) > 0.0:
            out["reset time"] = _inverse(named["rate"], *ends.get("rate", unknown))
        if self.lost is not None:
            half = TWO_SIDED * self.errors.get(LOST, math.nan)
            out[LOST] = (self.lost, self.lost - half, self.lost + half)
        told = {"kv": "kd", "ffa": "ffa"} if self.form == "pid" else {k: k for k in ("kv", "ffv", "ffa")}
        return out | {name: (named[k], *ends.get(k, unknown)) for name, k in told.items()}

    @property
    def tied(self) -> bool:
        """Whether the log leaves open which of two roots is kp and which is 1/ti."""
        return self.form != "pid" and bool(self.other)

    def intervals(self) -> dict[str, tuple[float, float]]:
        """Return 90 % intervals of :meth:`named` and :meth:`combined`; where kp and 1/ti are tied, both ways round."""
        told, out, ends = {**self.named(), **self.combined()}, {}, list[dict[str, float]]()
        if DISTANCE in self.errors:  # the cascades with the lowest and the highest 1/ti of this feedback
            roots, error = Roots.of(self.gains, self.velocity_lag), TWO_SIDED * self.errors[DISTANCE]
            rates = roots.rates(self.cascade()["rate"], error, tied=self.tied)
            ends = [f for f in map(self.with_rate, rates) if f is not None]
        for name, error in self.errors.items():
            if name not in told:
                continue
            values = [told[name], *([self.other[name]] if name in self.other else [])]
            far = [*values, *(end[name] for end in ends if name in end)]
            low, high, own = min(values), max(values), TWO_SIDED * error
            out[name] = low - math.hypot(low - min(far), own), high + math.hypot(max(far) - high, own)
        return out

    def determined(self) -> dict[str, bool]:
        """Return which gains and combinations the log determines: to :data:`NARROW` of itself, a feed-forward of 1."""
        told, out = {**self.named(), **self.combined()}, {}
        for name, (low, high) in self.intervals().items():
            if name not in SHAPES:
                size = max(abs(told[name]), 1.0 if name == "ffv" and self.form != "pid" else 0.0)
                out[name] = max(told[name] - low, high - told[name]) <= NARROW * size
        return out

    def pid(self) -> dict[str, float]:
        """Return kp, ki, kd, ffv and ffa of a PID."""
        k_e, k_i, k_v, k_vr, _, ffa = self.gains
        return {"kp": k_e, "ki": k_i, "kd": k_v, "ffv": k_vr - k_v, "ffa": ffa}

    def scaled(self, **factors: float) -> Self:
        """Return the controller with some numbers multiplied: ``scaled(kp=0.7)``.

        Args:
            factors: on what :meth:`named` names (kp, kv, rate, ffv, velocity_lag, ...), on gains of :data:`GAINS`,
                or ``all`` for the feedback gains.

        Raises:
            InputError: a name that this controller does not have, or a factor that is no number.
        """
        named = self.named()
        for name, factor in factors.items():
            require(name, (*named, *GAINS, "all"), "controller: no gain", InputError)
            if not isinstance(factor, int | float | np.number) or not math.isfinite(factor):
                raise InputError(
                    f"controller: {name}={factor!r} is no number; give a factor, 1.2 for 20 % more"
                )
        new = {name: x * factors.get(name, 1.0) for name, x in named.items()}
        velocity_lag, output_lag, dead = (new.pop(name) for name in SHAPES)
        old = {name: x for name, x in named.items() if name not in SHAPES}
        moved = zip(self.gains, self._law(new, velocity_lag), self._law(old), strict=True)
        every = {"e": "all", "integral": "all", "v": "all"}
        gains = [
            (g + (now - before)) * factors.get(name, 1.0) * factors.get(every.get(name, ""), 1.0)
            for name, (g, now, before) in zip(GAINS, moved, strict=True)
        ]
        lags = replace(self, velocity_lag=velocity_lag, output_lag=output_lag, dead=dead)
        return replace(lags, gains=tuple(gains))

    def _law(self, named: Mapping[str, float], lag: float | None = None) -> tuple[float, ...]:
        """Return the six gains that this form has with such named ones; without feed-forward no weight matters."""
        if self.form == "pid":
            ahead = named["kd"] + named["ffv"]
            return named["kp"], named["ki"], named["kd"], ahead, self.gains[4], named["ffa"]
        weight = named["weight"] if math.isfinite(named["weight"]) else 0.0
        seen = self.velocity_lag if lag is None else lag
        return Servo.of_cascade(**{**named, "weight": weight}, velocity_lag=seen).gains

    def to_control(self, input: str | None = None, output: str = "u") -> control.StateSpace:
        """Return the law as a python-control system with named signals, before the dead time.

        Args:
            input: one of e, v, vr, ar (SI); all four where absent.
            output: u, the effort [N or N·m].

        Raises:
            InputError: a name that the law does not have.
        """
        import control

        for name, known in ((input, INPUTS), (output, ("u",))):
            if name is not None and name not in known:
                raise InputError(f"controller: no signal {name!r}: inputs {', '.join(INPUTS)}, output u")
        inputs = INPUTS if input is None else (input,)
        A, B, C, D = self.matrices()
        at = [INPUTS.index(name) for name in inputs]
        return control.StateSpace(A, B[:, at], C, D[:, at], inputs=list(inputs), outputs=[output])

    def matrices(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Return A, B, C, D from e, v, vr, ar to u before the dead time; states: integral, velocity, current, notch."""
        k_e, k_i, k_v, k_vr, k_w, k_ar = self.gains
        A, B = np.zeros((5, 5)), np.zeros((5, 4))
        B[0] = [k_i, 0.0, k_w, 0.0]
        keep = [0] if k_i != 0.0 or k_w != 0.0 else []
        state, through = np.zeros(5), np.array([k_e, 0.0, k_vr, k_ar])
        state[0] = 1.0
        if self.velocity_lag > 0.0:
            keep.append(1)
            A[1, 1], B[1, 1] = -1.0 / self.velocity_lag, 1.0 / self.velocity_lag
            state[1] = -k_v
        else:
            through[1] = -k_v
        if self.output_lag > 0.0:
            keep.append(2)
            A[2], B[2] = state / self.output_lag, through / self.output_lag
            A[2, 2] -= 1.0 / self.output_lag
            state, through = np.eye(5)[2], np.zeros(4)
        if self.notch[0] > 0.0:
            keep += [3, 4]
            w, zeros, poles = 2.0 * np.pi * self.notch[0], self.notch[1], self.notch[2]
            # N = 1 + 2 (z1 - z2) w s / (s² + 2 z2 w s + w²), in controller form
            A[3, 4], A[4, 3], A[4, 4] = 1.0, -(w**2), -2.0 * poles * w
            A[4], B[4] = A[4] + state, through
            state = state.copy()
            state[4] += 2.0 * (zeros - poles) * w
        return A[np.ix_(keep, keep)], B[keep], state[None, keep], through[None]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        values = asdict(self)
        values |= {name: _finite(values[name]) for name in ("errors", "other")}
        values |= {"named": _finite(self.named()), "combined": _finite(self.combined())}
        values["intervals"] = {
            k: list(ends) for k, ends in self.intervals().items() if np.isfinite(ends).all()
        }
        values["determined"] = self.determined()
        values["service"] = {
            name: {"value": x, "interval90": list(ends)} for name, (x, *ends) in self.service().items()
        }
        return plain(values)  # type: ignore[no-any-return]

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Return the controller that :meth:`to_dict` wrote."""
        return msgspec.convert({name: x for name, x in values.items() if x is not None}, cls)


def _inverse(x: float, low: float, high: float) -> tuple[float, float, float]:
    """Return 1/x and its interval, which has no end where that of x holds zero."""
    value = 1.0 / x if x != 0.0 else math.inf
    if low <= 0.0 <= high:
        return (value, 1.0 / high, math.inf) if x >= 0.0 else (value, -math.inf, 1.0 / low)
    return value, 1.0 / high, 1.0 / low


def _finite(values: Mapping[str, float]) -> dict[str, float]:
    """Return what is a number: without feed-forward of the velocity a set-point weight is none."""
    return {name: x for name, x in values.items() if math.isfinite(x)}
