"""A servo controller with its gains named, and the closed loop that it makes with a rigid plant.

    P-PI   u = kv (w + (1/ti) ∫ w dt) + ffa ar,        w = kp e + ffv vr - v        (cascade)
    PID    u = kp e + ki ∫ e dt + kd e' + ffv vr + ffa ar

v is seen ``velocity_delay`` late; it (and e') pass a first-order low-pass of time constant
``filter_time``; all of u comes ``delay`` late.
In the cascade ffv is a number (1 = full feed-forward) and kv carries the unit of a damping; in the
PID ffv does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import InputError, nearest

if TYPE_CHECKING:
    import control

Kind = Literal["p_pi", "pid"]
STATES = ("filter", "integral", "delay1", "delay2")
INPUTS = ("e", "v", "vr", "ar")


@dataclass(frozen=True)
class Controller:
    """Gains of one axis' controller; SI with the effort in N or N·m.

    Attributes:
        kind: ``"p_pi"`` or ``"pid"``.
        kp: position gain: [1/s] in the cascade, [N/m] in the PID.
        kv: velocity gain [N·s/m], cascade only.
        integral: 1/ti [1/s] in the cascade, ki [N/(m·s)] in the PID.
        kd: [N·s/m], PID only.
        ffv: velocity feed-forward: [-] in the cascade, [N·s/m] in the PID.
        ffa: acceleration feed-forward [N·s²/m].
        delay: of the whole law [s].
        velocity_delay: further delay of the velocity [s], that of its own differences included.
        filter_time: time constant of the low-pass on velocity [s].
        step: sampling interval [s].
        offset: constant part of the effort, mean over the segments [N].
        errors: standard errors by name of what was identified; a shape that was not needed, or a
            delay of whole samples, is taken as known and has none.
        r2: share of the effort's variance that the law explains.
        rms: of what it does not explain [N].
        notes: what deserves attention.
    """

    kind: Kind
    kp: float
    kv: float = 0.0
    integral: float = 0.0
    kd: float = 0.0
    ffv: float = 0.0
    ffa: float = 0.0
    delay: float = 0.0
    velocity_delay: float = 0.0
    filter_time: float = 0.0
    step: float = 0.001
    offset: float = 0.0
    errors: Mapping[str, float] = field(default_factory=dict)
    r2: float | None = None
    rms: float | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in ("p_pi", "pid"):
            raise InputError(f"controller: kind {self.kind!r}; {nearest(self.kind, ('p_pi', 'pid'))}")

    @property
    def ti(self) -> float:
        """Integral time [s]; infinite without integral action."""
        rate = self.integral if self.kind == "p_pi" else self.integral / self.kp
        return 1.0 / rate if rate else np.inf

    def scaled(self, **factors: float) -> Self:
        """Return the controller with some gains multiplied, e.g. ``scaled(kv=1.2)``."""
        for name in factors:
            if name not in ("kp", "kv", "integral", "kd", "ffv", "ffa", "delay"):
                raise InputError(f"controller: no gain {name!r}; {nearest(name, asdict(self))}")
        return replace(self, **{k: f * getattr(self, k) for k, f in factors.items()})

    def matrices(self, delay: float | None = None) -> tuple[Floats, Floats, Floats, Floats]:
        """Return A, B, C, D with inputs e, v, vr, ar and output u.

        The delay is a Padé approximation of second order.
        States: filtered velocity (of the error in a PID), integral, two of the delay; those that
            are
        not needed are left out.
        """
        late = self.delay if delay is None else delay
        A, B, r, s = self._law()
        u, through = r, s
        if late > 0.0:
            # 1/(1 + sT/2 + (sT)²/12) applied to (1 - sT/2 + (sT)²/12): 1 minus sT over the same.
            a1, a0 = 6.0 / late, 12.0 / late**2
            A[2, 3], A[3, 2], A[3, 3] = 1.0, -a0, -a1
            A[3], B[3] = A[3] + r, B[3] + s
            u = r.copy()
            u[3] -= 2.0 * a1
        keep = self._kept(late)
        return A[np.ix_(keep, keep)], B[keep], u[None, keep], through[None]

    @property
    def seen_late(self) -> float:
        """Filter and delay of the velocity, as the one time constant of the matrices [s].

        The sampled filter y[k] = a y[k-1] + (1 - a) v[k], a = exp(-step / filter_time), is late by
        a / (1 - a) samples, half a sample less than its time constant.
        """
        if self.filter_time <= 0.0:
            return self.velocity_delay
        return self.velocity_delay + self.step / math.expm1(self.step / self.filter_time)

    def _law(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the undelayed law: A, B of filter and integral, and the rows of u."""
        lag = self.seen_late
        A, B = np.zeros((4, 4)), np.zeros((4, 4))
        state, drive = np.eye(4), np.eye(4)  # rows of [filter, integral, ...] and of [e, v, vr, ar]
        nothing = np.zeros(4)
        cascade = self.kind == "p_pi"
        raw = drive[1] if cascade else drive[2] - drive[1]
        seen_x, seen_u = nothing, raw
        if lag > 0.0:
            A[0, 0], B[0] = -1.0 / lag, raw / lag
            seen_x, seen_u = state[0], nothing
        if cascade:
            A[1], B[1] = -seen_x, self.kp * drive[0] + self.ffv * drive[2] - seen_u
            r = self.kv * (A[1] + self.integral * state[1])
            return A, B, r, self.kv * B[1] + self.ffa * drive[3]
        A[1], B[1] = nothing, drive[0]
        r = self.integral * state[1] + self.kd * seen_x
        s = self.kp * drive[0] + self.kd * seen_u + self.ffv * drive[2] + self.ffa * drive[3]
        return A, B, r, s

    def _kept(self, late: float) -> list[int]:
        return (
            ([0] if self.seen_late > 0.0 else [])
            + ([1] if self.integral != 0.0 else [])
            + ([2, 3] if late > 0.0 else [])
        )

    def control(self) -> control.StateSpace:
        """Return the law as a python-control system: inputs e, v, vr, ar; output u."""
        import control

        A, B, C, D = self.matrices()
        return control.StateSpace(A, B, C, D, inputs=list(INPUTS), outputs=["u"])

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {**asdict(self), "errors": dict(self.errors), "notes": list(self.notes)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Return the controller that :meth:`to_dict` wrote."""
        return cls(**{**values, "notes": tuple(values.get("notes", ()))})
