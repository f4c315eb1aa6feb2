"""``pinotwin improve trunnion log.csv --validate other.csv --out twin``: a twin whose model gets what it lacks."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from pinotwin.cli.arguments import Answer, Folder, Repeated, Several
from pinotwin.cli.identify import save_twin, spare_the_machine, summary
from pinotwin.cli.inputs import check_there, read_logs
from pinotwin.cli.output import columns
from pinotwin.cli.progress import progress
from pinotwin.errors import InputError
from pinotwin.system.phrases import IMPROVED
from pinotwin.system.stamps import made

if TYPE_CHECKING:
    from pinotwin.studies.improvement import Improvement


def run(
    machine: str, logs: Several, *, validate: Repeated = (), most: int = 5, seed: int = 0, out: Folder
) -> Answer:
    """Identify, add what the model lacks, identify again; save the best twin.

    Args:
        logs (LOG): servo log(s) of the healthy machine
        validate (LOG): sealed log: neither fit nor diagnosis sees it; it decides whether a step is kept
        most (N): largest number of steps
        out (PATH): folder for the twin and its report
    """
    check_there(*logs, *validate)
    if not validate:
        raise InputError("--validate: give a log that is not used to fit; it decides whether a step helps")
    if most < 1:
        raise InputError(f"--most: {most} must be at least 1")
    from pinotwin.machine import Machine

    believed = Machine.load(machine)
    spare_the_machine(believed, Path(out))
    from pinotwin.studies.improvement import improve

    fitted, held = read_logs(logs), read_logs(validate)
    began = time.monotonic()
    with progress() as report:
        found = improve(believed, fitted, validate=held, seed=seed, most=most, report=report)
        save_twin(found.twin, fitted, held, made(began, most=most, seed=seed), out, found)
    lines = [*steps(found), "", *summary(found.twin), f"twin and report written to {out}"]
    return Answer(lines, found.to_dict())


def steps(found: Improvement) -> list[str]:
    """Return the table of the steps, what each added, and why there are no more."""
    lines = columns(found.head(), found.rows())
    lines.append(IMPROVED["errors"])
    for k, step in enumerate(found.steps):
        lines += [f"step {k}: {text}" for text in step.added]
    return [*lines, f"end: {found.end}"]
