"""``pinotwin view MACHINE|TWIN [LOG] [--posture Y=0.1,A=30deg] [--html FILE]``."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinotwin.cli.inputs import add_effects, add_meshes, with_meshes
from pinotwin.cli.output import add_common, say, write_json
from pinotwin.system.writing import whole_folder, write_text

if TYPE_CHECKING:
    import pinocchio as pin

    from pinotwin.analysis.modal import Modes
    from pinotwin.machine import Machine
    from pinotwin.viewer import Scene
    from pinotwin.viewer.tracks import Tracks


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
    from pinotwin.machine import Machine
    from pinotwin.viewer import missing_meshes
    from pinotwin.viewer.live import serve

    _check(args)
    if args.rrd:
        return _record(args)
    machine = with_meshes(Machine.load(args.machine), args.meshes)
    missing = missing_meshes(machine.urdf, machine.meshes)
    if missing:
        say(missing)
    page = _page(machine, args)
    if args.json:
        write_json(args.json, _facts(machine, args))
    if args.html:
        write_text(args.html, page)
        say(f"{machine.name} written to {args.html}")
    if args.out:
        with whole_folder(args.out) as folder:
            (folder / f"{machine.name}.html").write_text(page, encoding="utf-8")
        say(f"{machine.name} written to {Path(args.out) / machine.name}.html")
    if args.html or args.out:
        return 0
    with serve(page) as url:
        say(f"{machine.name} at {url}; stop with Ctrl-C")
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


def _page(machine: Machine, args: argparse.Namespace) -> str:
    """Return the page of a machine or twin: at a posture, playing a log, or in one of its modes."""
    from pinotwin.machine import Machine
    from pinotwin.viewer.panel import Overlay, panel, stage_for

    drawn = draw_machine(machine, args.posture, extras=not args.no_frames)
    other = None
    if args.overlay:
        second = with_meshes(Machine.load(args.overlay), args.meshes)
        other = Overlay(second, _shapes(second))
    if args.mode is not None:
        tracks, told = show_mode(machine, args)
        return panel(drawn, machine, tracks=tracks, overlay=other, subtitle=told)
    if args.log is None:
        return panel(drawn, machine, overlay=other, subtitle="move the axes; drag to turn, wheel to zoom")
    tracks = _played(machine, args)
    framed = stage_for(drawn, tracks.q)
    return panel(framed, machine, tracks=tracks, overlay=other, subtitle=f"playing {Path(args.log).name}")


def _played(machine: Machine, args: argparse.Namespace) -> Tracks:
    """Return the playback of a log, with the model's effort where a twin was given."""
    from pinotwin.logs.files import read_argument
    from pinotwin.logs.prepare import prepare
    from pinotwin.twin import Twin
    from pinotwin.viewer.tracks import tracks_of

    log = read_argument(args.log)
    if not (Path(args.machine) / "twin.json").is_file():
        return tracks_of(machine, prepare(machine, log, decimate=1))
    twin = Twin.load(args.machine)
    return tracks_of(machine, twin.motion(log), twin)


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


def _facts(machine: Machine, args: argparse.Namespace) -> dict[str, Any]:
    """Return what is shown: posture in SI, and where the page went."""
    from pinotwin.viewer import parse_posture

    rotary = dict(zip(machine.names, machine.rotary, strict=True))
    given = parse_posture(args.posture, rotary) if args.posture else {}
    return {
        "machine": machine.name,
        "posture": {name: given.get(name, 0.0) for name in machine.names},
        "log": args.log,
        "mode": args.mode,
        "html": args.html or (args.out and str(Path(args.out) / f"{machine.name}.html")),
    }


def _shapes(machine: Machine) -> pin.GeometryModel:
    from pinotwin.viewer import visual_model

    return visual_model(machine.model, machine.urdf, machine.meshes)


def draw_machine(machine: Machine, posture: str | None, *, extras: bool) -> Scene:
    """Return the scene of a machine at a posture."""
    from pinotwin.viewer import draw, parse_posture

    rotary = dict(zip(machine.names, machine.rotary, strict=True))
    joints = {part.name: part.joint for part in machine.parts}
    values = parse_posture(posture, rotary) if posture else {}
    return draw(
        machine.model,
        _shapes(machine),
        posture={joints[name]: value for name, value in values.items()},
        frames=extras,
        masses=extras,
        name=machine.name,
    )


def show_mode(machine: Machine, args: argparse.Namespace) -> tuple[Tracks, str]:
    """Return one of the modes as a playback, enlarged so that it can be seen, and what it is."""
    from pinotwin.analysis.modal import animate
    from pinotwin.viewer.tracks import Tracks

    found = _modes(machine, args)
    for k, mode in enumerate(found.modes, 1):
        shares = ", ".join(
            f"{name} {share:.0%}"
            for name, share in zip(found.names, mode.energy, strict=True)
            if abs(share) >= 0.005
        )
        mark = " <" if k == args.mode else ""
        say(f"mode {k}: {mode.frequency:.2f} Hz, damping {mode.damping:.3f} ({shares}){mark}")
    t, q = animate(found, args.mode, 0.1)
    mode = found.modes[args.mode - 1]
    return Tracks(
        t, q
    ), f"mode {args.mode}: {mode.frequency:.1f} Hz, damping {mode.damping:.3f}, enlarged and slowed"


def _modes(machine: Machine, args: argparse.Namespace) -> Modes:
    """Return the modes with motors held, some free, or with their servo loops closed."""
    from pinotwin.analysis.modal import modes, servo_modes
    from pinotwin.twin import Twin
    from pinotwin.viewer import parse_posture

    rotary = dict(zip(machine.names, machine.rotary, strict=True))
    values = parse_posture(args.posture, rotary) if args.posture else {}
    if args.servo:
        return servo_modes(Twin.load(args.machine), values)
    released = [] if args.free is None else (args.free or list(machine.axes))
    for name in released:
        machine.axis(name)
    locked = [name for name in machine.axes if name not in released]
    return modes(machine, values, locked=locked)
