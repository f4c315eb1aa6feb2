"""``pinotwin export TWIN --format urdf|mjcf|numpy|c --out FILE``."""

from __future__ import annotations

import argparse
from pathlib import Path

from pinotwin.cli.inputs import add_effects
from pinotwin.cli.output import add_common, say, write_json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("twin", metavar="TWIN", help="folder that `pinotwin identify` wrote")
    parser.add_argument(
        "--format",
        required=True,
        metavar="FORMAT",
        help="urdf (inertials, <dynamics damping friction>), mjcf (MuJoCo, with a passive-force function "
        "in Python beside it), numpy or c (the inverse model in one file)",
    )
    parser.add_argument(
        "--speed",
        action="append",
        default=[],
        metavar="AXIS=V",
        help="largest speed that curves cover [m/s or rad/s] (the URDF's limit)",
    )
    add_effects(parser)
    add_common(parser, out="file to write (.urdf, .xml, .py or .c)", required=True, file=True)


def run(args: argparse.Namespace) -> int:
    """Write the files and say what they leave out."""
    from pinotwin.export import export_twin
    from pinotwin.export.inverse import default_speed
    from pinotwin.twin import Twin

    twin = Twin.load(args.twin)
    out = Path(args.out)
    speed = _speeds(args.speed, twin, default_speed(twin.machine))
    made = export_twin(twin, args.format, out, speed=speed)
    if args.json:
        files = [str(out.parent / name) for name in made.files]
        write_json(args.json, {**made.to_dict(), "files": files})
    for note in made.notes:
        say(note)
    say(f"written: {', '.join(str(out.parent / name) for name in made.files)}")
    return 0


def _speeds(given, twin, usual):  # type: ignore[no-untyped-def]
    from pinotwin.errors import InputError

    names = twin.machine.names
    for text in given:
        name, _, value = text.partition("=")
        if name not in names:
            raise InputError(f"--speed {text}: no axis {name!r}; known: {', '.join(names)}")
        try:
            speed = float(value)
        except ValueError:
            raise InputError(f"--speed {text}: write AXIS=V, e.g. {names[0]}=0.5") from None
        if not speed > 0.0:
            raise InputError(f"--speed {text}: must be positive")
        usual[names.index(name)] = speed
    return usual
