"""``pinotwin identify trunnion log.csv --validate other.csv --out twin``: a twin from the logs of a machine."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinotwin.cli.arguments import Answer, Folder, Repeated, Several
from pinotwin.cli.inputs import above_zero, check_there, read_logs
from pinotwin.cli.output import columns, say
from pinotwin.cli.progress import progress
from pinotwin.errors import InputError
from pinotwin.notebook import share_cell
from pinotwin.system.stamps import made
from pinotwin.system.writing import whole_folder, write_text

if TYPE_CHECKING:
    from pinotwin.log import Log
    from pinotwin.machine import Machine
    from pinotwin.studies.improvement import Improvement
    from pinotwin.twin import Twin


def run(
    machine: str,
    logs: Several,
    *,
    validate: Repeated = (),
    no_loop: bool = False,
    inconsistent: bool = False,
    cutoff: float | None = None,
    decimate: int | None = None,
    resample: float | None = None,
    out: Folder,
) -> Answer:
    """Identify, save, and say what was found.

    Args:
        logs (LOG): servo log(s); a.csv+b.csv joins columns
        validate (LOG): log to validate on, not used to fit (without one: cross-validated on LOG)
        no_loop: identify the open loop only
        inconsistent: do not force the inertias to be physically possible
        out (PATH): folder for the twin and its report
    """
    check_there(*logs, *validate)
    options = _preparation(cutoff, decimate, resample)
    from pinotwin.machine import Machine

    believed = Machine.load(machine)
    spare_the_machine(believed, Path(out))
    from pinotwin.identification import identify
    from pinotwin.identification.judge import signs_of_missing_effects

    fitted, held = read_logs(logs), read_logs(validate)
    for line in _doubts(believed, fitted):
        say(line)
    began = time.monotonic()
    with progress() as report:
        twin = identify(
            believed,
            fitted,
            validate=held or None,
            loop=not no_loop,
            consistent=not inconsistent,
            report=report,
            **options,
        )
        report("writing the twin", 0.9)
        how = made(began, closed_loop=not no_loop, consistent=not inconsistent, **options)
        content = save_twin(twin, fitted, held, how, out)
    lines = [*summary(twin), f"twin and report written to {out}"]
    if signs := signs_of_missing_effects(twin.quality):
        lines.append(f"next: an effect may be missing ({'; '.join(signs)}); `pinotwin improve` looks for it")
    return Answer(lines, content)


def _preparation(cutoff: float | None, decimate: int | None, resample: float | None) -> dict[str, Any]:
    if cutoff is not None and not cutoff >= 0:
        raise InputError(f"--cutoff: {cutoff:g} Hz must not be negative (0: no low-pass)")
    if decimate is not None and decimate < 1:
        raise InputError(f"--decimate: {decimate} must be at least 1")
    return {"cutoff": cutoff, "decimate": decimate, "resample": above_zero("resample", resample)}


def save_twin(
    twin: Twin,
    fitted: Sequence[Log],
    held: Sequence[Log],
    how: Mapping[str, Any],
    out: str,
    found: Improvement | None = None,
) -> dict[str, Any]:
    """Write a twin and its page, and return the content of twin.json; ``found``: the steps that led to it."""
    from pinotwin.report.identification import identification_report, steps_blocks
    from pinotwin.twin.files import write_twin

    with whole_folder(out) as folder:
        content = write_twin(twin, folder)
        steps = steps_blocks(found) if found else ()
        write_text(folder / "report.html", identification_report(twin, fitted, held, how, steps))
    return content


def spare_the_machine(machine: Machine, out: Path) -> None:
    """Refuse to write a twin over the machine that it is identified from."""
    if out.resolve() == machine.path.resolve().parent and not (out / "twin.json").is_file():
        raise InputError(f"--out: {out} holds the machine itself; give another folder for its twin")


def _doubts(machine: Machine, logs: Sequence[Log]) -> Iterator[str]:
    """Yield what makes the logs themselves doubtful (units, clock, sign of efforts), see `check`."""
    from pinotwin.logs.prepared import Prepared

    for log in logs:
        for finding in Prepared(machine, log).doubts:
            if finding.severity == "warning":
                yield f"note: {log.source}: {str(finding).removeprefix('warning: ')}"


def summary(twin: Twin) -> list[str]:
    """Return the few lines that a user wants to see first."""
    from pinotwin.report.verdict import bodies

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
        apart = [own.get(kind) for kind in ("moving", "resting")]
        apart = ["-" if x is None else f"{x:.3g} {own.get('unit', '')}" for x in apart]
        rows.append([name, *map(share_cell, (row["fit"], held["nrmse"], held["nrmse_std"])), *apart])
    rows.append(["all", share_cell(quality["relative_error"]), "", "", "", ""])
    lines += columns(("axis", "fit", "held out", "of std", "in motion", "at rest"), rows)
    lines.append("fit, held out: RMS error / RMS effort; of std: over its standard deviation")
    if sizes:
        lines.append("in motion, at rest: RMS residual on held-out data, moving and at standstill")
    head, rows, cost = bodies(twin)
    lines += [*(columns(head, rows) if rows else ()), *cost]
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
