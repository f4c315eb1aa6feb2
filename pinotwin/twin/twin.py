"""What was found: a machine with numbers, which predicts and which can judge itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinotwin.errors import InputError
from pinotwin.log import Log
from pinotwin.logs.files.given import LogLike
from pinotwin.logs.prepare import prepare
from pinotwin.motion import Motion
from pinotwin.notebook import Card, Shown
from pinotwin.system.writing import as_path
from pinotwin.twin.misfit import Misfit
from pinotwin.twin.open_loop import OpenLoop

if TYPE_CHECKING:
    from pinotwin.loop import LoopModel, Servo


@dataclass(frozen=True, eq=False, repr=False)
class Twin(OpenLoop, Card):
    """An identified machine: its plant (see :class:`OpenLoop`), its closed loops, and how good they are.

    Attributes:
        loops: closed loop of each axis that has one (black box).
        servos: controller of each axis whose command was logged.
        quality: how good the fit is: errors per axis, whiteness, condition, held-out errors.
        data: fingerprints of the logs that were used.
        settings: how they were prepared.
        groups: parameters that these data cannot tell apart.
        misfit: what it leaves of its own logs when it does not know them; None for a twin without logs.
    """

    loops: Mapping[str, LoopModel] = field(default_factory=dict)
    servos: Mapping[str, Servo] = field(default_factory=dict)
    quality: Mapping[str, Any] = field(default_factory=dict)
    data: Sequence[Mapping[str, Any]] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    groups: Sequence[Sequence[str]] = ()
    misfit: Misfit | None = None

    @classmethod
    def of(cls, plant: OpenLoop, **rest: Any) -> Twin:
        """Return the twin of a plant; the rest are the twin's own attributes."""
        return cls(**{f.name: getattr(plant, f.name) for f in fields(OpenLoop)}, **rest)

    def motion(self, log: LogLike) -> Motion:
        """Return a log of this machine prepared as the ones the twin was identified from."""
        return prepare(self.machine, log, **self.settings)

    def simulate(self, log: LogLike, **options: Any) -> Log:
        """Return position, error and effort that the command of a log will produce.

        Nothing measured is used; see :func:`pinotwin.simulation.simulate` for the options.
        """
        from pinotwin.simulation import simulate

        return simulate(self, log, **options)

    def _shown(self) -> Shown:
        """Return title, columns, rows and a note for a notebook and for ``repr``."""
        rows = []
        for name in self.machine.names:
            own = [e.title for e in self.effects if e.axis == name]
            judged = self.quality.get("axes", {}).get(name, {}).get("held_out", {}).get("nrmse")
            error = "" if judged is None else f"{judged:.1%}"
            rows.append((name, ", ".join(own), error, "yes" if name in self.loops else ""))
        columns = ("axis", "effects", "effort error, held out", "closed loop")
        note = f"{len(self.theta)} coefficients from {len(self.data)} log(s)"
        return (f"Twin of {self.machine.name}", columns, rows, note)

    def save(self, folder: str | Path) -> Path:
        """Write ``twin.json``, ``machine.yaml`` and ``<name>.urdf`` into a folder."""
        from pinotwin.twin.files import save

        return save(self, as_path(folder, "folder"))

    @classmethod
    def load(cls, folder: str | Path) -> Twin:
        """Read a twin from its folder.

        Raises:
            TwinError: the folder holds no twin, or one of another schema.
        """
        from pinotwin.twin.files import load

        return load(as_path(folder, "folder"))


TwinLike = Twin | str | Path
"""A twin, or the folder that `pinotwin identify` wrote."""


def as_twin(given: Any, name: str = "twin") -> Twin:
    """Return a twin as it is, or load it.

    Args:
        given: a twin, or its folder.
        name: of the argument, for the message.

    Raises:
        InputError: it is something else.
        TwinError: the folder holds no twin.
    """
    if isinstance(given, Twin):
        return given
    if isinstance(given, str | Path):
        return Twin.load(given)
    raise InputError(f"{name}: expected a Twin or its folder, not {type(given).__name__}")
