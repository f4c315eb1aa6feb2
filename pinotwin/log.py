"""What was recorded: named channels of equal length on one clock, frozen.

A log as read keeps the names and units of its file. ``Log.bound`` (see :mod:`pinotwin.columns`) gives
the channels the names and SI units of the contract: ``t``, ``<axis>.q``, ``<axis>.u``, ``<axis>.qr``...
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.errors import LogError, nearest


@dataclass(frozen=True)
class Log:
    """Named channels on one clock.

    Attributes:
        channels: name -> values, each of shape (n,).
        source: the file (or files) it came from, for messages.
        scalars: single numbers that the file held beside the channels (gains, constants).
        notes: what the reader noticed, one sentence each (nothing is repaired in silence).
    """

    channels: Mapping[str, Floats]
    source: str = "log"
    scalars: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        lengths = {name: len(x) for name, x in self.channels.items()}
        if len(set(lengths.values())) > 1:
            raise LogError(f"{self.source}: channels differ in length: {lengths}")
        frozen = {}
        for name, values in self.channels.items():
            x = np.array(values, dtype=float)
            x.flags.writeable = False
            frozen[str(name)] = x
        object.__setattr__(self, "channels", MappingProxyType(frozen))

    def __getitem__(self, name: str) -> Floats:
        try:
            return self.channels[name]
        except KeyError:
            raise LogError(
                f"{self.source}: no channel {name!r}; {nearest(name, self.channels)}"
            ) from None

    def __contains__(self, name: object) -> bool:
        return name in self.channels

    def __len__(self) -> int:
        return len(next(iter(self.channels.values()), ()))

    @property
    def t(self) -> Floats:
        """Time [s], shape (n,)."""
        return self["t"]
