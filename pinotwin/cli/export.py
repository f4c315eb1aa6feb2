"""``pinotwin export twin --format mjcf --out trunnion.xml``: a twin for other tools."""

from __future__ import annotations

from pathlib import Path

from pinotwin.cli.arguments import Answer, File, Repeated
from pinotwin.cli.inputs import by_axis, check_twin
from pinotwin.errors import InputError, require


def run(twin: str, *, format: str, speed: Repeated = (), out: File) -> Answer:
    """Write the files and say what they leave out.

    Args:
        format (FORMAT): urdf (inertials, <dynamics damping friction>), mjcf (MuJoCo, with a passive-force function
            in Python beside it), numpy or c (the inverse model in one file)
        speed (AXIS=V): largest speed that curves cover [m/s or rad/s] (the URDF's limit)
        out (PATH): file to write (.urdf, .xml, .py or .c)
    """
    check_twin(twin)
    from pinotwin.export import export_twin
    from pinotwin.export.inverse import default_speed
    from pinotwin.twin import Twin

    found = Twin.load(twin)
    names, speeds = found.machine.names, default_speed(found.machine)
    for name, (value,) in by_axis("speed", speed).items():
        require(name, names, "--speed: no axis", InputError)
        if not value > 0.0:
            raise InputError(f"--speed: {name}={value:g} must be positive")
        speeds[names.index(name)] = value
    made = export_twin(found, format, Path(out), speed=speeds)
    files = [str(Path(out).parent / name) for name in made.files]
    return Answer([*made.notes, f"written: {', '.join(files)}"], {**made.to_dict(), "files": files})
