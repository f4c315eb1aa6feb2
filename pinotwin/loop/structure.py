r"""The structure of one closed loop: how many poles of which kind, and the form of each numerator.

All transfer functions of an axis share one characteristic polynomial (thesis Eq. 4.14)

    D(s) = Dfb(s) Dff(s),     Dfb = prod (s + p) prod (s² + 2 zeta wn s + wn²)

Dfb holds the poles of plant and feedback, Dff those that make the feed-forward causal (Table 4-1). The disturbance
never passes the feed-forward: G_ed and G_ud are fractions over Dfb alone ("exact"). Eq. 4.17, 4.18, 5.7 and 5.9 leave
that factor out ("source"), which adds the lag of Dff; the option is kept for comparison. The command enters through
its velocity. A numerator is said by its relative degree, and its gain at frequency zero where that is known:

    =========  ============  ============  ============
    output     own d         further d     velocity of qr
    =========  ============  ============  ============
    e          2, free       2, gain 0     1, free
    u          1, gain 1     1, gain 0     1, free
    v (extra)  2, gain 0     1, gain 0     2, gain 0
    =========  ============  ============  ============

Feed-forward poles: a tuple preassigns them [Hz]; None preassigns both at the sampling frequency (as the source does at
250 Hz); "search" searches one double pole; () puts them at infinity, as in a sampled controller.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

from pinotwin.errors import InputError, nearest, require

Numerators = Literal["exact", "source"]


@dataclass(frozen=True)
class Channel:
    """Form of one transfer function."""

    degree: int  # relative degree
    gain: float | None = None  # gain at frequency zero, None where it is free


@dataclass(frozen=True)
class Section:
    """One first- or second-order part of the characteristic polynomial."""

    name: str  # ``"p1"``, ``"wn1"``, ... ``"pff"``
    order: int  # 1 or 2
    values: tuple[float, ...]  # (p,) [rad/s], or (wn [rad/s], zeta [-])
    feedforward: bool = False  # whether it belongs to Dff
    free: bool = True  # whether its values are searched

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its values; a section of two preassigned poles has one."""
        pair = self.order == 2 and not self.feedforward
        return (self.name, self.name.replace("wn", "zeta")) if pair else (self.name,)


@dataclass(frozen=True)
class Structure:
    """Numbers of poles and form of the numerators; see the module's docstring."""

    real_poles: int = 3  # all real poles, those of the feed-forward included
    pole_pairs: int = 1  # complex pairs (an overdamped pair is two real poles)
    feedforward_poles: tuple[float, ...] | Literal["search"] | None = None  # see the module's docstring [Hz]
    numerators: Numerators = "exact"  # ``"exact"`` or ``"source"`` (disturbance numerators without Dff)

    def __post_init__(self) -> None:
        poles = self.feedforward_poles
        if isinstance(poles, list):
            object.__setattr__(self, "feedforward_poles", tuple(float(f) for f in poles))
        if isinstance(poles, str) and poles != "search":
            raise InputError(f"feedforward_poles: {poles!r}; expected Hz, 'search' or none")
        if not isinstance(poles, str) and poles is not None and any(not f > 0 for f in poles):
            raise InputError(f"feedforward_poles: {poles}; expected positive frequencies [Hz]")
        if self.numerators not in ("exact", "source"):
            raise InputError(f"numerators: {nearest(self.numerators, ('exact', 'source'))}")
        if self.real_poles < 0 or self.pole_pairs < 0 or self.feedback_order < 2:
            raise InputError(
                f"loop structure with {self.real_poles} real poles and {self.pole_pairs} pairs "
                f"leaves order {self.feedback_order} for plant and feedback; at least 2 is needed"
            )

    @property
    def feedforward_count(self) -> int:
        """Number of feed-forward poles."""
        if self.feedforward_poles is None or isinstance(self.feedforward_poles, str):
            return 2
        return len(self.feedforward_poles)

    @property
    def feedback_order(self) -> int:
        """Degree of Dfb."""
        return self.real_poles - self.feedforward_count + 2 * self.pole_pairs

    @property
    def order(self) -> int:
        """Degree of D."""
        return self.real_poles + 2 * self.pole_pairs

    def sections(self, step: float) -> tuple[Section, ...]:
        """Return the sections: real poles, pairs, feed-forward; free values are guesses."""
        real = self.real_poles - self.feedforward_count
        parts = [Section(f"p{i + 1}", 1, (2 * math.pi * 30.0,)) for i in range(real)]
        parts += [Section(f"wn{i + 1}", 2, (2 * math.pi * 10.0, 0.7)) for i in range(self.pole_pairs)]
        return tuple(parts + self._feedforward(step))

    def _feedforward(self, step: float) -> list[Section]:
        if self.feedforward_poles == "search":
            return [Section("pff", 2, (2 * math.pi / step, 1.0), feedforward=True)]
        if self.feedforward_poles is None:
            poles = [2 * math.pi / step] * 2
        else:
            poles = sorted(2 * math.pi * float(f) for f in self.feedforward_poles)
        found = []
        # Two real poles are one second-order section: equal poles need no special case.
        for i, (a, b) in enumerate(zip(poles[::2], poles[1::2], strict=False)):
            root = math.sqrt(a * b)
            pair = (root, (a + b) / (2 * root))
            found.append(Section(f"pff{i + 1}", 2, pair, feedforward=True, free=False))
        if len(poles) % 2:
            single = (poles[-1],)
            found.append(Section("pff0", 1, single, feedforward=True, free=False))
        return found

    def disturbance(self, output: int, disturbance: int) -> Channel:
        """Return the form of the transfer function from a disturbance to an output."""
        extra = self.feedforward_count if self.numerators == "source" else 0
        if disturbance > 0:
            return Channel((2 if output == 0 else 1) + extra, 0.0)
        if output == 0:
            return Channel(2 + extra)
        return Channel(1 + extra, 1.0) if output == 1 else Channel(2 + extra, 0.0)

    def command(self, output: int) -> Channel:
        """Return the form of the transfer function from the command's velocity to an output."""
        if output < 2:
            return Channel(1)
        return Channel(1 if self.direct else 2, 0.0)

    @property
    def direct(self) -> bool:
        """Whether the feed-forward acts without poles."""
        return self.feedforward_count == 0

    def passes(self, output: int) -> tuple[bool, bool]:
        """Return whether velocity and acceleration of the command reach an output directly."""
        return self.direct and output >= 1, self.direct and output == 1

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Return the structure that a twin holds, or that a machine.yaml describes."""
        given = {k: x for k, x in values.items() if k not in ("integrator", "inertia")}  # of former twins
        for key in given:
            require(key, cls.__dataclass_fields__, "loop: unknown key", InputError)
        return cls(**given)
