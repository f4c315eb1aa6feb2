"""A log of a machine made ready once, for every question that is asked of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from pinotwin.columns import bind
from pinotwin.errors import InputError
from pinotwin.log import Log
from pinotwin.logs.channels import finite
from pinotwin.logs.effort_alone import Examined, command_findings
from pinotwin.logs.plausible import examined, unit_findings
from pinotwin.logs.prepare import prepare, without
from pinotwin.logs.quality import Limits, Quality, inspect
from pinotwin.logs.quality.results import Finding, finding
from pinotwin.logs.settings import USUAL, Settings
from pinotwin.machine import Machine
from pinotwin.motion import Motion


@dataclass(frozen=True, eq=False)
class Prepared:
    """A log, its motion and what ``check`` finds in it; each is made when it is first asked for, and kept."""

    machine: Machine  # whose log it is
    log: Log  # as given, raw or in the names of the contract; then in these, and in SI
    # of :func:`pinotwin.prepare`, such as a twin's own; what is not given comes from machine.yaml
    options: Mapping[str, Any] = field(default_factory=dict)
    settings: Settings = USUAL  # what is decided by

    def __post_init__(self) -> None:
        object.__setattr__(self, "log", bind(self.log, self.machine.columns))

    @cached_property
    def motion(self) -> Motion:
        """The log ready for identification and prediction, see :func:`pinotwin.prepare`."""
        return prepare(self.machine, self.log, **self.options, settings=self.settings)

    @cached_property
    def quality(self) -> Quality:
        """What the channels are worth, before anything is fitted."""
        rotary = {name: axis.rotary for name, axis in self.machine.axes.items()}
        kept = without(self.log, self.machine.data.leave_out)
        return inspect(finite(kept), rotary, _limits(self.machine), self.settings)

    @cached_property
    def efforts(self) -> Examined | None:
        """What the efforts of the axes are worth; None where no axis has motion and effort."""
        return examined(self.machine, self.motion, self.log, self.settings)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What is wrong with the channels, the efforts and their units."""
        found = self.quality.findings
        if not self.quality.ok:
            return tuple(found)
        try:
            efforts, commands = self.efforts, tuple(command_findings(self.motion, self.settings))
        except InputError as error:
            return (*found, finding("unusable", why=str(error)))
        return (*found, *commands, *(efforts.findings if efforts else ()), *unit_findings(self.log))

    @property
    def doubts(self) -> tuple[Finding, ...]:
        """The errors and warnings among the findings."""
        return tuple(f for f in self.findings if f.severity != "info")


def _limits(machine: Machine) -> dict[str, Limits]:
    model, plain = machine.model, machine.transmission is None
    out = {}
    for name, axis in machine.axes.items():
        i = axis.index
        low, high = float(model.lowerPositionLimit[i]), float(model.upperPositionLimit[i])
        speed = float(model.upperVelocityLimit[i])
        # A transmission scales and mixes what is logged: a joint's limits do not fit its motor.
        out[name] = Limits(
            position=(low, high) if plain and high - low < 1e8 else None,
            velocity=speed if plain and 0 < speed < 1e8 else None,
            effort=axis.effort_limit if plain and np.isfinite(axis.effort_limit) else None,
            lead=axis.lead or 0.0,
        )
    return out
