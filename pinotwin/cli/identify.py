"""``pinotwin identify MACHINE LOG [LOG...] [--validate LOG] --out TWIN``."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinotwin.cli.inputs import add_effects, add_preparation, read_logs, settings
from pinotwin.cli.output import add_common, columns, made, say, write_json
from pinotwin.cli.progress import progress
from pinotwin.errors import InputError
from pinotwin.system.writing import whole_folder, write_text

if TYPE_CHECKING:
    from pinotwin.log import Log
    from pinotwin.machine import Machine
    from pinotwin.twin import Twin


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("machine", help="machine folder, machine.yaml, .urdf, or a bundled name")
    parser.add_argument("logs", nargs="+", metavar="LOG", help="servo log(s); a.csv+b.csv joins columns")
    parser.add_argument(
        "--validate",
        action="append",
        default=[],
        metavar="LOG",
        help="log to validate on, not used to fit (without one: cross-validated on LOG)",
    )
    parser.add_argument("--no-loop", action="store_true", help="identify the open loop only")
    parser.add_argument(
        "--inconsistent", action="store_true", help="do not force the inertias to be physically possible"
    )
    add_preparation(parser)
    add_effects(parser)
    add_common(parser, out="folder for the twin and its report", required=True)


def run(args: argparse.Namespace) -> int:
    """Identify, save, and say what was found."""
    from pinotwin.identification import identify
    from pinotwin.machine import Machine
    from pinotwin.report import identification_report
    from pinotwin.twin.files import write_twin

    options = settings(args)
    machine = Machine.load(args.machine).require_physical()
    _spare_the_machine(machine, Path(args.out))
    logs = read_logs(args.logs)
    validate = read_logs(args.validate)
    for line in _doubts(machine, logs):
        say(line)
    began = time.monotonic()
    with progress() as report:
        twin = identify(
            machine,
            logs,
            validate=validate or None,
            loop=not args.no_loop,
            consistent=not args.inconsistent,
            report=report,
            **options,
        )
        with whole_folder(args.out) as folder:
            report("writing the twin", 0.9)
            content = write_twin(twin, folder)
            report("writing the report", 0.95)
            page = identification_report(twin, logs, validate, made(began, **_asked(args)))
            write_text(folder / "report.html", page)
    if args.json:
        write_json(args.json, content)
    for line in summary(twin):
        say(line)
    say(f"twin and report written to {args.out}")
    return 0


def _asked(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options that a page states."""
    return {
        "closed_loop": not args.no_loop,
        "consistent": not args.inconsistent,
        **{name: getattr(args, name) for name in ("cutoff", "decimate", "resample")},
    }


def _spare_the_machine(machine: Machine, out: Path) -> None:
    """Refuse to write a twin over the machine that it is identified from."""
    if out.resolve() == machine.path.resolve().parent and not (out / "twin.json").is_file():
        raise InputError(f"--out: {out} holds the machine itself; give another folder for its twin")


def _doubts(machine: Machine, logs: Sequence[Log]) -> Iterator[str]:
    """Yield what makes the logs themselves doubtful (units, clock, sign of efforts), see `check`."""
    from pinotwin.logs.prepared import Prepared

    for log in logs:
        for finding in Prepared.of(machine, log).doubts:
            if finding.severity == "warning":
                yield f"note: {log.source}: {str(finding).removeprefix('warning: ')}"


def summary(twin: Twin) -> list[str]:
    """Return the few lines that a user wants to see first."""
    quality = twin.quality
    lines = [
        f"{twin.machine.name}: {len(twin.theta)} linear and "
        f"{sum(p.kind == 'shape' for p in twin.parameters)} searched parameters"
    ]
    sizes = twin.misfit.summary if twin.misfit is not None else {}
    rows = []
    for name, row in quality["axes"].items():
        held = row.get("validation", row["held_out"])
        own = sizes.get(name, {})
        apart = [_size(own.get(kind), own.get("unit", "")) for kind in ("moving", "resting")]
        rows.append([name, *map(_percent, (row["fit"], held["nrmse"], held["nrmse_std"])), *apart])
    rows.append(["all", _percent(quality["relative_error"]), "", "", "", ""])
    lines += columns(("axis", "fit", "held out", "of std", "in motion", "at rest"), rows)
    lines.append("fit, held out: RMS error / RMS effort; of std: over its standard deviation")
    if sizes:
        lines.append("in motion, at rest: RMS residual on held-out data, moving and at standstill")
    lines += _leads(quality)
    for warning in [*quality.get("preparation", ()), *quality["warnings"]]:
        lines.append(f"note: {warning}")
    return lines


def _leads(quality: Mapping[str, Any]) -> Iterator[str]:
    """Yield one line about the efforts that are ahead of their position, or behind."""
    found = {name: row for name, row in quality.get("leads", {}).items() if row.get("significant")}
    if found:
        each = ", ".join(
            f"{name} {1e3 * row['lead']:.2f} ± {1.96e3 * row['standard_error']:.2f}"
            for name, row in found.items()
        )
        done = "corrected" if any(row["applied"] for row in found.values()) else "kept for the closed loop"
        yield f"time by which the effort leads the position [ms], {done}: {each}"


def _size(x: float | None, unit: str) -> str:
    """Return one cell of the misfit; a dash where an axis has no such row."""
    return "-" if x is None else f"{x:.3g} {unit}"


def _percent(x: float) -> str:
    return f"{x:.2%}" if math.isfinite(x) else "-"
