"""A machine to look at, alone, playing a log or in one of its modes: the work of ``pinotwin view``."""

from __future__ import annotations

import html as markup
import re
import tempfile
import webbrowser
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from pinotwin.analysis.modal import Modes, animate
from pinotwin.arrays import Floats
from pinotwin.errors import InputError, nearest, require
from pinotwin.log import Log
from pinotwin.logs.files import read_argument
from pinotwin.logs.prepare import prepare
from pinotwin.machine import Machine
from pinotwin.system.writing import write_text
from pinotwin.twin import Twin
from pinotwin.twin.twin import as_subject
from pinotwin.units import SI_FACTOR
from pinotwin.viewer.panel import panel
from pinotwin.viewer.scene import draw, missing_meshes, visual_model
from pinotwin.viewer.tracks import Tracks, tracks_of

Subject: TypeAlias = Machine | Twin | pin.Model | str | Path
HINT = "move the axes; drag to turn, wheel to zoom"


@dataclass(frozen=True)
class View:
    """A page that shows a machine: by :meth:`show`, by :meth:`save`, and in a notebook by itself."""

    name: str  # the machine's
    page: str  # HTML that holds everything it needs
    posture: Mapping[str, float]  # axis or passive joint -> where it stands at first [m or rad]
    notes: tuple[str, ...] = ()  # what is not as one might expect, one line each

    def save(self, path: str | Path) -> Path:
        """Write the page, which opens without network; return its path; InputError where it cannot be written."""
        write_text(path, self.page)
        return Path(path)

    def show(self) -> Path:
        """Open the page in the browser, from a temporary file; return the file's path."""
        path = self.save(Path(tempfile.mkdtemp(prefix="pinotwin-view-")) / f"{self.name}.html")
        webbrowser.open(path.as_uri())
        return path

    def _repr_html_(self) -> str:
        page = markup.escape(self.page, quote=True)
        return f'<iframe srcdoc="{page}" style="width:100%;height:620px;border:0"></iframe>'


def view(
    subject: Subject,
    log: Log | str | Path | None = None,
    *,
    html: str | Path | None = None,
    posture: str | Mapping[str, float] | None = None,
    overlay: Subject | None = None,
    mode: tuple[Modes, int] | None = None,
    frames: bool = True,
) -> View:
    """Draw a machine, from its meshes where they are found.

    Args:
        subject: machine, twin, ``pin.Model``, or the name of a folder, URDF or bundled machine.
        log: what it plays, with the effort; of a twin also the model's effort and the residual.
        html: file to which the page is written.
        posture: axis -> position [m or rad], or a text such as ``"Y=0.1,A=30deg"``; axes that are not
            named stand at zero, or at the limit next to it.
        overlay: a second one, drawn through the first.
        mode: modes of :func:`pinotwin.analysis.modal.modes`, and which of them, 1 the slowest.
        frames: draw joint frames and centres of mass.

    Raises:
        InputError: a log, a machine or a posture is not understood; the message says which.
    """
    machine, twin = _subject(subject)
    named = posture_of(machine, posture)
    q = machine.posture(named)
    visual = visual_model(machine.model, machine.urdf, machine.meshes)
    drawn = draw(machine.model, visual, q, frames=frames, masses=frames, name=machine.name)
    tracks, subtitle = None, HINT
    if mode is not None:
        tracks, subtitle = _vibrating(*mode)
    elif log is not None:
        tracks, subtitle = _playing(machine, twin, log)
    notes = [missing_meshes(machine.urdf, machine.meshes), *([] if tracks else _off(machine, q, named))]
    notes = [note for note in notes if note]
    other = None if overlay is None else _subject(overlay)[0]
    told = ". ".join([subtitle, *notes])
    page = panel(drawn, machine, tracks=tracks, overlay=other, subtitle=told)
    found = View(machine.name, page, dict(zip(machine.names, q.tolist(), strict=True)), tuple(notes))
    if html is not None:
        found.save(html)
    return found


def _subject(subject: Subject) -> tuple[Machine, Twin | None]:
    """Return the machine, and the twin where there is one."""
    found = as_subject(subject)
    return (found.machine, found) if isinstance(found, Twin) else (found, None)


def posture_of(machine: Machine, posture: str | Mapping[str, float] | None) -> Mapping[str, float]:
    """Return axis -> position [m or rad], also of a text; see :func:`view`."""
    if isinstance(posture, str):
        return parse_posture(posture, dict(zip(machine.names, machine.rotary, strict=True)))
    return posture or {}


def _off(machine: Machine, q: Floats, named: Mapping[str, float]) -> list[str]:
    """Return what is said of axes that stand outside their limits, or at one because zero lies outside."""
    model = machine.model
    outside = (q < model.lowerPositionLimit) | (q > model.upperPositionLimit)
    moved = [name not in named for name in machine.names] & (q != 0.0)
    texts = (
        (outside, "Outside the limits of the URDF: {}"),
        (moved, "Zero lies outside the limits of {}: drawn at the limit next to it"),
    )
    names = np.array(machine.names)
    return [text.format(", ".join(names[found])) for found, text in texts if found.any()]


def _playing(machine: Machine, twin: Twin | None, log: Log | str | Path) -> tuple[Tracks, str]:
    """Return the playback of a log, with the model's effort where there is a twin."""
    subtitle = "playing a log" if isinstance(log, Log) else f"playing {Path(log).name}"
    log = log if isinstance(log, Log) else read_argument(str(log))
    motion = prepare(machine, log, decimate=1) if twin is None else twin.motion(log)
    return tracks_of(machine, motion, twin), subtitle


def _vibrating(found: Modes, number: int) -> tuple[Tracks, str]:
    """Return a mode as a playback, enlarged so that it can be seen."""
    t, q = animate(found, number, 0.1)
    mode = found.modes[number - 1]
    said = f"mode {number}: {mode.frequency:.1f} Hz, damping {mode.damping:.3f}, enlarged and slowed"
    return Tracks(t, q), said


_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_LENGTHS = ("m", "mm", "um", "µm", "nm", "inch", "in")
_ANGLES = ("rad", "mrad", "urad", "deg", "°", "mdeg", "arcmin", "arcsec", "rev", "turn")


def parse_posture(text: str, rotary: Mapping[str, bool]) -> dict[str, float]:
    """Return the posture that a text like ``Y=0.1,A=30deg`` means, in m and rad; a bare number is SI.

    ``rotary`` says of every axis whether it turns; InputError for an axis, a number or a unit not understood.
    """
    posture: dict[str, float] = {}
    for item in filter(None, (part.strip() for part in text.split(","))):
        axis, equals, value = (word.strip() for word in item.partition("="))
        if not equals:
            raise InputError(f"posture: expected axis=value, found {item!r}, e.g. Y=0.1,A=30deg")
        require(axis, rotary, "posture: no axis", InputError)
        if axis in posture:
            raise InputError(f"posture: axis {axis!r} is given twice")
        posture[axis] = _position(axis, value, rotary[axis])
    return posture


def _position(axis: str, value: str, turns: bool) -> float:
    """Return the position [m or rad] that the text of one value means."""
    found = _NUMBER.match(value)
    if found is None:
        raise InputError(f"posture: {value!r} of axis {axis!r} is not a number")
    unit = value[found.end() :].strip() or ("rad" if turns else "m")
    known = _ANGLES if turns else _LENGTHS
    if unit not in known:
        moves = "turns" if turns else "slides"
        hint = nearest(unit, known)
        raise InputError(f"posture: unit {unit!r} does not fit axis {axis!r}, which {moves}; {hint}")
    return float(found[0]) * SI_FACTOR[unit]
