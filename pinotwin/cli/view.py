"""``pinotwin view twin log.csv --html machine.html``: a machine in the browser, or as one page."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinotwin.cli.arguments import Answer, AnyNumber, File, Folder
from pinotwin.cli.inputs import check_there
from pinotwin.errors import InputError

if TYPE_CHECKING:
    from pinotwin.analysis.modal import Modes
    from pinotwin.machine import Machine
    from pinotwin.twin import Twin
    from pinotwin.viewer import View


def run(
    machine: str,
    log: str | None = None,
    *,
    posture: str | None = None,
    mode: int | None = None,
    free: AnyNumber | None = None,
    servo: bool = False,
    html: File | None = None,
    rrd: File | None = None,
    no_frames: bool = False,
    overlay: str | None = None,
    meshes: str | None = None,
    out: Folder | None = None,
) -> Answer:
    """Draw, and write a page or open the browser.

    Args:
        machine: machine, twin folder, .urdf, or a bundled name
        log: servo log to play back
        posture (Y=0.1,A=30deg): posture; SI unless a unit is given
        mode (N): show mode N, 1 the slowest, enlarged
        free (AXIS): axes that are free, for --mode; all without names
        servo: servo loops closed, for --mode; takes a twin
        html (FILE): write one page that opens without network
        rrd (FILE): write LOG as a recording for the Rerun viewer (.rrd)
        no_frames: leave out joint frames and masses
        overlay (MACHINE|TWIN): draw a second one through the first
        out (PATH): folder for the page, as --html does with a file
    """
    if free is not None and mode is None:
        raise InputError("--free belongs to --mode N; give both")
    if servo and (mode is None or free is not None):
        raise InputError("--servo belongs to --mode N, in place of --free")
    if mode is not None and log:
        raise InputError("--mode shows a vibration, a log its own motion; give one of them")
    if rrd:
        if html or out or mode is not None:
            raise InputError("--rrd cannot be combined with others; leave out --html, --out and --mode")
        return Answer([_recorded(rrd, machine, log, meshes)])
    check_there(*filter(None, [log]))
    subject = _subject(machine, meshes)
    from pinotwin.viewer import view

    second = _subject(overlay, meshes) if overlay else None
    shown = None if mode is None else (_modes(subject, machine, posture, free, servo), mode)
    found = view(subject, log, posture=posture, overlay=second, mode=shown, frames=not no_frames)
    lines = [*(_mode_lines(*shown) if shown else ()), *found.notes]
    pages = [html] if html else []
    pages += [str(Path(out) / f"{found.name}.html")] if out else []
    for page in pages:
        found.save(page)
        lines.append(f"{found.name} written to {page}")
    facts: dict[str, Any] = {"machine": found.name, "posture": found.posture, "log": log, "mode": mode}
    facts |= {"html": next(iter(pages), None), "notes": found.notes}
    return Answer(lines if pages else _served(lines, found), facts)


def _served(lines: Sequence[str], found: View) -> Iterator[str]:
    """Yield lines, then show the page in the browser until Ctrl-C."""
    from pinotwin.viewer.live import serve

    yield from lines
    with serve(found.page) as url:
        yield f"{found.name} at {url}; stop with Ctrl-C"
        try:
            while True:
                time.sleep(1.0)
        except KeyboardInterrupt:
            return


def _recorded(rrd: str, machine: str, log: str | None, meshes: str | None) -> str:
    """Write a log as a recording for Rerun and return what is said of it."""
    from pinotwin.logs.files import read_argument
    from pinotwin.machine import Machine
    from pinotwin.viewer.rerun import check_recording, write_recording

    if log is None:
        raise InputError("--rrd records the motion of a log; give one")
    check_recording(rrd)
    return write_recording(rrd, Machine.load(machine).with_meshes(meshes), read_argument(log))


def _subject(name: str, meshes: str | None) -> Machine | Twin:
    from pinotwin.twin import Twin
    from pinotwin.twin.twin import as_subject

    found = as_subject(name)
    if not isinstance(found, Twin):
        return found.with_meshes(meshes)
    return replace(found, machine=found.machine.with_meshes(meshes))


def _mode_lines(found: Modes, shown: int) -> list[str]:
    lines = []
    for k, mode in enumerate(found.modes, 1):
        parts = zip(found.names, mode.energy, strict=True)
        shares = ", ".join(f"{name} {share:.0%}" for name, share in parts if abs(share) >= 0.005)
        mark = " <" if k == shown else ""
        lines.append(f"mode {k}: {mode.frequency:.2f} Hz, damping {mode.damping:.3f} ({shares}){mark}")
    return lines


def _modes(
    subject: Machine | Twin, name: str, posture: str | None, free: Sequence[str] | None, servo: bool
) -> Modes:
    """Return the modes with motors held, some free, or with their servo loops closed."""
    from pinotwin.analysis.modal import modes, servo_modes
    from pinotwin.twin import Twin
    from pinotwin.twin.twin import as_twin
    from pinotwin.viewer.show import posture_of

    machine = subject.machine if isinstance(subject, Twin) else subject
    values = posture_of(machine, posture)
    if servo:
        return servo_modes(as_twin(subject if isinstance(subject, Twin) else name), values)
    released = [] if free is None else (free or list(machine.axes))
    for name in released:
        machine.axis(name)
    return modes(machine, values, locked=[name for name in machine.axes if name not in released])
