"""External effort over time: what a twin cannot account for, with its interval.

``f = twin's effort - measured effort`` [N or N·m] pushes the axis: a process force, contact, a hand. Its 90 % interval
comes from the cross-validated residual of the twin's logs, moving and at rest apart, and the covariance of its
coefficients. A pure force F on a link follows from f = J(q)^T F, weighed by it, in directions that the axes feel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.dynamics.frames import jacobian
from pinotwin.errors import DataError
from pinotwin.logs.files import LogLike, as_log
from pinotwin.logs.write import write_log
from pinotwin.machine import Machine
from pinotwin.system.writing import as_path
from pinotwin.twin.twin import TwinLike, as_twin


@dataclass(frozen=True, eq=False)
class ExternalEffort:
    """External effort of every axis."""

    t: Floats  # time [s], shape (n,)
    names: tuple[str, ...]  # axes
    force: Floats  # external effort, shape (n, axes) [N or N·m]
    half: Floats  # half width of its 90 % interval, shape (n, axes)
    q: Floats  # positions of all joints, shape (n, nv) [m or rad]
    units: tuple[str, ...] = ()  # of each axis' force
    machine: str = ""  # its name
    source: str = ""  # of the log
    link: LinkForce | None = None  # the pure force on a link, if one was named

    def channels(self) -> dict[str, Floats]:
        """Return ``t``, ``<axis>.f`` and, of a link, ``<link>.fx`` to ``.fz``, each with ``_low`` and ``_high``."""
        rows = list(zip([f"{name}.f" for name in self.names], self.force.T, self.half.T, strict=True))
        if (part := self.link) is not None:
            rows += zip([f"{part.link}.f{x}" for x in "xyz"], part.force.T, part.half.T, strict=True)
        out = {"t": self.t}
        for name, f, h in rows:
            out |= {name: f, f"{name}_low": f - h, f"{name}_high": f + h}
        return out

    def save(self, path: str | Path) -> Path:
        """Write :meth:`channels` (.csv or .parquet, SI) and return the path."""
        return write_log(as_path(path, "path"), self.channels())

    def to_dict(self) -> dict[str, Any]:
        """Return what ``pinotwin force --json`` writes."""
        columns = zip(self.names, self.units, self.force.T, self.half.T, self.beyond(), strict=True)
        rows = {
            name: {
                "largest": float(abs(force).max()),
                "half_width90": float(half.mean()),
                "share_beyond": float(beyond),
                "unit": unit,
            }
            for name, unit, force, half, beyond in columns
        }
        out: dict[str, Any] = {"machine": self.machine, "log": self.source, "axes": rows}
        if self.link is not None:
            out["link"] = {self.link.link: dict(zip("xyz", self.link.felt().tolist(), strict=True))}
        return out

    def beyond(self) -> Floats:
        """Return the share of the time in which each axis' interval leaves out zero, shape (axes,)."""
        return np.asarray(np.mean(np.abs(self.force) > self.half, axis=0))


def force(twin: TwinLike, log: LogLike, *, link: str | None = None, z: float = 1.645) -> ExternalEffort:
    """Estimate the external effort on every axis over time, with its interval.

    Args:
        twin: a twin with its validation error, or its folder.
        log: servo log of the same machine, or its file.
        link: also find the pure force on this link.
        z: half width of the interval in standard deviations; 90 % by default.

    Raises:
        LogError: a channel is missing or unusable.
        DataError: the twin does not know its validation error.
        MachineError: there is no such link.
    """
    twin, log = as_twin(twin), as_log(log)
    if twin.misfit is None:
        raise DataError(f"{twin.machine.name}: this twin has no validation error; identify it again")
    motion = twin.motion(log)
    inside = motion.inside
    residual, error = twin.residual(motion)[inside], twin.effort_error(motion)[inside]
    names = [name for name in twin.machine.axes if name in twin.misfit.summary]
    columns = [twin.machine.axes[name].index for name in names]
    own = [twin.misfit.summary[name] for name in names]
    rest = [max(s["moving"], s["rms"] if s["resting"] is None else s["resting"]) for s in own]
    pairs = zip(own, rest, columns, strict=True)
    left = [np.where(motion.use[inside, j], s["moving"], still) for s, still, j in pairs]
    half = z * np.hypot(np.stack(left, axis=1), error[:, columns])
    found = ExternalEffort(
        t=motion.t[inside],
        names=tuple(names),
        force=-residual[:, columns],
        half=half,
        q=motion.q[inside],
        units=tuple("N·m" if twin.machine.axes[name].rotary else "N" for name in names),
        machine=twin.machine.name,
        source=log.source,
    )
    return found if link is None else replace(found, link=link_force(twin.machine, found, link))


@dataclass(frozen=True, eq=False)
class LinkForce:
    """A pure force on a link, in the axes of that link."""

    t: Floats  # time [s], shape (n,)
    link: str  # name of the link (or another frame)
    force: Floats  # at its origin [N], shape (n, 3), NaN along directions that the axes do not feel
    half: Floats  # half width of its 90 % interval, shape (n, 3), likewise

    def felt(self) -> Floats:
        """Return the share of the time in which the force is determined, by direction, shape (3,)."""
        return np.asarray(np.isfinite(self.force).mean(axis=0))


def link_force(machine: Machine, found: ExternalEffort, link: str) -> LinkForce:
    """Return the pure force on a link, at its origin, that explains external efforts, where it is determined.

    Not in directions of which the axes feel less than 99 %, or 30 times less sharply than the best.
    """
    columns = [machine.axis(name).index for name in found.names]
    J = jacobian(machine.model, link, found.q)[:, :3][:, :, columns]
    A = J.transpose(0, 2, 1) / found.half[:, :, None]
    U, S, Vt = np.linalg.svd(A, full_matrices=False)
    strong = (S[:, :1] < 30.0 * S) & (S > 0.0)
    inverse = np.where(strong, 1.0 / np.where(strong, S, 1.0), 0.0)
    y = np.einsum("nij,ni->nj", U, found.force / found.half) * inverse
    force = np.einsum("njk,nj->nk", Vt, y)
    half = np.sqrt(np.einsum("njk,nj->nk", Vt**2, inverse**2))
    known = np.einsum("njk,nj->nk", Vt**2, strong.astype(float)) > 0.99
    return LinkForce(found.t, link, np.where(known, force, np.nan), np.where(known, half, np.nan))
