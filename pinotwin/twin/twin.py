"""What was found: a machine with numbers, which predicts and which can judge itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.dynamics.parameters import as_log
from pinotwin.effects.scene import moves
from pinotwin.errors import DataError, InputError
from pinotwin.logs.files import LogLike
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine, as_machine
from pinotwin.motion import Motion
from pinotwin.notebook import Drawn, Shown
from pinotwin.system.writing import as_path, whole_folder
from pinotwin.twin.misfit import FILE, Misfit
from pinotwin.twin.moments import Moments
from pinotwin.twin.open_loop import OpenLoop

if TYPE_CHECKING:
    from pinotwin.loop import LoopModel, Servo
    from pinotwin.simulation.prediction import Prediction


@dataclass(frozen=True, eq=False, repr=False)
class Twin(OpenLoop, Drawn):
    """An identified machine: its plant (see :class:`OpenLoop`), its closed loops, and how good they are.

    Attributes:
        loops: closed loop of each axis that has one (black box).
        servos: controller of each axis whose command was logged.
        quality: how good the fit is: errors per axis, whiteness, condition, held-out errors.
        data: fingerprints of the logs that were used.
        settings: how they were prepared.
        groups: parameters that these data cannot distinguish.
        misfit: what it leaves of its own logs when it does not know them; None for a twin without logs.
        moments: of the rows that were fitted, for :func:`pinotwin.update`; None of an older twin.
    """

    loops: Mapping[str, LoopModel] = field(default_factory=dict)
    servos: Mapping[str, Servo] = field(default_factory=dict)
    quality: Mapping[str, Any] = field(default_factory=dict)
    data: Sequence[Mapping[str, Any]] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    groups: Sequence[Sequence[str]] = ()
    misfit: Misfit | None = None
    moments: Moments | None = None

    @classmethod
    def of(cls, plant: OpenLoop, **rest: Any) -> Twin:
        """Return the twin of a plant; the rest are the twin's own attributes."""
        return cls(**{f.name: getattr(plant, f.name) for f in fields(OpenLoop)}, **rest)

    def motion(self, log: LogLike) -> Motion:
        """Return a log of this machine prepared as the ones the twin was identified from."""
        return prepare(self.machine, log, **self.settings)

    def effort(
        self,
        motion: Motion | LogLike | Floats,
        v: Floats | None = None,
        a: Floats | None = None,
        *,
        t: Floats | None = None,
    ) -> Floats:
        """Return the motor effort that a motion takes, shape (n, nv) [N or N·m]; columns as ``machine.names``.

        Of a log, or of a motion made of one, it is what compares with the measured effort, row by row of
        ``twin.motion(log)``: that is low-passed at the log's corner, and so are effects that change faster than the
        motion, such as dry friction where it reverses. Of arrays nothing is filtered: see :meth:`predict`.

        Args:
            motion: a motion, a log or its file; or positions.
            v: velocities, of arrays only; see :meth:`predict`.
            a: accelerations, likewise.
            t: times, likewise.

        Raises:
            DataError: arrays do not fit, or an effect needs ``t``.
            LogError: a channel of the log is missing or unusable.
        """
        if v is not None and a is not None:
            return self.predict(motion, v, a, t=t)
        if isinstance(motion, np.ndarray) or v is not None or a is not None:
            raise InputError("effort: positions alone are no motion; give effort(q, v, a), a Motion or a log")
        return super().effort(motion if isinstance(motion, Motion) else self.motion(motion))

    def predict(self, q: Any, v: Any, a: Any, *, t: Any = None) -> Floats:
        """Return the motor effort for positions, velocities and accelerations: the inverse model, nothing filtered.

        Rows are samples of one motion in order, for dry friction remembers the direction; the first is taken to have
        gone on as it is. What a sensor or the controller adds to a log is left out, as in an exported model.

        Args:
            q: positions of the joints [m or rad], shape (n, nv) in the order of ``machine.names``, or (nv,) for one
                sample.
            v: velocities [m/s or rad/s], likewise.
            a: accelerations [m/s² or rad/s²], likewise.
            t: times [s], shape (n,); only effects of time and of flexible drives need them.

        Returns:
            Effort [N or N·m], of the shape of ``q``.

        Raises:
            DataError: the shapes do not fit, or an effect needs ``t``.
        """
        given = np.asarray(q, dtype=float)
        rows = as_log(self.machine.model, **{k: np.atleast_2d(x) for k, x in (("q", q), ("v", v), ("a", a))})
        clock = np.full(len(rows[0]), np.nan) if t is None else np.atleast_1d(np.asarray(t, dtype=float))
        if clock.shape != (len(rows[0]),):
            raise DataError(
                f"t has shape {clock.shape}, expected ({len(rows[0])},): a time for each row of q"
            )
        motion = Motion.exact((self.machine.names, self.machine.rotary), clock, *rows, source="arrays")
        acting = [x for x in zip(self.keys, self.effects, self.slices, strict=True) if moves(x[1])]
        timed = [key for key, effect, _ in acting if t is None and effect.family.acts == "states"]
        parts = {}
        if not timed:
            scene = self.scene(motion)
            parts = {key: e.along(scene, self.theta[s]) for key, e, s in acting}
            timed = [
                key for key, x in parts.items() if t is None and np.isnan(x).any() and np.isfinite(rows).all()
            ]
        if timed:
            raise DataError(
                f"{self.machine.name}: {', '.join(timed)} depends on time; give t=, shape (n,) [s]"
            )
        return sum(parts.values(), np.zeros_like(rows[0])).reshape(given.shape)

    def residual(self, log: LogLike | Motion) -> Floats:
        """Return measured minus predicted effort, ``u - effort``, shape (n, nv) [N or N·m].

        Rows are those of ``twin.motion(log)``; NaN where no effort is measured.
        """
        motion = log if isinstance(log, Motion) else self.motion(log)
        return np.asarray(motion.u - super().effort(motion))

    def simulate(self, log: LogLike, **options: Any) -> Prediction:
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

    def to_dict(self) -> dict[str, Any]:
        """Return the content of twin.json, without the digests of its files."""
        from pinotwin.twin.files import document

        return document(self)

    def save(self, folder: str | Path) -> Path:
        """Write ``twin.json``, ``machine.yaml``, ``<name>.urdf`` and two files of arrays into a folder."""
        from pinotwin.twin.files import write_twin

        with whole_folder(target := as_path(folder, "folder"), replaces=(FILE,)) as part:
            write_twin(self, part)
        return target

    @classmethod
    def load(cls, folder: str | Path) -> Twin:
        """Read a twin from its folder.

        Raises:
            TwinError: the folder holds no twin, or one of another schema.
        """
        from pinotwin.twin.files import load

        return load(as_path(folder, "folder"))


TwinLike = Twin | str | Path  # A twin, or the folder that `pinotwin identify` wrote


def as_twin(given: Any) -> Twin:
    """Return a twin as it is, or load its folder."""
    if isinstance(given, Twin):
        return given
    if isinstance(given, str | Path):
        return Twin.load(given)
    raise InputError(f"twin: expected a Twin or its folder, not {type(given).__name__}")


def as_subject(given: Any) -> Machine | Twin:
    """Return a machine or twin as it is, or load what a folder holds: a twin, else a machine."""
    if isinstance(given, Twin):
        return given
    if isinstance(given, str | Path):
        path = Path(given)
        if path.name == "twin.json" or (path / "twin.json").is_file():
            return Twin.load(path)
    return as_machine(given, "subject")
