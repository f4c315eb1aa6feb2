"""What a simulation returns: a log of the predicted channels that knows its twin and the command."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinotwin.log import Log
from pinotwin.logs.write import write_log
from pinotwin.notebook import Drawn
from pinotwin.simulation.score import compare
from pinotwin.system.writing import as_path

if TYPE_CHECKING:
    from pinotwin.twin import Twin


@dataclass(frozen=True, repr=False, kw_only=True)
class Prediction(Log, Drawn):
    """A predicted log, see :func:`pinotwin.simulate`."""

    twin: Twin  # the machine that was simulated
    command: Log  # the log whose command it followed, in the names of the contract
    controller: str  # form of the closed loop

    @property
    def errors(self) -> dict[str, dict[str, dict[str, float]]]:
        """Axis -> signal -> error beside what was measured, see :func:`pinotwin.simulation.compare`."""
        return compare(self.twin.machine, self.command, self)

    def to_dict(self) -> dict[str, Any]:
        """Return what ``pinotwin simulate --json`` writes."""
        return {
            "machine": self.twin.machine.name,
            "log": self.command.source,
            "controller": self.controller,
            "rows": len(self),
            "seconds": float(self.t[-1] - self.t[0]),
            "axes": self.errors,
            "notes": list(self.notes),
        }

    def save(self, path: str | Path) -> Path:
        """Write the prediction (.csv or .parquet, SI) and return its path."""
        return write_log(as_path(path, "path"), self.channels)
