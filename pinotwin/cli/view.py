"""``pinotwin view MACHINE|TWIN [LOG] [--posture Y=0.1,A=30deg] [--html FILE]``."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinotwin.cli.inputs import add_effects, add_meshes, with_meshes
from pinotwin.cli.output import add_common, say, write_json
from pinotwin.system.writing import whole_folder

if TYPE_CHECKING:
    from pinotwin.analysis.modal import Modes
    from pinotwin.machine import Machine
    from pinotwin.twin import Twin
    from pinotwin.viewer import View


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("machine", help="machine, twin folder, .urdf, or a bundled name")
    parser.add_argument("log", nargs="?", help="servo log to play back")
    parser.add_argument("--posture", metavar="Y=0.1,A=30deg", help="posture; SI unless a unit is given")
    parser.add_argument("--mode", type=int, metavar="N", help="show mode N, 1 the slowest, enlarged")
    parser.add_argument(
        "--free",
        nargs="*",
        metavar="AXIS",
        help="axes that are free, for --mode; all without names",
    )
    parser.add_argument("--servo", action="store_true", help="servo loops closed, for --mode; takes a twin")
    parser.add_argument("--html", metavar="FILE", help="write one page that opens without network")
    parser.add_argument("--rrd", metavar="FILE", help="write LOG as a recording for the Rerun viewer (.rrd)")
    parser.add_argument("--no-frames", action="store_true", help="leave out joint frames and masses")
    parser.add_argument("--overlay", metavar="MACHINE|TWIN", help="draw a second one through the first")
    add_meshes(parser)
    add_effects(parser)
    add_common(parser, out="folder for the page, as --html does with a file")


def run(args: argparse.Namespace) -> int:
    """Draw, and write a page or open the browser."""
    _check(args)
    if args.rrd:
        return _record(args)
    found = _view(args)
    for note in found.notes:
        say(note)
    if args.json:
        write_json(args.json, _facts(found, args))
    if args.html:
        found.save(args.html)
        say(f"{found.name} written to {args.html}")
    if args.out:
        with whole_folder(args.out) as folder:
            found.save(folder / f"{found.name}.html")
        say(f"{found.name} written to {Path(args.out) / found.name}.html")
    return 0 if args.html or args.out else _serve(found)


def _serve(found: View) -> int:
    """Show the page in the browser until Ctrl-C."""
    from pinotwin.viewer.live import serve

    with serve(found.page) as url:
        say(f"{found.name} at {url}; stop with Ctrl-C")
        try:
            while True:
                time.sleep(1.0)
        except KeyboardInterrupt:
            return 0


def _record(args: argparse.Namespace) -> int:
    """Write the log as a recording for Rerun."""
    from pinotwin.logs.files import read_argument
    from pinotwin.machine import Machine
    from pinotwin.viewer.rerun import write_recording

    machine = with_meshes(Machine.load(args.machine), args.meshes)
    say(write_recording(args.rrd, machine, read_argument(args.log)))
    return 0


def _view(args: argparse.Namespace) -> View:
    """Return the view of a machine or twin: at a posture, playing a log, or in one of its modes."""
    from pinotwin.viewer import view

    subject = _subject(args.machine, args.meshes)
    return view(
        subject,
        args.log,
        posture=args.posture,
        overlay=_subject(args.overlay, args.meshes) if args.overlay else None,
        mode=None if args.mode is None else (_modes(subject, args), args.mode),
        frames=not args.no_frames,
    )


def _subject(name: str, meshes: str | None) -> Machine | Twin:
    """Return a machine or twin with its meshes looked for in a folder first."""
    from pinotwin.machine import Machine
    from pinotwin.twin import Twin

    if not (Path(name) / "twin.json").is_file():
        return with_meshes(Machine.load(name), meshes)
    twin = Twin.load(name)
    return replace(twin, machine=with_meshes(twin.machine, meshes))


def _check(args: argparse.Namespace) -> None:
    """Refuse arguments that do not go together."""
    from pinotwin.errors import InputError

    if args.free is not None and args.mode is None:
        raise InputError("--free belongs to --mode N; give both")
    if args.servo and (args.mode is None or args.free is not None):
        raise InputError("--servo belongs to --mode N, in place of --free")
    if args.mode is not None and args.log:
        raise InputError("--mode shows a vibration, a log its own motion; give one of them")
    if args.rrd:
        _check_recording(args)


def _check_recording(args: argparse.Namespace) -> None:
    """Refuse a recording of nothing, under another suffix, or where Rerun is not installed."""
    from pinotwin.errors import InputError
    from pinotwin.viewer.rerun import check_recording

    if args.log is None:
        raise InputError("--rrd records the motion of a log; give one")
    if args.html or args.out or args.mode is not None:
        raise InputError("--rrd is a result of its own; leave out --html, --out and --mode")
    check_recording(args.rrd)


def _facts(found: View, args: argparse.Namespace) -> dict[str, Any]:
    """Return what is shown: posture in SI, and where the page went."""
    return {
        "machine": found.name,
        "posture": found.posture,
        "log": args.log,
        "mode": args.mode,
        "html": args.html or (args.out and str(Path(args.out) / f"{found.name}.html")),
        "notes": found.notes,
    }


def _modes(subject: Machine | Twin, args: argparse.Namespace) -> Modes:
    """Return the modes, and print them."""
    found = _found_modes(subject, args)
    for k, mode in enumerate(found.modes, 1):
        shares = ", ".join(
            f"{name} {share:.0%}"
            for name, share in zip(found.names, mode.energy, strict=True)
            if abs(share) >= 0.005
        )
        mark = " <" if k == args.mode else ""
        say(f"mode {k}: {mode.frequency:.2f} Hz, damping {mode.damping:.3f} ({shares}){mark}")
    return found


def _found_modes(subject: Machine | Twin, args: argparse.Namespace) -> Modes:
    """Return the modes with motors held, some free, or with their servo loops closed."""
    from pinotwin.analysis.modal import modes, servo_modes
    from pinotwin.twin import Twin
    from pinotwin.viewer import parse_posture

    machine = subject.machine if isinstance(subject, Twin) else subject
    rotary = dict(zip(machine.names, machine.rotary, strict=True))
    values = parse_posture(args.posture, rotary) if args.posture else {}
    if args.servo:
        return servo_modes(subject if isinstance(subject, Twin) else Twin.load(args.machine), values)
    released = [] if args.free is None else (args.free or list(machine.axes))
    for name in released:
        machine.axis(name)
    locked = [name for name in machine.axes if name not in released]
    return modes(machine, values, locked=locked)
