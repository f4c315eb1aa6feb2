"""``pinotwin view MACHINE|TWIN [LOG] [--posture Y=0.1,A=30deg] [--html FILE]``."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinotwin.cli.inputs import add_meshes, with_meshes
from pinotwin.cli.output import add_common, say, write_json
from pinotwin.writing import whole_folder

if TYPE_CHECKING:
    from pinotwin.analysis.modal import Modes
    from pinotwin.machine import Machine
    from pinotwin.viewer import Scene


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
    parser.add_argument("--no-frames", action="store_true", help="leave out joint frames and masses")
    add_meshes(parser)
    add_common(parser, out="folder for the page, as --html does with a file")


def run(args: argparse.Namespace) -> int:
    """Draw, and write a page or open the browser."""
    from pinotwin.machine import Machine
    from pinotwin.viewer import missing_meshes, save_html, show

    _check(args)
    machine = with_meshes(Machine.load(args.machine), args.meshes)
    missing = missing_meshes(machine.urdf, machine.meshes)
    if missing:
        say(missing)
    drawn = draw_machine(machine, args.posture, args.log, extras=not args.no_frames)
    if args.mode is not None:
        drawn = show_mode(machine, drawn, args)
    if args.json:
        write_json(args.json, _facts(machine, args))
    if args.html:
        save_html(Path(args.html), drawn)
        say(f"{machine.name} written to {args.html}")
    if args.out:
        with whole_folder(args.out) as folder:
            save_html(folder / f"{machine.name}.html", drawn)
        say(f"{machine.name} written to {Path(args.out) / machine.name}.html")
    if args.html or args.out:
        return 0
    live = show(drawn)
    say(f"{machine.name} at {live.url}; stop with Ctrl-C")
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        live.close()
    return 0


def _check(args: argparse.Namespace) -> None:
    """Refuse arguments that do not go together."""
    from pinotwin.errors import InputError

    if args.free is not None and args.mode is None:
        raise InputError("--free belongs to --mode N; give both")
    if args.servo and (args.mode is None or args.free is not None):
        raise InputError("--servo belongs to --mode N, in place of --free")
    if args.mode is not None and args.log:
        raise InputError("--mode shows a vibration, a log its own motion; give one of them")


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


def draw_machine(machine: Machine, posture: str | None, log: str | None, *, extras: bool) -> Scene:
    """Return the scene of a machine at a posture, or playing a log."""
    from pinotwin.logs.files import read_argument
    from pinotwin.logs.prepare import prepare
    from pinotwin.viewer import draw, parse_posture, play, visual_model

    rotary = dict(zip(machine.names, machine.rotary, strict=True))
    joints = {part.name: part.joint for part in machine.parts}
    values = parse_posture(posture, rotary) if posture else {}
    scene = draw(
        machine.model,
        visual_model(machine.model, machine.urdf, machine.meshes),
        posture={joints[name]: value for name, value in values.items()},
        frames=extras,
        masses=extras,
        name=machine.name,
    )
    if log is None:
        return scene
    motion = prepare(machine, read_argument(log))
    return play(scene, motion.t, motion.q)


def show_mode(machine: Machine, drawn: Scene, args: argparse.Namespace) -> Scene:
    """Return the scene vibrating in one of its modes, enlarged so that it can be seen."""
    from pinotwin.analysis.modal import animate
    from pinotwin.viewer import play

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
    return play(drawn, t, q)


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
