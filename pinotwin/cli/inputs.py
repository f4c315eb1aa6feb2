"""Reading what the commands are given, with errors that name the argument."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pinotwin.cli.progress import progress, silent

if TYPE_CHECKING:
    from pinotwin.log import Log
    from pinotwin.machine import Machine
    from pinotwin.twin import Twin


LARGE = 30_000_000
"""Bytes of logs from which reading them is shown: a second or so."""

Subject = TypeVar("Subject", bound="Machine | Twin")


def add_preparation(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how a log is prepared."""
    parser.add_argument(
        "--cutoff",
        type=float,
        metavar="HZ",
        help="corner of the zero-phase low-pass; 0 for none (found in the logs)",
    )
    parser.add_argument("--decimate", type=int, metavar="N", help="fit one row in N (as the corner allows)")
    add_resample(parser)


def add_effects(parser: argparse.ArgumentParser) -> None:
    """Add the option that names files with own effects."""
    parser.add_argument(
        "--effects",
        action="append",
        default=[],
        metavar="FILE",
        help="Python file with effects of your own; may be given several times",
    )


def add_resample(parser: argparse.ArgumentParser) -> None:
    """Add the option that puts logs on another clock."""
    parser.add_argument(
        "--resample",
        type=float,
        metavar="HZ",
        help="put the logs on an even clock of that rate (their own clock)",
    )


def resampled(subject: Subject, rate: float | None) -> Subject:
    """Return the machine or twin whose logs are put on a clock of that rate [Hz]; None: as its YAML says."""
    if rate is None:
        return subject
    from pinotwin.twin import Twin

    machine = subject.machine if isinstance(subject, Twin) else subject
    other = replace(machine, data=replace(machine.data, resample=_rate(rate)))
    return replace(subject, machine=other) if isinstance(subject, Twin) else other  # type: ignore[return-value]


def _rate(rate: float) -> float:
    from pinotwin.errors import InputError

    if not (math.isfinite(rate) and rate > 0.0):
        raise InputError(f"--resample: {rate:g} Hz must be above 0")
    return rate


def settings(args: argparse.Namespace) -> dict[str, Any]:
    """Return the preparation options that were given."""
    from pinotwin.errors import InputError

    if args.cutoff is not None and not args.cutoff >= 0:
        raise InputError(f"--cutoff: {args.cutoff:g} Hz must not be negative (0: no low-pass)")
    if args.decimate is not None and args.decimate < 1:
        raise InputError(f"--decimate: {args.decimate} must be at least 1")
    rate = None if args.resample is None else _rate(args.resample)
    return {"cutoff": args.cutoff, "decimate": args.decimate, "resample": rate}


def read_logs(arguments: Sequence[str]) -> list[Log]:
    """Read every log, with a bar over long ones; ``a.csv+b.csv`` is one log whose columns lie in two files."""
    from pinotwin.logs.files import read_argument

    sizes = [_size(text) for text in arguments]
    logs = []
    with progress() if sum(sizes) > LARGE else nullcontext(silent) as report:
        for k, text in enumerate(arguments):

            def seen(share: float, k: int = k, name: str = f"reading {Path(text).name}") -> None:
                report(name, (sum(sizes[:k]) + share * sizes[k]) / max(sum(sizes), 1))

            seen(0.0)
            logs.append(read_argument(text, None if report is silent else seen))
    return logs


def _size(text: str) -> int:
    """Return the bytes of what an argument names; 0 for what is not there, which reading will say."""
    paths = [Path(text)] if Path(text).exists() else [Path(part.strip()) for part in text.split("+")]
    return sum(path.stat().st_size for path in paths if path.is_file())


def add_meshes(parser: argparse.ArgumentParser) -> None:
    """Add the option that says where the meshes of a URDF are."""
    parser.add_argument(
        "--meshes", metavar="DIR", help="folder of the URDF's meshes or mesh packages, for pictures"
    )


def with_meshes(machine: Machine, folder: str | None) -> Machine:
    """Return the machine with its meshes looked for in a folder first.

    Raises:
        InputError: there is no such folder.
    """
    return machine.with_meshes(folder)
